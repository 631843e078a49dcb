"""Loads from a stream of measured shapes: a warm-started moving horizon that tolerates missing samples."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import count
from typing import Any

import attrs
import numpy as np

from ..calibration.fit import Fit
from ..checks import Array, array, dimensions, number, whole
from ..errors import DefinitionError, EstimationError, SolveError
from ..estimation.measurements import Measurement
from ..layout.ends import Ends
from ..loads.kind import Load
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from .case import Case, extent
from .estimation import ForceEstimation
from .numbers import Numbered
from .reach import unreachable
from .search import Normal, Search, SearchState
from .streamed import StreamedForce
from .unknown import UnknownLoad
from .window import Belief, Window, WindowSample

_CLOSE = 0.05  # of the moments' size: a start closer to equilibrium than this is not why a search fails
_HARDLY = 0.9  # of misfits: if the best loads leave more, to first order, the search is hopeless
_PATIENCE = 30  # steps beyond the outlier threshold, over all searches of one sample
_ARRIVED = 1e-3  # standard deviations of the loads: the window linearizes again from a hundredth on
_OPEN = 1e3  # characteristic sizes: initial standard deviation of numbers without a prior


class ForceEstimator:
    """Estimate the loads on a robot sample by sample, with a moving horizon.

    The unknown loads follow a random walk, ``x(t + h) = x(t) + drift sqrt(h) n`` with standard normal ``n``. The last
    samples are estimated together by Gauss-Newton steps. Earlier samples are summarized by a normal distribution, so
    that memory and time per sample stay constant. For a linear problem this is the Kalman filter.

    Parameters
    ----------
    robot
        The robot, calibrated.
    unknown
        The unknown loads, as in :class:`~ctr_opt.ForceEstimationProblem`.
    rate
        Sampling rate, Hz, for updates without a time.
    drift
        Standard deviation of the loads' change after one second; it grows with the square root of time. A number is
        for forces, N/sqrt(s). A mapping gives each field, ``{"force": 0.1, "moment": 1e-3}``, a number or one for each
        component: forces in N/sqrt(s), moments in N m/sqrt(s), ``"arc_length"`` in m/sqrt(s).
    horizon
        Number of samples that are estimated together.
    prior
        Initial mean and standard deviation of forces, N, as in :class:`~ctr_opt.ForceEstimationProblem`.
    fit
        The calibration of the robot. The covariance of the loads then includes the errors of its parameters.
    rotation_sigma, translation_sigma
        Standard deviations of the actuation, rad and m: a number, or one for each tube. The error is the same in all
        samples. Default: the actuation is exact.
    outlier
        Root-mean-square misfit, standard deviations, above which a sample is left out because no loads explain it.
    loss, tolerance, compiled
        Loss, tolerance and use of compiled code, as in :class:`~ctr_opt.ForceEstimationProblem`.

    Attributes
    ----------
    counts
        Number of samples by status: ``"used"``, ``"late"``, ``"dropped"``, ``"too late"``, ``"left out"``.

    Raises
    ------
    DefinitionError
        The message names the field, the value and what is allowed.
    EstimationError
        The fit does not determine all parameters of the robot.

    Notes
    -----
    Errors of the actuation and of the calibration do not change from sample to sample. They are estimated with the
    samples of the horizon. Information of older samples about them is discarded, so that covariances stay conservative
    (Schmidt's filter).

    Examples
    --------
    A rod under a growing force, with one missing sample:

    >>> import ctr_opt as ctr
    >>> rod = ctr.Robot([ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)])
    >>> held, stream = ctr.Actuation([0.0], [0.0]), ctr.ForceEstimator(rod, [ctr.TipForce()], rate=100.0, drift=1.0)
    >>> for push in (0.1, 0.12, None, 0.16):
    ...     if push is None:
    ...         load = stream.update(held)
    ...         continue
    ...     shape = ctr.ForwardProblem(rod).solve(held, [ctr.PointWrench([push, 0.0, 0.0])])
    ...     seen = ctr.PositionMeasurement([0.05, 0.1], shape.position([0.05, 0.1]), sigma=1e-5)
    ...     load = stream.update(held, seen)
    >>> bool(abs(load.force[0] - 0.16) < 1e-3), load.time, load.samples, stream.counts["dropped"]
    (True, 0.03, 3, 1)
    """

    def __init__(
        self,
        robot: Robot,
        unknown: UnknownLoad | Sequence[UnknownLoad],
        *,
        rate: float,
        drift: Any,
        horizon: int = 5,
        prior: Any = None,
        fit: Fit | None = None,
        rotation_sigma: Any = None,
        translation_sigma: Any = None,
        outlier: float = 30.0,
        loss: str = "squared",
        tolerance: float = 1e-7,
        compiled: bool | None = None,
    ) -> None:
        self._estimation = ForceEstimation(
            robot, unknown, prior, loss, rotation_sigma, translation_sigma, tolerance, compiled
        )
        self.robot = robot
        self.rate = number(rate, "rate", above=0.0, unit="Hz")
        self.horizon = _count(horizon)
        self.outlier = number(outlier, "outlier", above=0.0)
        self.counts: Counter[str] = Counter()
        self._numbered = Numbered.of(_followed(self._estimation.unknown), 0)
        self._errors = self._estimation.errors(fit)
        self._homes = None if fit is None else fit.homes
        scale = extent(robot, self._numbered, Ends.of_robot(robot, np.zeros(len(robot.tubes))))[0]
        walk = np.append(_drift(drift, self._numbered) / scale, np.zeros(self._errors.count))
        self._loads = len(scale)
        self._unit = np.append(scale, np.ones(self._errors.count))
        self._window = Window(_before(self._numbered, self._unit), np.diag(walk**2), self.horizon)
        self._clock: float | None = None

    def update(
        self,
        actuation: Actuation,
        measurements: Measurement | Sequence[Measurement] | None = None,
        time: float | None = None,
        loads: Sequence[Load] = (),
    ) -> StreamedForce:
        """Process one sample and return the current estimate of the loads.

        Parameters
        ----------
        actuation
            Actuation during the measurement; from ``fit.actuation`` if the fit estimated homes of the joints.
        measurements
            One measurement or a list of any kinds, each with its ``sigma``. None or an empty list: the sample was
            dropped.
        time
            Time of the measurement, s. Default: one period of ``rate`` after the newest sample.
        loads
            Known loads, such as gravity.

        Returns
        -------
        StreamedForce
            Estimate at the newest time, also if the sample was dropped or left out.

        Raises
        ------
        DefinitionError
            An argument is invalid: the actuation does not fit the robot or lacks the homes of the fit, a measurement is
            beyond the tip, or the time is not a number. The estimator is unchanged.
        """
        time = self._time(time)
        if self._homes is not None:
            self._homes.check(actuation)
        case = self._case(actuation, measurements, loads)
        sample = None
        if case is None:
            status = "dropped"
        elif time < self._window.since:
            status = "too late"
        else:
            sample = self._sample(case, time)
            late = self._clock is not None and time < self._clock
            status = "left out" if sample is None else "late" if late else "used"
        if sample is not None:
            self._window.add(sample)
        self._clock = time if self._clock is None else max(time, self._clock)
        self.counts[status] += 1
        return self._result(self._clock, status, None if sample is None else sample.state)

    def _time(self, time: float | None) -> float:
        if time is not None:
            return number(time, "time", unit="s")
        return 0.0 if self._clock is None else self._clock + 1.0 / self.rate

    def _case(self, actuation: Actuation, measurements: Any, loads: Sequence[Load]) -> Case | None:
        """The case of one sample; None without measurements."""
        if measurements is None or (isinstance(measurements, Sequence) and not measurements):
            return None
        experiment, options = self._estimation.experiment(actuation, measurements, loads), self._estimation.options
        return self._estimation.case(experiment, self._errors.acting(self.robot, experiment), options[0])

    # -- one sample ------------------------------------------------------------------------------------------------

    def _sample(self, case: Case, time: float) -> WindowSample | None:
        """The sample with the loads that explain it, given the prediction; None if no loads do."""
        predicted = self._window.predicted(time)
        free = self._free(case)
        information = np.linalg.inv(predicted.covariance) / np.outer(self._unit, self._unit)
        expected = _knowing(free, predicted.mean * self._unit, information)
        before = self._window.nearest(time)
        state = None
        if before is not None and len(before.places) == case.search.blocks.places:
            state = expected.search.solve(before.z, expected.start, before.places)
            if state is None and _well_begun(expected, before):
                state = self._jumped(expected.search, free.search, before)
                if state is None:
                    return None
        state = state or self._restarted(expected)
        if state is None or self._wild(free.search, state):
            return None
        nothing = _knowing(case, np.zeros(len(self._unit)), np.zeros((len(self._unit),) * 2))
        return WindowSample.of(time, case.experiment.actuation, nothing.search, self._unit, state)

    def _free(self, case: Case) -> Case:
        """A search without prior, which stops early if no loads can explain the sample."""
        k = self._loads
        unknowns = attrs.evolve(case.search.unknowns, prior_mean=np.zeros(k), prior_information=np.zeros((k, k)))
        search = attrs.evolve(case.search, unknowns=unknowns)
        based, steps = not self._errors.count, count()

        def hopeless(state: SearchState) -> bool:
            off = _off(state)
            if off <= self.outlier:
                return False
            limit = len(state.misfit) * self.outlier**2
            if search.blocks.plain and unreachable(self.robot, case.experiment, case.ends, based) > limit:
                return True
            hardly = state.off < _CLOSE and _left(search, state) > max(self.outlier, _HARDLY * off)
            return hardly or next(steps) > _PATIENCE

        return attrs.evolve(case, search=attrs.evolve(search, hopeless=hopeless, arrived=_ARRIVED))

    def _jumped(self, expected: Search, free: Search, before: SearchState) -> SearchState | None:
        """Search via the loads that explain the sample best without the prediction."""
        near = free.solve(before.z, before.x, before.places)
        if near is None or _off(near) > self.outlier:
            return None
        return expected.solve(near.z, near.x, near.places) or expected.at(near.z, near.x, near.places, near.e)

    def _restarted(self, case: Case) -> SearchState | None:
        """Search from the shape under the predicted loads; if that fails, as for a first sample."""
        try:
            if self._window.samples:
                shape = self._estimation.shape(case, case.start)
                state = case.search.solve(shape.unknowns, case.start, case.places(shape))
                if state is not None:
                    return state
            return next(iter(self._estimation.from_nothing(case)), None)
        except (SolveError, EstimationError):
            return None

    def _wild(self, free: Search, state: SearchState) -> bool:
        """Whether a sample is an outlier for all loads, however unlikely."""
        if _off(state) <= self.outlier:
            return False
        best = free.solve(state.z, state.x, state.places)
        return best is None or _off(best) > self.outlier

    def _result(self, time: float, status: str, state: SearchState | None) -> StreamedForce:
        window, k = self._window, self._loads
        belief, unit = window.predicted(time), self._unit[:k]
        return StreamedForce(
            time,
            status,
            self._numbered.labels,
            belief.mean[:k] * unit,
            belief.covariance[:k, :k] * np.outer(unit, unit),
            np.nan if state is None else 2.0 * state.cost,
            0 if state is None else len(state.misfit) - len(state.places),
            np.array([sample.time for sample in window.samples]),
            np.reshape(window.means, (-1, len(self._unit)))[:, :k] * unit,
            self._numbered,
        )


def _followed(unknown: tuple[UnknownLoad, ...]) -> tuple[UnknownLoad, ...]:
    """Check that a stream can follow the unknown loads: steady numbers, no friction, no bounds."""
    for k, load in enumerate(unknown):
        if not load.steady:
            raise DefinitionError(f"unknown[{k}] = {load!r} is not supported in a stream; use a force or a wrench")
        if load.cone is not None:
            raise DefinitionError(f"unknown[{k}].friction = {load.cone[1]:g} is not supported in a stream; use None")
        if load.bounds is not None:
            raise DefinitionError(f"unknown[{k}].bounds = {load.bounds!r} is not supported in a stream; give a prior")
    return unknown


def _count(horizon: Any) -> int:
    return whole(horizon, "horizon", 1)


def _knowing(case: Case, mean: Array, information: Array) -> Case:
    """The case with a joint prior of loads and errors."""
    unknowns, k = case.search.unknowns, len(case.search.unknowns.scale)
    unknowns = attrs.evolve(
        unknowns, prior_mean=mean[:k], prior_information=information[:k, :k], together=(mean, information)
    )
    return attrs.evolve(case, search=attrs.evolve(case.search, unknowns=unknowns))


def _well_begun(case: Case, before: SearchState) -> bool:
    """Whether the previous sample is so close to this equilibrium that another start cannot help.

    Never if places of contacts or points are estimated: they may differ from those of the previous sample.
    """
    if case.contacts or case.search.blocks.places:
        return False
    at = case.search.at(before.z, case.start, before.places, before.e)
    return at is not None and at.off < _CLOSE


def _off(state: SearchState) -> float:
    """Root mean square of the misfits, as the loss counts them, standard deviations."""
    return float(np.sqrt(state.weights @ state.misfit**2 / len(state.misfit)))


def _left(free: Search, state: SearchState) -> float:
    """Root mean square of the misfits that the best loads leave, to first order, as the loss counts them."""
    normal = Normal.of(free, state)
    won = -float(normal.gradient @ np.concatenate(normal.step(state, 0.0)))
    known = float(state.weights @ state.misfit**2 + state.e @ state.e)
    return float(np.sqrt(max(known - won, 0.0) / len(state.misfit)))


def _before(numbered: Numbered, unit: Array) -> Belief:
    """The belief before the first sample, in units."""
    mean, information = np.zeros(len(unit)), np.zeros((len(unit), len(unit)))
    errors = slice(len(numbered.labels), len(unit))
    information[errors, errors] = np.eye(len(unit))[errors, errors]
    for part, load in zip(numbered.parts, numbered.unknown, strict=True):
        known = load.known_before
        if known is not None:
            mean[part], information[part, part] = known.mean, known.information
    information = information * np.outer(unit, unit)
    open_ = np.diag(information) == 0.0
    covariance = np.linalg.inv(information + np.diag(np.where(open_, _OPEN**-2, 0.0)))
    return Belief(mean / unit, covariance, len(unit) - len(numbered.labels))


def _drift(drift: Any, numbered: Numbered) -> Array:
    """Standard deviations after one second, SI."""
    fields = {number.field: number.size for load in numbered.unknown for number in load.unknown_numbers}
    forces = [field for field in fields if field.endswith("force")]
    by_field = drift if isinstance(drift, Mapping) else dict.fromkeys(forces, drift)
    if set(by_field) != set(fields):
        raise DefinitionError(f"drift = {drift!r} must be a mapping with the keys {' and '.join(fields)}")
    deviations = np.empty(len(numbered.labels))
    for field, size in fields.items():
        several = dimensions(by_field[field]) > 0
        value = array(by_field[field], f"drift[{field!r}]", (size,) if several else ())
        if not (value > 0.0).all():
            raise DefinitionError(f"drift[{field!r}] = {by_field[field]!r} must be positive")
        for part in numbered.where(field):
            deviations[part] = value
    return deviations
