"""What an estimation found: values with standard errors, residuals, and what the data do not determine."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..errors import EstimationError
from ..estimation.chi_square import p_value, quantile, tail
from ..estimation.linearized import Linearized
from ..estimation.places import free
from ..layout.ends import Ends
from ..layout.observables import Somewhere, arc_length_of
from ..robot.actuation import Actuation
from ..robot.names import symbol
from ..robot.robot import Robot
from .estimation import Estimation
from .homes import Homes
from .reduced import Found
from .uncertainty import (
    VAGUE,
    Determined,
    Direction,
    Information,
    covariance,
    determined,
    directions,
    information,
    is_factor,
    taking_part,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..estimation.experiment import Experiment
    from ..forward.equilibrium import Equilibrium

REJECTED = 1e-3  # probability of the residuals' chi-square below which the given noise level is not believed
_EXACT = 1e-5  # of the noise level (of 1 mm, 1 mrad, ... where none was given): computed data leave such residuals
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

    @property
    def distance(self) -> float:
        """Of a position or pose how far the points are apart, m."""
        return float(np.linalg.norm(self.value[:3]))

    @property
    def angle(self) -> float:
        """Of a tangent or pose how far the axes or frames are turned, rad."""
        return float(np.linalg.norm(self.value[-3:]))


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
    found
        Where the solve ended, undetermined numbers and base moments as they stood.
    """

    def __init__(self, estimation: Estimation, found: Found, method: str) -> None:
        self._estimation = estimation
        self.found = found
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
        return np.where(self._open, np.nan, self.found.x)

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
        return directions(self._determined, self.labels, self.found.x, unknowns.scale)

    @property
    def vague(self) -> list[str]:
        """Labels of numbers that are determined, but to no better than their own size."""
        relative = self.deviations / self._estimation.unknowns.scale
        return [label for label, each in zip(self.labels, relative, strict=True) if VAGUE < each < np.inf]

    @cached_property
    def ratios(self) -> dict[str, tuple[float, float]]:
        """Where parameters may be scaled together only: their ratios to the first of them, with standard errors."""
        found: dict[str, tuple[float, float]] = {}
        x = self.found.x
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
            The data do not determine them; what they leave open of single experiments, offsets and sensors is
            no obstacle.
        """
        unknowns = self._estimation.unknowns
        self._check_determined("robot", [label for e in unknowns.entries if e.of_robot for label in e.labels])
        return unknowns.robot_at(self.found.x)

    @cached_property
    def homes(self) -> Homes:
        """The estimated offsets of the joints.

        Raises
        ------
        EstimationError
            The data do not determine them.
        """
        homes = self._estimation.unknowns.homes_at(self.found.x)
        self._check_determined("homes of the joints", homes.names)
        return homes

    def actuation(self, rotations: Any, translations: Any) -> Actuation:
        """The actuation of the calibrated robot at joints as they are read: with the estimated homes added.

        A force estimate with ``fit=`` accepts no other if ``"tubes[i].rotation_offset"`` or
        ``"tubes[i].translation_offset"`` were estimated.

        Parameters
        ----------
        rotations, translations
            One for each tube, rad and m, as in the experiments of the fit.

        Raises
        ------
        DefinitionError
            With its home, a tube's base is in front of the entry point.
        EstimationError
            The data do not determine the homes.

        Examples
        --------
        A rod whose rotation reads 0.1 rad too little:

        >>> import ctr_opt as ctr
        >>> rod = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)
        >>> tip = ctr.ForwardProblem(ctr.Robot([rod])).solve(ctr.Actuation([0.6], [0.0])).tip_position
        >>> seen = ctr.PositionMeasurement(None, tip, sigma=1e-4)
        >>> experiments = [ctr.Experiment(ctr.Actuation([0.5], [0.0]), [], [seen])]
        >>> fit = ctr.CalibrationProblem(ctr.Robot([rod]), experiments, ["tubes[0].rotation_offset"]).solve()
        >>> fit.actuation([0.5], [0.0]).rotations.round(6).tolist()
        [0.6]
        """
        return self.homes.actuation(rotations, translations)

    def _check_determined(self, what: str, labels: Iterable[str]) -> None:
        open_ones = [str(each) for each in self.undetermined if not each.parts.keys().isdisjoint(labels)]
        if open_ones:
            raise EstimationError(
                f"the data do not determine the {what}: {'; '.join(open_ones)}. Add measurements "
                "under load, priors, or estimate fewer parameters"
            )

    @cached_property
    def equilibria(self) -> list[Equilibrium]:
        """The experiments' equilibria with the estimated parameters."""
        return self._estimation.equilibria_of(self.found.x, "the estimates")

    # -- residuals ---------------------------------------------------------------------------------------------------

    @cached_property
    def residuals(self) -> list[Residual]:
        """Every block's misfit, predicted minus measured, by experiment."""
        unknowns, x = self._estimation.unknowns, self.found.x
        robot = unknowns.robot_at(x)
        found = []
        for k, (experiment, each) in enumerate(zip(self._estimation.experiments, self._linearized, strict=True)):
            ends = Ends.of_robot(robot, unknowns.experiment_at(x, k)[0].translations)
            start, places = 0, iter(each.places * ends.length)
            for j, measured in enumerate(experiment.measurements):
                (count, size), whitener = measured.shape, measured.whitener_for(self._estimation.loss)
                for i, one in enumerate(measured.observables[:count]):
                    value = np.linalg.solve(whitener[i], each.misfit[start : start + size])
                    place = one.place
                    s = float(next(places)) if isinstance(place, Somewhere) else arc_length_of(place, ends)
                    found.append(Residual(k, j, i, s, value))
                    start += size
        return found

    @cached_property
    def chi_squared(self) -> float:
        """Sum of the squared residuals over the given noise's variances, and of the deviations from priors over theirs.

        Where no noise level was given, in mm, mrad and so on.
        """
        priors = 2.0 * self._estimation.prior_cost(self.found.x)
        return float(sum(each.misfit @ each.misfit for each in self._linearized)) + priors

    @property
    def degrees_of_freedom(self) -> int:
        """Numbers measured, and known by priors, less parameters determined by them and arc lengths of points.

        An arc length that the entry point, the tip or another point's bounds is none that was estimated.
        """
        numbers = int(self._numbers.sum())
        numbers += int(np.isfinite(self._estimation.unknowns.prior[1]).sum())
        return int(max(numbers - self._determined.known.shape[1], 0))

    @cached_property
    def _numbers(self) -> NDArray[np.intp]:
        """Numbers that each experiment has for the parameters: those measured less arc lengths that they tell."""
        layouts = self._estimation.layouts
        return np.array(
            [
                len(each.misfit) - free(each.places, layout.blocks.orders).any(axis=0).sum()
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
        return p_value(self.chi_squared, self.degrees_of_freedom) if self._estimation.scaled else np.nan

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

        The sum of squares of an experiment against chi-square, with a noise level from the median experiment, but none
        below what the solves' accuracy leaves; flagged so seldom that good data have one in a hundred fits.
        """
        squares = np.array([each.misfit @ each.misfit for each in self._linearized])
        sizes = np.maximum(self._numbers, 1)
        level = np.maximum(np.median(squares / quantile(0.5, sizes)), self._inaccuracies**2)
        probabilities = tail(squares / level, sizes)
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

        Raises
        ------
        EstimationError
            The data do not determine the number, or with some value no answer was found.
        """
        from .refits import profile

        return profile(self, label, count, width)

    def without(self, experiments: Sequence[int] | int) -> Fit:
        """The fit to the other experiments, from here: leave one out, or a block, to hold it out.

        Raises
        ------
        EstimationError
            It found no answer.
        """
        from .refits import without

        return without(self, experiments)

    def errors_without(self, experiments: Sequence[int] | int) -> list[Residual]:
        """The residuals of experiments that a fit to the others predicts: a hold-out.

        Raises
        ------
        EstimationError
            The fit found no answer, or the experiments have no equilibrium with its estimates.
        """
        from .refits import errors_without

        return errors_without(self, experiments)

    def tested(self, experiments: Sequence[Experiment]) -> Fit:
        """The same estimates beside other experiments, as if they had been found from these: their residuals.

        Raises
        ------
        EstimationError
            The experiments have no equilibrium with the estimates.
        """
        from .refits import tested

        return tested(self, experiments, "the estimates")

    def bootstrap(self, repetitions: int = 200, *, seed: int = 0) -> Array:
        """Estimates from experiments drawn again with replacement, ``(repetitions, len(labels))``.

        Repetitions that find no answer, or do not determine what all experiments do, are left out, so that there are
        fewer rows, with an :class:`~ctr_opt.EstimationWarning`. Not a number where the data do not determine it.

        Raises
        ------
        EstimationError
            More than one repetition in twenty is of that kind: without them the others are no fair sample.
        """
        from .refits import bootstrap

        return bootstrap(self, repetitions, seed)

    # -- for people ------------------------------------------------------------------------------------------------

    def report(self) -> str:
        """Estimates with their errors, correlations, residuals, and what the data do not tell, as text."""
        from .report import fit_report

        return fit_report(self)

    def plot(self) -> Figure:
        """Histogram of the tip's errors, residuals along the robot, correlations and confidence ellipses."""
        from .plot import figure_fit

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
        return self._estimation.linearize(self.found.x, self.found.states)

    @property
    def _inaccuracies(self) -> Array:
        """Of each experiment's whitened misfits, from base moments that are as good as the tolerance."""
        estimation = self._estimation
        moments = [estimation.tolerance * unit for unit in estimation.units]
        found = [np.linalg.norm(each.misfit_z * z) for each, z in zip(self._linearized, moments, strict=True)]
        return np.hypot(found, _EXACT)

    @cached_property
    def _information(self) -> Information:
        return information(self._estimation, self._linearized)

    @cached_property
    def _determined(self) -> Determined:
        level = 1.0
        if self._estimation.loss == "squared" and not self._estimation.scaled:
            level = self.chi_squared / max(int(self._numbers.sum()) - len(self.found.x), 1)
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
