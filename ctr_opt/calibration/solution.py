"""CalibrationSolution of a calibration: values with standard errors, residuals and undetermined directions."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Any

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array, freezing, frozen
from ..errors import EstimationError
from ..estimation.chi_square import p_value, quantile, tail
from ..estimation.linearized import Linearized
from ..estimation.measurements.kind import POINTS, Measurement
from ..estimation.places import free
from ..forward.equilibrium import Equilibrium
from ..layout.ends import Ends
from ..layout.observables import Observable, Somewhere, arc_length_of
from ..robot.names import symbol
from ..robot.robot import Robot
from .estimation import Estimation
from .homes import Homes
from .reduced import FitPoint
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

REJECTED = 1e-3  # p-value of the residuals' chi-square below which the given noise level is rejected
_EXACT = 1e-5  # of the noise level (1 mm, 1 mrad, ... if none was given): residuals of computed data
_OUTLIER = 0.01  # probability that any experiment of good data is flagged


@attrs.frozen(eq=False)
class Residual:
    """The misfit of one measured block (a point, a pose): predicted minus measured value, SI, and its place."""

    experiment: int
    measurement: int
    block: int
    """Index of the block in its measurement, such as the number of a point."""

    arc_length: float
    """Arc length of the measurement at the estimates, m; the estimate if it was unknown."""

    value: Array = attrs.field(converter=freezing)
    measured: Measurement = attrs.field(repr=False)

    @property
    def observable(self) -> Observable:
        """The observable that was measured, with its place."""
        return self.measured.observables[self.block]

    @property
    def is_point(self) -> bool:
        """Whether the residual belongs to a measured point."""
        return POINTS in self.measured.parts

    @property
    def size(self) -> float:
        """Norm of the residual, SI; for a position the distance, m."""
        return float(np.linalg.norm(self.value))

    @property
    def distance(self) -> float:
        """Distance between predicted and measured point of a position or pose, m."""
        return float(np.linalg.norm(self.value[:3]))

    @property
    def angle(self) -> float:
        """Angle between predicted and measured axis or frame of a tangent or pose, rad."""
        return float(np.linalg.norm(self.value[-3:]))


class CalibrationSolution:
    """CalibrationSolution of a calibration: numbers with errors, residuals and undetermined directions."""

    def __init__(self, estimation: Estimation, outcome: FitPoint, method: str) -> None:
        self.estimation = estimation
        self.outcome = outcome
        self.method = method
        self.names = [entry.name for entry in estimation.unknowns.entries]
        self.labels = estimation.unknowns.labels
        self.iterations = outcome.iterations
        self.objective = estimation.cost(self._linearized) + estimation.prior_cost(outcome.x)

    # -- estimates -------------------------------------------------------------------------------------------------

    @cached_property
    def values(self) -> dict[str, Any]:
        """Estimates by name, SI, floats or arrays; not a number if undetermined."""
        return self.estimation.unknowns.values(self.estimates)

    @cached_property
    def estimates(self) -> Array:
        """Estimates in the order of :attr:`labels`, SI; not a number if undetermined."""
        return frozen(np.where(self._open, np.nan, self.outcome.x))

    @cached_property
    def deviations(self) -> Array:
        """Standard errors in the order of :attr:`labels`, SI; infinite if undetermined."""
        return frozen(np.sqrt(np.diag(self.covariance)))

    @cached_property
    def standard_errors(self) -> dict[str, Any]:
        """Standard errors of the estimates by name, SI, floats or arrays; infinite if undetermined."""
        return self.estimation.unknowns.values(self.deviations)

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the numbers of :attr:`labels`, SI; infinite variances if undetermined.

        It uses the given noise level, or the level of the residuals if they reject the given one (see
        :attr:`p_value`). For robust losses it is the sandwich ``H^-1 S H^-1`` of Hessian and scatter of gradients.
        """
        return self._of_noise(self._level)

    @cached_property
    def covariance_assumed(self) -> Array:
        """Covariance of the numbers of :attr:`labels`, SI, at the given noise level."""
        return self._of_noise(1.0)

    @cached_property
    def covariance_estimated(self) -> Array:
        """Covariance of the numbers of :attr:`labels`, SI, at the noise level of the residuals."""
        return self._of_noise(self.noise)

    @cached_property
    def correlation(self) -> Array:
        """Correlations of the numbers of :attr:`labels`; not a number if undetermined."""
        known = np.isfinite(self.deviations) & (self.deviations > 0.0)
        deviations = np.where(known, self.deviations, np.nan)
        return frozen(self.covariance / np.outer(deviations, deviations))

    @cached_property
    def undetermined(self) -> list[Direction]:
        """Directions that the data do not determine, with descriptions; empty if all is determined."""
        unknowns = self.estimation.unknowns
        return directions(self._determined, self.labels, self.outcome.x, unknowns.scale)

    @property
    def vague(self) -> list[str]:
        """Labels of numbers whose standard error exceeds their scale, but which are determined."""
        relative = self.deviations / self.estimation.unknowns.scale
        return [label for label, one in zip(self.labels, relative, strict=True) if VAGUE < one < np.inf]

    @cached_property
    def ratios(self) -> dict[str, tuple[float, float]]:
        """Ratios of parameters that only have a common undetermined factor, with standard errors."""
        ratios: dict[str, tuple[float, float]] = {}
        x = self.outcome.x
        for direction in self.undetermined:
            names = list(direction.parts)
            numbers = [self.labels.index(name) for name in names]
            if len(numbers) < 2 or not is_factor(names, np.array(list(direction.parts.values())) / x[numbers]):
                continue
            first = numbers[0]
            for k in numbers[1:]:
                contrast = np.zeros(len(x))
                contrast[k], contrast[first] = 1.0 / x[k], -1.0 / x[first]
                ratio = float(x[k] / x[first])
                error = ratio * float(np.sqrt(contrast @ self._known_covariance @ contrast))
                ratios[f"{symbol(self.labels[k])} / {symbol(self.labels[first])}"] = ratio, error
        return ratios

    @property
    def condition(self) -> float:
        """Condition number of the information matrix, in the parameters' scales."""
        return self._determined.condition

    @cached_property
    def robot(self) -> Robot:
        """The robot with the estimated parameters.

        Raises
        ------
        EstimationError
            The data do not determine the robot's parameters. Undetermined numbers of experiments, offsets and sensors
            are allowed.
        """
        unknowns = self.estimation.unknowns
        self._check_determined("robot", [label for e in unknowns.entries if e.of_robot for label in e.labels])
        return unknowns.robot_at(self.outcome.x)

    @cached_property
    def homes(self) -> Homes:
        """The estimated offsets of the joints.

        Raises
        ------
        EstimationError
            The data do not determine the offsets.
        """
        homes = self.estimation.unknowns.homes_at(self.outcome.x)
        self._check_determined("homes of the joints", homes.names)
        return homes

    def _check_determined(self, what: str, labels: Iterable[str]) -> None:
        open_ones = [str(one) for one in self.undetermined if not one.parts.keys().isdisjoint(labels)]
        if open_ones:
            raise EstimationError(
                f"the data do not determine the {what}: {'; '.join(open_ones)}. Add measurements "
                "under load or priors, or estimate fewer parameters"
            )

    @cached_property
    def equilibria(self) -> list[Equilibrium]:
        """The experiments' equilibria with the estimated parameters."""
        return self.estimation.equilibria_of(self.outcome.x, "the estimates")

    # -- residuals ---------------------------------------------------------------------------------------------------

    @cached_property
    def residuals(self) -> list[Residual]:
        """Residuals of all measured blocks, predicted minus measured, in the order of the experiments."""
        unknowns, x = self.estimation.unknowns, self.outcome.x
        robot = unknowns.robot_at(x)
        residuals = []
        for k, (experiment, here) in enumerate(zip(self.estimation.experiments, self._linearized, strict=True)):
            ends = Ends.of_robot(robot, unknowns.experiment_at(x, k)[0].translations)
            misfits = iter(np.split(here.misfit, self.estimation.layouts[k].blocks.starts[1:]))
            places = iter(here.places * ends.length)
            for j, measured in enumerate(experiment.measurements):
                for i, whitener in enumerate(measured.whitener_for(self.estimation.loss)):
                    place = measured.observables[i].place
                    s = float(next(places)) if isinstance(place, Somewhere) else arc_length_of(place, ends)
                    residuals.append(Residual(k, j, i, s, np.linalg.solve(whitener, next(misfits)), measured))
        return residuals

    @cached_property
    def chi_squared(self) -> float:
        """Sum of squared residuals and squared deviations from priors, each over its variance.

        Without a given noise level, residuals are in mm, mrad and so on.
        """
        priors = 2.0 * self.estimation.prior_cost(self.outcome.x)
        return float(sum(one.misfit @ one.misfit for one in self._linearized)) + priors

    @property
    def degrees_of_freedom(self) -> int:
        """Number of measured values and priors, minus the number of determined parameters and arc lengths.

        An arc length at the entry point, at the tip or pooled with another point does not count as estimated.
        """
        numbers = int(self._numbers.sum())
        numbers += int(np.isfinite(self.estimation.unknowns.prior[1]).sum())
        return int(max(numbers - self._determined.known.shape[1], 0))

    @cached_property
    def _numbers(self) -> NDArray[np.intp]:
        """Measured numbers of each experiment minus its estimated arc lengths."""
        layouts = self.estimation.layouts
        return np.array(
            [
                len(here.misfit) - free(here.places, layout.blocks.orders).any(axis=0).sum()
                for layout, here in zip(layouts, self._linearized, strict=True)
            ]
        )

    @property
    def noise(self) -> float:
        """Noise level of the residuals over the given level; not a number without degrees of freedom."""
        freedom = self.degrees_of_freedom
        return float(np.sqrt(self.chi_squared / freedom)) if freedom else np.nan

    @property
    def p_value(self) -> float:
        """Probability of residuals at least this large at the given noise level; not a number if none was given."""
        return p_value(self.chi_squared, self.degrees_of_freedom) if self.estimation.scaled else np.nan

    @property
    def noise_accepted(self) -> bool:
        """Whether a noise level was given and the residuals do not reject it (at 1e-3)."""
        return self.estimation.scaled and not self.p_value < REJECTED

    # -- single experiments --------------------------------------------------------------------------------------------

    @cached_property
    def influence(self) -> Array:
        """Influence of each experiment on the estimates, ``(experiments,)``: Cook's distance from one Newton step.

        This is the squared change of the estimates without the experiment, in standard errors, over their number.
        """
        known = self._determined.known
        full = known.T @ (self._information.curvature + self._information.prior) @ known
        inverse = np.linalg.inv(known.T @ self._scaled(self._level) @ known)
        influence = []
        for of_one, gradient in zip(self._information.each, self._information.gradients, strict=True):
            step = np.linalg.lstsq(full - known.T @ of_one @ known, known.T @ gradient, rcond=None)[0]
            influence.append(step @ inverse @ step / max(known.shape[1], 1))
        return frozen(np.array(influence))

    @cached_property
    def outliers(self) -> list[int]:
        """Numbers of the experiments whose residuals are much larger than those of the others.

        An experiment's sum of squares is tested against chi-square. The noise level is that of the median experiment,
        and at least the accuracy of the solves. With good data one fit in a hundred flags an experiment.
        """
        squares = np.array([one.misfit @ one.misfit for one in self._linearized])
        sizes = np.maximum(self._numbers, 1)
        level = np.maximum(np.median(squares / quantile(0.5, sizes)), self._inaccuracies**2)
        probabilities = tail(squares / level, sizes)
        return [int(k) for k in np.flatnonzero(probabilities < _OUTLIER / len(sizes))]

    # -- internals ---------------------------------------------------------------------------------------------------

    @cached_property
    def _linearized(self) -> list[Linearized]:
        if not self.estimation.prepared:
            self.estimation.prepare(self.equilibria)
        return self.estimation.linearize(self.outcome.x, self.outcome.states)

    @property
    def _inaccuracies(self) -> Array:
        """Errors of each experiment's whitened misfits due to the tolerance of its base moments."""
        pairs = zip(self._linearized, self.estimation.units, strict=True)
        inaccuracies = [self.estimation.tolerance * np.linalg.norm(here.misfit_z * unit) for here, unit in pairs]
        return np.hypot(inaccuracies, _EXACT)

    @cached_property
    def _information(self) -> Information:
        return information(self.estimation, self._linearized)

    @cached_property
    def _determined(self) -> Determined:
        level = 1.0
        if self.estimation.loss == "squared" and not self.estimation.scaled:
            level = self.chi_squared / max(int(self._numbers.sum()) - len(self.outcome.x), 1)
        return determined(self._information.matrix / max(level, 1e-12) + self._information.prior)

    @property
    def _open(self) -> Any:
        return taking_part(self._determined)

    def _of_noise(self, noise: float | None) -> Array:
        """Covariance for a noise level, or the sandwich for None; infinite where undetermined."""
        scale, undetermined = self.estimation.unknowns.scale, np.flatnonzero(self._open)
        values = self._scaled(noise) * np.outer(scale, scale)
        values[undetermined, :] = values[:, undetermined] = np.nan
        values[undetermined, undetermined] = np.inf
        return frozen(values)

    def _scaled(self, noise: float | None) -> Array:
        parts, known = self._information, self._determined.known
        if noise is None:
            return covariance(parts.curvature + parts.prior, known, parts.scatter + parts.prior)
        return covariance(parts.matrix / noise**2 + parts.prior, known)

    @property
    def _level(self) -> float | None:
        """The noise level for the covariance; None for robust losses, which use the scatter of gradients."""
        if self.estimation.loss != "squared":
            return None
        return 1.0 if self.noise_accepted else self.noise

    @property
    def _known_covariance(self) -> Array:
        """Covariance of the parameters within the determined subspace, SI."""
        scale = self.estimation.unknowns.scale
        return self._scaled(self._level) * np.outer(scale, scale)
