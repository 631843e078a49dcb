"""Intrinsic force estimation: what presses on a robot, from its shape (paper, sections I and IV)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, product
from typing import Any, cast

import attrs
import numpy as np

from ..calibration.fit import Fit
from ..checks import Array, array, choice, flag, index, number
from ..errors import DefinitionError, EstimationError, SolveError
from ..estimation.experiment import Experiment
from ..estimation.losses import LOSSES
from ..estimation.measurements import Measurement
from ..forward.equilibrium import Equilibrium
from ..forward.problem import ForwardProblem
from ..layout.ends import Ends
from ..loads.kind import Load
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from .case import Case, Errors
from .contact_number import Contacts, Evidence
from .contact_profile import Profile
from .contact_search import contacts
from .distributed import DistributedForce
from .estimate import ForceEstimate
from .friction import within_cone
from .search import State
from .smoothness import smoothest
from .unknown import PointForce, TipForce, TipWrench, UnknownLoad

UNKNOWN_LOADS = (TipForce, TipWrench, PointForce, DistributedForce, Contacts)
_SAME = 1e-4  # of the loads' scales: solutions closer to each other are one
_SEED = 0
_MORE = 2  # times as many steps as without the unknown loads, in the virtual machine
_MODELS = 8  # kept, of measurements at different places


class ForceEstimationProblem:
    """Find the loads that explain a robot's measured shape, and how well the shape determines them.

    Parameters
    ----------
    robot
        The robot, calibrated.
    unknown
        What is sought: :class:`TipForce`, :class:`TipWrench`, :class:`PointForce`, :class:`DistributedForce`, one or
        several, and :class:`Contacts` whose number is unknown.
    prior
        Mean and standard deviation of the forces, N, known before, of those unknown loads that have none of their own.
    loss
        ``"squared"`` for normal errors; ``"huber"`` or ``"cauchy"`` where points may be outliers; ``"distance"``.
    rotation_sigma, translation_sigma
        Standard deviations of the given actuation: numbers or one for each tube, rad and m. Default: it is exact.
    tolerance
        Of the forward solves, as in :class:`~ctr_opt.ForwardProblem`.
    compiled
        As in :class:`~ctr_opt.CalibrationProblem`.
    starts
        From how many the search sets out, where loads may be large enough for several answers: the first from the
        prior's mean, others (seeded) around it.

    Raises
    ------
    DefinitionError
        Names the field, the value and what is allowed.

    Examples
    --------
    The force at the tip of a rod from its position and direction:

    >>> import ctr_opt as ctr
    >>> rod = ctr.Robot([ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)])
    >>> held = ctr.Actuation([0.0], [0.0])
    >>> pushed = ctr.ForwardProblem(rod).solve(held, [ctr.PointWrench([0.2, 0.1, 0.0])])
    >>> seen = ctr.PositionMeasurement([0.05, 0.1], pushed.position([0.05, 0.1]), sigma=1e-4)
    >>> estimate = ctr.ForceEstimationProblem(rod, [ctr.TipForce()]).solve(held, [seen])
    >>> estimate.force[:2].round(4).tolist()
    [0.2, 0.1]
    """

    def __init__(
        self,
        robot: Robot,
        unknown: UnknownLoad | Sequence[UnknownLoad],
        *,
        prior: Any = None,
        loss: str = "squared",
        rotation_sigma: Any = None,
        translation_sigma: Any = None,
        tolerance: float = 1e-7,
        compiled: bool | None = None,
        starts: int = 1,
    ) -> None:
        if not isinstance(robot, Robot):
            raise DefinitionError(f"robot = {robot!r} must be a Robot")
        self.robot = robot
        self.unknown = _unknown(unknown, len(robot.tubes), prior)
        self.loss = choice(loss, "loss", LOSSES)
        self.tolerance = number(tolerance, "tolerance", least=1e-11, most=1e-2)
        self._compiled = compiled if compiled is None else flag(compiled, "compiled")
        tubes = len(robot.tubes)
        self._actuation_sigma = {
            "rotations": _deviations(rotation_sigma, "rotation_sigma", tubes),
            "translations": _deviations(translation_sigma, "translation_sigma", tubes),
        }
        self._forward = ForwardProblem(robot, tolerance=self.tolerance, compiled=self._compiled)
        self.starts = index(starts - 1, "starts - 1") + 1
        self._options = _options(self.unknown)
        self._kept: list[Case] = []

    # -- solving ---------------------------------------------------------------------------------------------------

    def solve(
        self,
        actuation: Actuation,
        measurements: Measurement | Sequence[Measurement],
        loads: Sequence[Load] = (),
        fit: Fit | None = None,
        initial: ForceEstimate | None = None,
    ) -> ForceEstimate:
        """Estimate the loads.

        Parameters
        ----------
        actuation
            Of the robot when it was measured; if the fit estimated homes of the joints, by ``fit.actuation``.
        measurements
            Any mix, each with its ``sigma``.
        loads
            Loads that are known: gravity and the like.
        fit
            The calibration that the robot is from: the errors of its parameters are counted among those of the loads.
        initial
            An earlier estimate of the same unknown loads, close by: the search starts there.

        Raises
        ------
        DefinitionError
            The fit estimated homes of the joints, and the actuation does not have them.
        EstimationError
            No loads were found: what was tried, how far it got and what to do.
        """
        experiment = experiment_of(self.robot, actuation, measurements, loads)
        errors = Errors.of(self.robot, experiment, fit, self._actuation_sigma)
        if fit is not None:
            fit.homes.check(experiment.actuation)
        found = [self._estimate(experiment, errors, unknown, initial) for unknown in self._options]
        estimates = [each for each in found if each is not None]
        if not estimates:
            raise EstimationError(
                "no loads were found: from no start could the equations of the robot and the measurements be met "
                "together. Check actuation, frame and units of the measurements; a prior of the force, or an initial "
                "estimate, helps where loads are large"
            )
        return estimates[0] if len(self._options) == 1 else self._likeliest(estimates)

    def check(self, actuation: Actuation, measurements: Any, loads: Sequence[Load] = ()) -> None:
        """Check what would be solved, without solving.

        Raises
        ------
        DefinitionError
            As :meth:`solve`.
        """
        experiment = experiment_of(self.robot, actuation, measurements, loads)
        ends = Ends.of_robot(self.robot, actuation.translations)
        experiment.check_places(ends)
        for each in self._options[0]:
            each.placed(ends)

    def errors(self, fit: Fit | None) -> Errors:
        """Of the calibration and the actuation, whatever the robot may be seen in."""
        return Errors.ever(self.robot, fit, self._actuation_sigma)

    def case(self, actuation: Actuation, measurements: Any, loads: Sequence[Load], errors: Errors) -> Case:
        """What is sought and seen, for code that searches on its own and has these errors in all that it sees."""
        experiment = experiment_of(self.robot, actuation, measurements, loads)
        return self._case(experiment, errors.acting(self.robot, experiment), self._options[0])

    def _case(self, experiment: Experiment, errors: Errors, unknown: tuple[UnknownLoad, ...]) -> Case:
        """Of models for measurements at some places the last few are kept."""

        def steps() -> int:
            return _MORE * self._unloaded(experiment).solved().steps

        case = Case.of(self.robot, experiment, unknown, errors, self.loss, self._compiled, steps, self._kept)
        others = [each for each in self._kept if each.search.model is not case.search.model]
        self._kept = [case, *others][:_MODELS]
        return case

    def _unloaded(self, experiment: Experiment) -> Equilibrium:
        try:
            return self._forward.solve(experiment.actuation, experiment.loads)
        except SolveError as error:
            raise EstimationError(f"without the unknown loads the robot has no equilibrium: {error}") from error

    def _estimate(
        self, experiment: Experiment, errors: Errors, unknown: tuple[UnknownLoad, ...], initial: ForceEstimate | None
    ) -> ForceEstimate | None:
        """With these unknown loads; None where none are found."""
        case = self._case(experiment, errors, unknown)
        if len(self._options) > 1 and isinstance(initial, ForceEstimate) and initial.labels != case.numbered.labels:
            initial = None  # of another number of contacts
        if case.roughness is not None:
            case, states = self._smoothest(case, initial)
        else:
            near = [] if initial is None else [case.search.solve(*self._near(case, initial))]
            states = [state for state in near if state is not None] or self.from_nothing(case)
        states = _different(case, [within_cone(case, state) for state in states])
        return ForceEstimate(self._forward, case, states) if states else None

    def _likeliest(self, estimates: list[ForceEstimate]) -> ForceEstimate:
        """The one with the number of contacts for which there is most evidence."""
        others, measured = len(self.unknown) - 1, len(estimates[0].state.misfit)
        table = [
            Evidence.of(len(each.case.numbered.unknown) - others, each.state.cost, len(each.labels), measured)
            for each in estimates
        ]
        best = estimates[int(np.argmin([row.criterion for row in table]))]
        if not others:
            table.insert(0, Evidence.of(0, self._resting(best.case).cost, 0, measured))
        return ForceEstimate(self._forward, best.case, best.states, table)

    def _near(self, case: Case, initial: ForceEstimate) -> tuple[Array, Array, Array]:
        if not isinstance(initial, ForceEstimate) or initial.labels != case.numbered.labels:
            raise DefinitionError(f"initial = {initial!r} must be a ForceEstimate of the same unknown loads")
        state = initial.state
        same = len(state.places) == case.search.blocks.places and not len(state.places)
        return state.z, state.x, state.places if same else case.places(initial.shape)

    def _smoothest(self, case: Case, initial: ForceEstimate | None) -> tuple[Case, list[State]]:
        """The case with the smoothness of a distributed force, and its solution, none or one."""
        start = None
        if initial is not None:
            start = case.search.at(*self._near(case, initial), np.zeros(case.search.errors))
        found, state = smoothest(case, start or self._resting(case))
        return found, [] if state is None else [state]

    def shape(self, case: Case, x: Array) -> Equilibrium:
        """The robot in equilibrium under the loads with these numbers."""
        return self._forward.solve(case.experiment.actuation, case.loads_at(x))

    def _resting(self, case: Case) -> State:
        return case.resting(self._unloaded(case.experiment))

    def from_nothing(self, case: Case) -> list[State]:
        """From the robot without the unknown loads, and where contacts are sought, from places that look likely."""
        resting = self._resting(case)
        starts = contacts(case, resting.z, resting.places) if case.contacts else [case.start]
        rng = np.random.default_rng(_SEED)
        starts += [case.start + case.forces * rng.normal(size=len(case.start)) for _ in range(self.starts - 1)]
        found = _different(case, [case.search.solve(resting.z, x, resting.places) for x in starts])
        if case.contacts and not (found and case.likely(found[0])):
            profiles = [Profile.of(case, part, found, resting) for part in case.contacts]
            walked = [profile.least() for profile in profiles if profile.states]
            freed = [case.search.solve(each.z, each.x, each.places) or each for each in walked]
            found = _different(case, [*found, *freed])
        return found


def _different(case: Case, states: Sequence[State | None]) -> list[State]:
    """Those that are found, each once, the likeliest first."""
    found: list[State] = []
    for state in states:
        if state is not None and not any(_same(case, state, other) for other in found):
            found.append(state)
    return sorted(found, key=lambda state: state.cost)


def _same(case: Case, a: State, b: State) -> bool:
    return bool(np.abs((a.x - b.x) / case.search.sought.scale).max() < _SAME)


def _deviations(value: Any, field: str, tubes: int) -> Array | None:
    if value is None:
        return None
    given = array(value, field, (None,) * np.ndim(value))
    if given.shape not in ((), (1,), (tubes,)) or not (given > 0.0).all():
        raise DefinitionError(f"{field} = {value!r} must be positive: a number, or one for each of {tubes} tubes")
    return np.array(np.broadcast_to(given, (tubes,)))


def _unknown(given: Any, tubes: int, prior: Any) -> tuple[UnknownLoad, ...]:
    every = (given,) if isinstance(given, UNKNOWN_LOADS) else tuple(given or ())
    if not every:
        raise DefinitionError("unknown = [] must name at least one load")
    for k, each in enumerate(every):
        if not isinstance(each, UNKNOWN_LOADS):
            names = ", ".join(kind.__name__ for kind in UNKNOWN_LOADS)
            raise DefinitionError(f"unknown[{k}] = {each!r} must be one of {names}")
        index(each.tube, f"unknown[{k}].tube", tubes)
    if sum(len(each.choices(alone=False)) > 1 for each in every) > 1:
        raise DefinitionError("unknown: Contacts can stand there once; more forces at unknown places are PointForce()")
    if sum(each.cone is not None for each in every) > 1:
        raise DefinitionError("unknown: one contact at most can have friction")
    rough = [each.roughly for each in every]
    if any(rough) and (sum(rough) > 1 or any(each.somewhere for each in every)):
        raise DefinitionError(
            f"unknown[{rough.index(True)}].smoothness = None must be given beside contacts at unknown places and other "
            "distributed forces"
        )
    return tuple(_with(each, prior) for each in every)


def _with(unknown: UnknownLoad, prior: Any) -> UnknownLoad:
    """A load with the prior of forces, unless it has its own."""
    if unknown.prior is not None or not unknown.force_prior:
        return unknown
    return attrs.evolve(cast(Any, unknown), prior=prior)  # type: ignore[no-any-return]


def _options(unknown: tuple[UnknownLoad, ...]) -> list[tuple[UnknownLoad, ...]]:
    """All choices of loads that stand for the unknown ones, those of the one that has several last."""
    choices = [each.choices(alone=len(unknown) == 1) for each in unknown]
    return [tuple(chain(*options)) for options in product(*sorted(choices, key=len))]


def experiment_of(robot: Robot, actuation: Actuation, measurements: Any, loads: Sequence[Load]) -> Experiment:
    """One from which loads can be estimated."""
    experiment = Experiment(actuation, loads, measurements)
    if len(actuation.rotations) != len(robot.tubes):
        raise DefinitionError(f"actuation is of {len(actuation.rotations)} tubes, but the robot has {len(robot.tubes)}")
    for k, each in enumerate(experiment.measurements):
        each.check(len(robot.tubes))
        if not each.scaled:
            raise DefinitionError(f"measurements[{k}]: sigma is needed, or nobody knows how well the force is")
    return experiment
