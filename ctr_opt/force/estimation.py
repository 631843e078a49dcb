"""A problem of force estimation, ready to be solved: its unknown loads, and the models that are kept."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, product
from typing import Any, cast

import attrs
import numpy as np

from ..calibration.fit import Fit
from ..checks import Array, array, choice, index
from ..errors import DefinitionError, EstimationError, SolveError
from ..estimation.experiment import Experiment, several
from ..estimation.losses import LOSSES
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


class Estimation:
    """What :class:`~ctr_opt.ForceEstimationProblem` was told, checked; and its solution, step by step."""

    def __init__(
        self,
        robot: Robot,
        unknown: Any,
        prior: Any,
        loss: str,
        rotation_sigma: Any,
        translation_sigma: Any,
        tolerance: float,
        compiled: bool | None,
        starts: int = 1,
    ) -> None:
        self.forward = ForwardProblem(robot, tolerance=tolerance, compiled=compiled)
        self.robot, tubes = robot, len(robot.tubes)
        self.unknown = _unknown(unknown, tubes, prior)
        self.loss = choice(loss, "loss", LOSSES)
        self._joints = {
            "rotations": _deviations(rotation_sigma, "rotation_sigma", tubes),
            "translations": _deviations(translation_sigma, "translation_sigma", tubes),
        }
        self.starts = index(starts - 1, "starts - 1") + 1
        self.options = _options(self.unknown)
        self._kept: list[Case] = []

    def experiment(self, actuation: Actuation, measurements: Any, loads: Sequence[Load]) -> Experiment:
        """One from which loads can be estimated."""
        experiment = Experiment(actuation, loads, measurements)
        experiment.check_robot(len(self.robot.tubes))
        for k, one in enumerate(experiment.measurements):
            if not one.scaled:
                raise DefinitionError(f"measurements[{k}]: sigma is needed, or nobody knows how well the force is")
        return experiment

    def check(self, experiment: Experiment) -> None:
        """Check what would be solved, without solving."""
        ends = Ends.of_robot(self.robot, experiment.actuation.translations)
        experiment.check_places(ends)
        for one in self.options[0]:
            one.placed(ends)

    def errors(self, fit: Fit | None) -> Errors:
        """Of the calibration and the actuation, whatever the robot may be seen in."""
        return Errors.ever(self.robot, fit, self._joints)

    def solve(self, experiment: Experiment, fit: Fit | None, initial: ForceEstimate | None) -> ForceEstimate:
        """As :meth:`ForceEstimationProblem.solve <ctr_opt.ForceEstimationProblem.solve>`."""
        errors = Errors.of(self.robot, experiment, fit, self._joints)
        if fit is not None:
            fit.homes.check(experiment.actuation)
        tried = [self._estimate(experiment, errors, unknown, initial) for unknown in self.options]
        estimates = [estimate for estimate in tried if estimate is not None]
        if not estimates:
            raise EstimationError(
                "no loads were found: from no start could the equations of the robot and the measurements be met "
                "together. Check actuation, frame and units of the measurements; a prior of the force, or an initial "
                "estimate, helps where loads are large"
            )
        return estimates[0] if len(self.options) == 1 else self._likeliest(estimates)

    def case(self, experiment: Experiment, errors: Errors, unknown: tuple[UnknownLoad, ...]) -> Case:
        """Of models for measurements at some places the last few are kept."""

        def steps() -> int:
            return _MORE * self._unloaded(experiment).solved().steps

        case = Case.of(self.robot, experiment, unknown, errors, self.loss, self.forward.compiled, steps, self._kept)
        others = [one for one in self._kept if one.search.model is not case.search.model]
        self._kept = [case, *others][:_MODELS]
        return case

    def _unloaded(self, experiment: Experiment) -> Equilibrium:
        try:
            return self.forward.solve(experiment.actuation, experiment.loads)
        except SolveError as error:
            raise EstimationError(f"without the unknown loads the robot has no equilibrium: {error}") from error

    def _estimate(
        self, experiment: Experiment, errors: Errors, unknown: tuple[UnknownLoad, ...], initial: ForceEstimate | None
    ) -> ForceEstimate | None:
        """With these unknown loads; None where none are found."""
        case = self.case(experiment, errors, unknown)
        if len(self.options) > 1 and isinstance(initial, ForceEstimate) and initial.labels != case.numbered.labels:
            initial = None  # of another number of contacts
        if case.roughness is not None:
            case, states = self._smoothest(case, initial)
        else:
            near = [] if initial is None else [case.search.solve(*self._near(case, initial))]
            states = [state for state in near if state is not None] or self.from_nothing(case)
        states = _different(case, [within_cone(case, state) for state in states])
        return ForceEstimate(self.forward, case, states) if states else None

    def _likeliest(self, estimates: list[ForceEstimate]) -> ForceEstimate:
        """The one with the number of contacts for which there is most evidence."""
        others, measured = len(self.unknown) - 1, len(estimates[0].state.misfit)
        table = [
            Evidence.of(len(one.case.numbered.unknown) - others, one.state.cost, len(one.labels), measured)
            for one in estimates
        ]
        best = estimates[int(np.argmin([row.criterion for row in table]))]
        if not others:
            table.insert(0, Evidence.of(0, self._resting(best.case).cost, 0, measured))
        return ForceEstimate(self.forward, best.case, best.states, table)

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
        chosen, state = smoothest(case, start or self._resting(case))
        return chosen, [] if state is None else [state]

    def shape(self, case: Case, x: Array) -> Equilibrium:
        """The robot in equilibrium under the loads with these numbers."""
        return self.forward.solve(case.experiment.actuation, case.loads_at(x))

    def _resting(self, case: Case) -> State:
        return case.resting(self._unloaded(case.experiment))

    def from_nothing(self, case: Case) -> list[State]:
        """From the robot without the unknown loads, and where contacts are sought, from places that look likely."""
        resting = self._resting(case)
        starts = contacts(case, resting.z, resting.places) if case.contacts else [case.start]
        rng = np.random.default_rng(_SEED)
        starts += [case.start + case.forces * rng.normal(size=len(case.start)) for _ in range(self.starts - 1)]
        states = _different(case, [case.search.solve(resting.z, x, resting.places) for x in starts])
        if case.contacts and not (states and case.likely(states[0])):
            profiles = [Profile.of(case, part, states, resting) for part in case.contacts]
            walked = [profile.least() for profile in profiles if profile.states]
            freed = [case.search.solve(one.z, one.x, one.places) or one for one in walked]
            states = _different(case, [*states, *freed])
        return states


def _different(case: Case, states: Sequence[State | None]) -> list[State]:
    """Those that are different, each once, the likeliest first."""
    different: list[State] = []
    for state in states:
        if state is not None and not any(_same(case, state, other) for other in different):
            different.append(state)
    return sorted(different, key=lambda state: state.cost)


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
    every = several(() if given is None else given, UNKNOWN_LOADS, "unknown")
    if not every:
        raise DefinitionError("unknown = [] must name at least one load")
    for k, one in enumerate(every):
        index(one.tube, f"unknown[{k}].tube", tubes)
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
    choices = [one.choices(alone=len(unknown) == 1) for one in unknown]
    return [tuple(chain(*options)) for options in product(*sorted(choices, key=len))]
