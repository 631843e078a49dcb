"""What an estimation found: values with standard errors, residuals, and what the data do not determine."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import attrs
import numpy as np
from numpy.typing import NDArray

from ..errors import DefinitionError, EstimationError
from ..robot.checks import Array
from ..robot.robot import Robot
from .estimation import Estimation, Linearized
from .measurements import Somewhere, arc_length_of
from .reduced import Found, solve_reduced
from .uncertainty import (
    Determined,
    Direction,
    Information,
    covariance,
    determined,
    directions,
    information,
    is_factor,
    symbol,
    taking_part,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..equilibrium import Equilibrium

REJECTED = 1e-3  # probability of the residuals' chi-square below which the given noise level is not believed
_OUTLIER = 0.01  # probability, over all experiments, that good data have one flagged


@attrs.frozen(eq=False)
class Residual:
    """The misfit of one block (a point, a pose): whose it is, where, and predicted minus measured, SI."""

    experiment: int
    measurement: int
    block: int
    """Which of the measurement's: of several points, its number."""

    arc_length: float
    """Where it was measured, m, as the fit has it; of points at unknown arc lengths its estimate."""

    value: Array

    @property
    def size(self) -> float:
        """Norm; of a position its distance, m."""
        return float(np.linalg.norm(self.value))


class Fit:
    """The result of a :class:`~ctr_opt.CalibrationProblem`.

    Attributes
    ----------
    names
        The parameters' names.
    labels
        A name for each number: the rows and columns of :attr:`covariance`.
    method, iterations, objective
        How it was found; the loss reached, priors included.
    """

    def __init__(self, estimation: Estimation, found: Found, method: str) -> None:
        self._estimation = estimation
        self._found = found
        self.method = method
        self.names = [entry.name for entry in estimation.unknowns.entries]
        self.labels = estimation.unknowns.labels
        self.iterations = found.iterations
        self.objective = estimation.cost(self._linearized) + estimation.prior_cost(found.x)

    # -- estimates -------------------------------------------------------------------------------------------------

    @cached_property
    def values(self) -> dict[str, Any]:
        """The estimates by name, floats or arrays; not a number where the data do not determine them."""
        return self._estimation.unknowns.values(self.estimates)

    @cached_property
    def estimates(self) -> Array:
        """The estimates in the order of :attr:`labels`; not a number where the data do not determine them."""
        return np.where(self._open, np.nan, self._found.x)

    @cached_property
    def deviations(self) -> Array:
        """Their standard deviations; infinite where the data do not determine them."""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def standard_errors(self) -> dict[str, Any]:
        """Standard deviations of the estimates by name; infinite where the data do not determine them."""
        return self._estimation.unknowns.values(self.deviations)

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the numbers of :attr:`labels`, SI; infinite variances where they are not determined.

        From the noise level that was given, unless the residuals reject it (see :attr:`p_value`), then from the level
        that they show; of robust losses the sandwich ``H^-1 S H^-1`` of Hessian and scatter of gradients.
        """
        if self._estimation.loss != "squared":
            return self._of_noise(None)
        return self.covariance_assumed if self.noise_accepted else self.covariance_estimated

    @cached_property
    def covariance_assumed(self) -> Array:
        """Covariance for the noise level that was given."""
        return self._of_noise(1.0)

    @cached_property
    def covariance_estimated(self) -> Array:
        """Covariance for the noise level that the residuals show."""
        return self._of_noise(self.noise)

    @cached_property
    def correlation(self) -> Array:
        """Correlations of the numbers of :attr:`labels`; not a number where they are not determined."""
        known = np.isfinite(self.deviations) & (self.deviations > 0.0)
        deviations = np.where(known, self.deviations, np.nan)
        return np.asarray(self.covariance / np.outer(deviations, deviations))

    @cached_property
    def undetermined(self) -> list[Direction]:
        """Directions that the data do not determine, in words; empty if they determine everything."""
        unknowns = self._estimation.unknowns
        return directions(self._determined, self.labels, self._found.x, unknowns.scale)

    @cached_property
    def ratios(self) -> dict[str, tuple[float, float]]:
        """Where parameters may be scaled together only: their ratios to the first of them, with standard errors."""
        found: dict[str, tuple[float, float]] = {}
        x = self._found.x
        for direction in self.undetermined:
            names = list(direction.parts)
            those = [self.labels.index(name) for name in names]
            if len(those) < 2 or not is_factor(names, np.array([direction.parts[n] for n in names]) / x[those]):
                continue
            for k in those[1:]:
                contrast = np.zeros(len(x))
                contrast[k], contrast[those[0]] = 1.0 / x[k], -1.0 / x[those[0]]
                ratio = x[k] / x[those[0]]
                error = ratio * np.sqrt(contrast @ self._known_covariance @ contrast)
                found[f"{symbol(self.labels[k])} / {symbol(self.labels[those[0]])}"] = (float(ratio), float(error))
        return found

    @property
    def condition(self) -> float:
        """Condition of the information matrix, in the parameters' scales."""
        return self._determined.condition

    @cached_property
    def robot(self) -> Robot:
        """The robot with the estimated parameters.

        Raises
        ------
        EstimationError
            The data do not determine them.
        """
        if self.undetermined:
            raise EstimationError(
                f"the data do not determine the robot: {'; '.join(map(str, self.undetermined))}. Add measurements "
                "under load, priors, or estimate fewer parameters"
            )
        return self._estimation.unknowns.robot_at(self._found.x)

    @cached_property
    def equilibria(self) -> list[Equilibrium]:
        """The experiments' equilibria with the estimated parameters."""
        return self._estimation.equilibria(self._found.x)

    # -- residuals ---------------------------------------------------------------------------------------------------

    @cached_property
    def residuals(self) -> list[Residual]:
        """Every block's misfit, predicted minus measured, by experiment."""
        unknowns, x = self._estimation.unknowns, self._found.x
        lengths = np.array([tube.length for tube in unknowns.robot_at(x).tubes])
        found = []
        for k, (experiment, each) in enumerate(zip(self._estimation.experiments, self._linearized, strict=True)):
            ends = lengths + unknowns.experiment_at(x, k)[0].translations
            start, places = 0, iter(each.places * ends.max())
            for j, measured in enumerate(experiment.measurements):
                count, size = measured.shape
                for i, request in enumerate(measured.requests[:count]):
                    value = np.linalg.solve(self._estimation.whitener(measured)[i], each.misfit[start : start + size])
                    place = request.place
                    s = float(next(places)) if isinstance(place, Somewhere) else arc_length_of(place, ends)
                    found.append(Residual(k, j, i, s, value))
                    start += size
        return found

    @cached_property
    def chi_squared(self) -> float:
        """Sum of the squared residuals over the given noise's variances, and of the deviations from priors over theirs.

        Where no noise level was given, of the residuals alone, in mm, mrad and so on.
        """
        priors = 2.0 * self._estimation.prior_cost(self._found.x) if self._estimation.scaled else 0.0
        return float(sum(each.misfit @ each.misfit for each in self._linearized)) + priors

    @property
    def degrees_of_freedom(self) -> int:
        """Numbers measured, and known by priors, less parameters determined by them and arc lengths of points.

        An arc length that the entry point, the tip or another point's bounds is none that was estimated.
        """
        numbers = int(self._numbers.sum())
        if self._estimation.scaled:
            numbers += int(np.isfinite(self._estimation.unknowns.prior[1]).sum())
        return int(max(numbers - self._determined.known.shape[1], 0))

    @cached_property
    def _numbers(self) -> NDArray[np.intp]:
        """Numbers that each experiment has for the parameters: those measured less arc lengths that they tell."""
        layouts = self._estimation.layouts
        return np.array(
            [
                len(each.misfit) - layout.along(each).any(axis=0).sum()
                for layout, each in zip(layouts, self._linearized, strict=True)
            ]
        )

    @property
    def noise(self) -> float:
        """Noise level that the residuals show, over that given; NaN where nothing is left over."""
        freedom = self.degrees_of_freedom
        return float(np.sqrt(self.chi_squared / freedom)) if freedom else np.nan

    @property
    def p_value(self) -> float:
        """Probability of residuals so large under the given noise level; NaN if none was given."""
        from scipy.stats import chi2

        if not self._estimation.scaled or not self.degrees_of_freedom:
            return np.nan
        return float(chi2.sf(self.chi_squared, self.degrees_of_freedom))

    @property
    def noise_accepted(self) -> bool:
        """Whether a noise level was given that the residuals do not reject (at 1e-3)."""
        return self._estimation.scaled and not self.p_value < REJECTED

    # -- what depends on what ------------------------------------------------------------------------------------------

    @cached_property
    def influence(self) -> Array:
        """How far each experiment pulls the estimates, ``(experiments,)``: Cook's distance, from one Newton step.

        The squared change of the estimates without it, in their standard errors, over their number.
        """
        known = self._determined.known
        full = known.T @ (self._information.curvature + self._information.prior) @ known
        inverse = np.linalg.inv(known.T @ self._known_scaled @ known)
        found = []
        for own, gradient in zip(self._information.each, self._information.gradients, strict=True):
            step = np.linalg.lstsq(full - known.T @ own @ known, known.T @ gradient, rcond=None)[0]
            found.append(step @ inverse @ step / max(known.shape[1], 1))
        return np.array(found)

    @cached_property
    def outliers(self) -> list[int]:
        """Experiments whose residuals are too large for the others, by their numbers.

        The sum of squares of an experiment against chi-square, with a noise level from the median experiment; flagged
        so seldom that good data have one in a hundred fits.
        """
        from scipy.stats import chi2

        squares = np.array([each.misfit @ each.misfit for each in self._linearized])
        sizes = np.maximum(self._numbers, 1)
        level = np.median(squares / chi2.median(sizes))
        probabilities = chi2.sf(squares / level, sizes)
        return [int(k) for k in np.flatnonzero(probabilities < _OUTLIER / len(sizes))]

    def profile(self, label: str, *, count: int = 9, width: float = 3.0) -> tuple[Array, Array]:
        """Profile likelihood of one number: its values, and the loss with all others estimated anew, over the least.

        Parameters
        ----------
        label
            One of :attr:`labels`.
        count, width
            So many values, as far as ``width`` standard errors from the estimate, or to its bounds.

        Returns
        -------
        tuple
            Values ``(count,)`` and excess loss ``(count,)``; for normal errors half the squared distance in standard
            errors where the problem is linear.
        """
        if label not in self.labels:
            raise DefinitionError(f"label = {label!r} must be one of {', '.join(self.labels)}")
        k = self.labels.index(label)
        error = float(self.deviations[k])
        if not np.isfinite(error):
            raise EstimationError(f"{label} is not determined, so that it has no profile")
        lower, upper = (bound[k] for bound in self._estimation.unknowns.bounds)
        x = self._found.x[k]
        values = np.linspace(max(x - width * error, lower), min(x + width * error, upper), count)
        costs = []
        for value in values:
            x = self._found.x.copy()
            x[k] = value
            found = solve_reduced(self._estimation, self.equilibria, start=x, fixed=[k])
            linearized = self._estimation.linearize(found.x, found.states)
            costs.append(self._estimation.cost(linearized) + self._estimation.prior_cost(found.x) - self.objective)
        return values, np.array(costs)

    def without(self, experiments: Sequence[int] | int) -> Fit:
        """The fit to the other experiments, from here: leave one out, or a block, to hold it out."""
        dropped = self._numbered(experiments)
        kept = [k for k in range(len(self._estimation.experiments)) if k not in dropped]
        return self._again(kept)

    def _numbered(self, experiments: Sequence[int] | int) -> list[int]:
        """The numbers of experiments that there are."""
        count = len(self._estimation.experiments)
        given = [experiments] if np.ndim(experiments) == 0 else list(experiments)  # type: ignore[arg-type]
        for k in given:
            if isinstance(k, bool) or not isinstance(k, (int, np.integer)) or not 0 <= k < count:
                raise DefinitionError(f"experiments: {k!r} must be the number of an experiment from 0 to {count - 1}")
        return [int(k) for k in given]  # type: ignore[arg-type]

    def errors_without(self, experiments: Sequence[int] | int) -> list[Residual]:
        """The residuals of experiments that a fit to the others predicts: a hold-out."""
        numbers = self._numbered(experiments)
        other = self.without(numbers)
        held = [self._estimation.experiments[k] for k in numbers]
        tested = self._estimation.of(held)
        states = tested.states(other._found.x, tested.equilibria(other._found.x))
        shown = Fit(tested, attrs.evolve(other._found, states=states), self.method)
        return [attrs.evolve(each, experiment=numbers[each.experiment]) for each in shown.residuals]

    def bootstrap(self, repetitions: int = 200, *, seed: int = 0) -> Array:
        """Estimates from experiments drawn again with replacement, ``(repetitions, len(labels))``."""
        rng = np.random.default_rng(seed)
        count = len(self._estimation.experiments)
        return np.array([self._again(rng.integers(count, size=count))._found.x for _ in range(repetitions)])

    def _again(self, chosen: Any) -> Fit:
        """A fit to a choice of experiments, from here."""
        chosen = [int(k) for k in chosen]
        own = [entry for entry in self._estimation.unknowns.entries if entry.experiment is not None]
        if own:
            raise EstimationError(
                f"{own[0].name} belongs to one experiment, so that none can be left out or drawn again"
            )
        if not chosen:
            raise DefinitionError("experiments: at least one must be left")
        drawn = self._estimation.of([self._estimation.experiments[k] for k in chosen])
        found = solve_reduced(drawn, [self.equilibria[k] for k in chosen], start=self._found.x)
        return Fit(drawn, found, "reduced")

    # -- for people ------------------------------------------------------------------------------------------------

    def report(self) -> str:
        """Estimates with their errors, correlations, residuals, and what the data do not tell, as text."""
        from .fit_report import fit_report

        return fit_report(self)

    def plot(self) -> Figure:
        """Histogram of the tip's errors, residuals along the robot, correlations and confidence ellipses."""
        from .fit_plots import figure_fit

        return figure_fit(self)

    def __repr__(self) -> str:
        open_ones = f", {len(self.undetermined)} directions undetermined" if self.undetermined else ""
        return f"<Fit of {len(self.labels)} numbers to {len(self._estimation.experiments)} experiments{open_ones}>"

    # -- internals ---------------------------------------------------------------------------------------------------

    @property
    def estimation(self) -> Estimation:
        """The problem that was solved."""
        return self._estimation

    @cached_property
    def _linearized(self) -> list[Linearized]:
        if not self._estimation.prepared:
            self._estimation.prepare(self.equilibria)
        return self._estimation.linearize(self._found.x, self._found.states)

    @cached_property
    def _information(self) -> Information:
        return information(self._estimation, self._linearized)

    @cached_property
    def _determined(self) -> Determined:
        level = 1.0
        if self._estimation.loss == "squared" and not self._estimation.scaled:
            level = self.chi_squared / max(int(self._numbers.sum()) - len(self._found.x), 1)
        return determined(self._information.matrix / max(level, 1e-12) + self._information.prior)

    @property
    def _open(self) -> Any:
        return taking_part(self._determined)

    def _of_noise(self, noise: float | None) -> Array:
        """Covariance for a noise level, or the sandwich; infinite where undetermined."""
        found = self._scaled(noise)
        scale = self._estimation.unknowns.scale
        found = found * np.outer(scale, scale)
        those = np.flatnonzero(self._open)
        found[those, :] = found[:, those] = np.nan
        found[those, those] = np.inf
        return found

    def _scaled(self, noise: float | None) -> Array:
        parts, known = self._information, self._determined.known
        if noise is None:
            return covariance(parts.curvature + parts.prior, known, parts.scatter + parts.prior)
        return covariance(parts.matrix / noise**2 + parts.prior, known)

    @property
    def _known_scaled(self) -> Array:
        if self._estimation.loss != "squared":
            return self._scaled(None)
        return self._scaled(1.0 if self.noise_accepted else self.noise)

    @property
    def _known_covariance(self) -> Array:
        """Covariance of what is known of the parameters, SI."""
        scale = self._estimation.unknowns.scale
        return self._known_scaled * np.outer(scale, scale)
