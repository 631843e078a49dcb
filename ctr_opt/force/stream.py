"""Loads on a robot from a stream of measured shapes: a moving horizon, warm-started, that survives what is missing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import count
from typing import Any

import attrs
import numpy as np

from ..calibration.fit import Fit
from ..checks import Array, array, number
from ..errors import DefinitionError, EstimationError, SolveError
from ..estimation.measurements import Measurement
from ..layout.ends import Ends
from ..loads.kind import Load
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from .case import Case, extent
from .estimation import Estimation
from .numbers import Numbered
from .reach import unreachable
from .search import Normal, Search, State
from .streamed import StreamedForce
from .unknown import UnknownLoad
from .window import Belief, Sample, Window

_CLOSE = 0.05  # of the moments' size: how far off an equilibrium a search may begin and not be blamed for it
_HARDLY = 0.9  # of misfits: where so much is left, to first order, no loads lead on
_PATIENCE = 30  # steps with misfits beyond an outlier's, of all searches for the loads in a sample
_ARRIVED = 1e-3  # standard deviations of the loads: samples are linearized anew from a hundredth on
_OPEN = 1e3  # characteristic sizes: standard deviation, to begin with, of numbers of which nothing is known


class ForceEstimator:
    """Follow the loads on a robot, sample by sample.

    The loads sought walk randomly, ``x(t + h) = x(t) + drift sqrt(h) n`` with standard normal ``n``. The last samples
    are estimated together, by Gauss-Newton steps; what earlier ones told is kept as a normal distribution, so that
    memory and time do not grow. Where everything is linear this is the Kalman filter.

    Parameters
    ----------
    robot
        The robot, calibrated.
    unknown
        What is sought, as in :class:`~ctr_opt.ForceEstimationProblem`.
    rate
        Samples in a second, Hz: where updates do not tell their time.
    drift
        How the loads change: standard deviation after a second, growing with the square root of time. A number: of
        forces, N/sqrt(s); or by field, ``{"force": 0.1, "moment": 1e-3}``, a number or one for each component, N, N m,
        or for an ``"arc_length"`` m, over sqrt(s).
    horizon
        How many samples are estimated together.
    prior
        Of forces, to begin with, as in :class:`~ctr_opt.ForceEstimationProblem`.
    fit
        The calibration that the robot is from: the errors of its parameters are counted among those of the loads.
    rotation_sigma, translation_sigma
        Standard deviations of the given actuation, the same error in all samples: numbers or one for each tube, rad and
        m. Default: it is exact.
    outlier
        Standard deviations, root mean square over a sample: one that is farther from every shape that the loads can
        give is left out.
    loss, tolerance, compiled
        As in :class:`~ctr_opt.ForceEstimationProblem`.

    Attributes
    ----------
    counts
        How many samples were ``"used"``, ``"late"``, ``"dropped"``, ``"too late"``, ``"left out"``.

    Raises
    ------
    DefinitionError
        Names the field, the value and what is allowed.
    EstimationError
        The fit leaves parameters of the robot open.

    Notes
    -----
    Errors of the actuation and of the calibration do not change from sample to sample. They are estimated with the
    samples of the horizon; what older ones told of them is not used, so that covariances stay as large as they leave
    them (Schmidt's filter).

    Examples
    --------
    A rod that is pushed harder and harder, with a sample missing:

    >>> import ctr_opt as ctr
    >>> rod = ctr.Robot([ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)])
    >>> held, stream = ctr.Actuation([0.0], [0.0]), ctr.ForceEstimator(rod, [ctr.TipForce()], rate=100.0, drift=1.0)
    >>> for push in (0.1, 0.12, None, 0.16):
    ...     if push is None:
    ...         found = stream.update(held)
    ...         continue
    ...     shape = ctr.ForwardProblem(rod).solve(held, [ctr.PointWrench([push, 0.0, 0.0])])
    ...     seen = ctr.PositionMeasurement([0.05, 0.1], shape.position([0.05, 0.1]), sigma=1e-5)
    ...     found = stream.update(held, seen)
    >>> bool(abs(found.force[0] - 0.16) < 1e-3), found.time, found.samples, stream.counts["dropped"]
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
        self._estimation = Estimation(
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
        """Take another sample; whatever becomes of it, tell what is known of the loads.

        Parameters
        ----------
        actuation
            Of the robot when it was measured; if the fit estimated homes of the joints, by ``fit.actuation``.
        measurements
            Any mix, each with its ``sigma``; None or an empty list: the sample was dropped.
        time
            When it was measured, s; default: a period of ``rate`` after the newest.
        loads
            Loads that are known.

        Raises
        ------
        DefinitionError
            A wrong call: another robot's actuation, or one without the homes of the fit, a measurement beyond the
            tip, a time that is no number. The estimator is as it was before.
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
        return self._told(self._clock, status, None if sample is None else sample.state)

    def _time(self, given: float | None) -> float:
        if given is not None:
            return number(given, "time", unit="s")
        return 0.0 if self._clock is None else self._clock + 1.0 / self.rate

    def _case(self, actuation: Actuation, measurements: Any, loads: Sequence[Load]) -> Case | None:
        """What is sought and seen; None where nothing is seen."""
        if measurements is None or (isinstance(measurements, Sequence) and not measurements):
            return None
        experiment, options = self._estimation.experiment(actuation, measurements, loads), self._estimation.options
        return self._estimation.case(experiment, self._errors.acting(self.robot, experiment), options[0])

    # -- one sample ------------------------------------------------------------------------------------------------

    def _sample(self, case: Case, time: float) -> Sample | None:
        """The loads that explain a sample, with what was predicted; None where none do."""
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
        state = state or self._anew(expected)
        if state is None or self._wild(free.search, state):
            return None
        nothing = _knowing(case, np.zeros(len(self._unit)), np.zeros((len(self._unit),) * 2))
        return Sample.of(time, case.experiment.actuation, nothing.search, self._unit, state)

    def _free(self, case: Case) -> Case:
        """The search for loads of which nothing is known, given up where none explain a sample."""
        k = self._loads
        sought = attrs.evolve(case.search.sought, prior_mean=np.zeros(k), prior_information=np.zeros((k, k)))
        search = attrs.evolve(case.search, sought=sought)
        based, steps = not self._errors.count, count()

        def hopeless(state: State) -> bool:
            off = _off(state)
            if off <= self.outlier:
                return False
            limit = len(state.misfit) * self.outlier**2
            if search.blocks.plain and unreachable(self.robot, case.experiment, case.ends, based) > limit:
                return True
            hardly = state.off < _CLOSE and _left(search, state) > max(self.outlier, _HARDLY * off)
            return hardly or next(steps) > _PATIENCE

        return attrs.evolve(case, search=attrs.evolve(search, hopeless=hopeless, arrived=_ARRIVED))

    def _jumped(self, expected: Search, free: Search, before: State) -> State | None:
        """By way of the loads that explain a sample best, whatever was predicted."""
        near = free.solve(before.z, before.x, before.places)
        if near is None or _off(near) > self.outlier:
            return None
        return expected.solve(near.z, near.x, near.places) or expected.at(near.z, near.x, near.places, near.e)

    def _anew(self, case: Case) -> State | None:
        """From the shape under the loads that were predicted or, failing that, as if it were the first sample."""
        try:
            if self._window.samples:
                shape = self._estimation.shape(case, case.start)
                state = case.search.solve(shape.unknowns, case.start, case.places(shape))
                if state is not None:
                    return state
            return next(iter(self._estimation.from_nothing(case)), None)
        except (SolveError, EstimationError):
            return None

    def _wild(self, free: Search, state: State) -> bool:
        """Whether a sample is off whatever the loads, those included that nobody would expect."""
        if _off(state) <= self.outlier:
            return False
        found = free.solve(state.z, state.x, state.places)
        return found is None or _off(found) > self.outlier

    def _told(self, time: float, status: str, state: State | None) -> StreamedForce:
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
            np.array([each.time for each in window.samples]),
            np.reshape(window.means, (-1, len(self._unit)))[:, :k] * unit,
            self._numbered,
        )


def _followed(unknown: tuple[UnknownLoad, ...]) -> tuple[UnknownLoad, ...]:
    """Unknown loads that a stream can follow: those of as many numbers in every sample."""
    for k, each in enumerate(unknown):
        if not each.steady:
            raise DefinitionError(f"unknown[{k}] = {each!r} cannot be followed: it must be a force or a wrench")
        if each.cone is not None:
            raise DefinitionError(f"unknown[{k}].friction = {each.cone[1]:g} cannot be followed: it must be None")
        if each.bounds is not None:
            raise DefinitionError(f"unknown[{k}].bounds = {each.bounds!r} cannot be kept in a stream: give a prior")
    return unknown


def _count(horizon: Any) -> int:
    if number(horizon, "horizon", least=1.0) % 1.0:
        raise DefinitionError(f"horizon = {horizon!r} must be a whole number of samples, at least 1")
    return int(horizon)


def _knowing(case: Case, mean: Array, information: Array) -> Case:
    """A case with such knowledge of loads and errors together."""
    sought, k = case.search.sought, len(case.search.sought.scale)
    sought = attrs.evolve(
        sought, prior_mean=mean[:k], prior_information=information[:k, :k], together=(mean, information)
    )
    return attrs.evolve(case, search=attrs.evolve(case.search, sought=sought))


def _well_begun(case: Case, before: State) -> bool:
    """Whether the sample before was so close to this equilibrium that no other start would lead further.

    Never where places are estimated: of contacts, or of points, which need not be those of the sample before.
    """
    if case.contacts or case.search.blocks.places:
        return False
    at = case.search.at(before.z, case.start, before.places, before.e)
    return at is not None and at.off < _CLOSE


def _off(state: State) -> float:
    """Root mean square of the misfits, as the loss counts them, standard deviations."""
    return float(np.sqrt(state.weights @ state.misfit**2 / len(state.misfit)))


def _left(free: Search, state: State) -> float:
    """What any loads would leave of the misfits, to first order: root mean square, as the loss counts them."""
    normal = Normal.of(free, state)
    won = -float(normal.gradient @ np.concatenate(normal.step(state, 0.0)))
    known = float(state.weights @ state.misfit**2 + state.e @ state.e)
    return float(np.sqrt(max(known - won, 0.0) / len(state.misfit)))


def _before(numbered: Numbered, unit: Array) -> Belief:
    """What is known before the first sample, in units."""
    mean, information = np.zeros(len(unit)), np.zeros((len(unit), len(unit)))
    errors = slice(len(numbered.labels), len(unit))
    information[errors, errors] = np.eye(len(unit))[errors, errors]
    for part, each in zip(numbered.parts, numbered.unknown, strict=True):
        known = each.known_before
        if known is not None:
            mean[part], information[part, part] = known.mean, known.information
    information = information * np.outer(unit, unit)
    open_ = np.diag(information) == 0.0
    covariance = np.linalg.inv(information + np.diag(np.where(open_, _OPEN**-2, 0.0)))
    return Belief(mean / unit, covariance, len(unit) - len(numbered.labels))


def _drift(given: Any, numbered: Numbered) -> Array:
    """Standard deviations after a second, SI."""
    fields = {number.field: number.size for each in numbered.unknown for number in each.sought}
    forces = [field for field in fields if field.endswith("force")]
    by_field = given if isinstance(given, Mapping) else dict.fromkeys(forces, given)
    if set(by_field) != set(fields):
        raise DefinitionError(f"drift = {given!r} must tell that of {' and '.join(fields)}: a mapping of these")
    found = np.empty(len(numbered.labels))
    for field, size in fields.items():
        value = np.broadcast_to(
            array(by_field[field], f"drift[{field!r}]", (None,) * np.ndim(by_field[field])), (size,)
        )
        if not (value > 0.0).all():
            raise DefinitionError(f"drift[{field!r}] = {by_field[field]!r} must be positive")
        for part in numbered.where(field):
            found[part] = value
    return found
