"""Force estimation step by step: checked input, unknown loads, cached models, search and choice of a solution."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, product
from typing import Any, cast

import attrs
import numpy as np

from ..calibration.fit import Fit
from ..checks import Array, array, choice, dimensions, index, whole
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
from .search import SearchState
from .smoothness import smoothest
from .unknown import PointForce, TipForce, TipWrench, UnknownLoad

UNKNOWN_LOADS = (TipForce, TipWrench, PointForce, DistributedForce, Contacts)
_SAME = 1e-4  # of the loads' scales: closer solutions count as one
_SEED = 0
_MORE = 2  # factor of steps over the solve without unknown loads, in the virtual machine
_MODELS = 8  # cached models, for measurements at different places


class ForceEstimation:
    """The checked input of :class:`~ctr_opt.ForceEstimationProblem`, and its solution step by step."""

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
        self.starts = whole(starts, "starts", 1)
        self.options = _options(self.unknown)
        self._kept: list[Case] = []

    def experiment(self, actuation: Actuation, measurements: Any, loads: Sequence[Load]) -> Experiment:
        """The experiment from which loads are estimated, checked."""
        experiment = Experiment(actuation, loads, measurements)
        experiment.check_robot(len(self.robot.tubes))
        for k, measurement in enumerate(experiment.measurements):
            if not measurement.scaled:
                raise DefinitionError(f"measurements[{k}]: sigma is required to compute the force's uncertainty")
        return experiment

    def check(self, experiment: Experiment) -> None:
        """Check an experiment without solving."""
        ends = Ends.of_robot(self.robot, experiment.actuation.translations)
        experiment.check_places(ends)
        for load in self.options[0]:
            load.placed(ends)

    def errors(self, fit: Fit | None) -> Errors:
        """Errors of calibration and actuation for all possible experiments."""
        return Errors.ever(self.robot, fit, self._joints)

    def solve(self, experiment: Experiment, fit: Fit | None, initial: ForceEstimate | None) -> ForceEstimate:
        """Implement :meth:`ForceEstimationProblem.solve <ctr_opt.ForceEstimationProblem.solve>`."""
        errors = Errors.of(self.robot, experiment, fit, self._joints)
        if fit is not None:
            fit.homes.check(experiment.actuation)
        tried = [self._estimate(experiment, errors, unknown, initial) for unknown in self.options]
        estimates = [estimate for estimate in tried if estimate is not None]
        if not estimates:
            raise EstimationError(
                "no loads were found: from no start did the robot's equations and the measurements converge together. "
                "Check actuation, frame and units of the measurements; for large loads a prior of the force or an "
                "initial estimate helps"
            )
        return estimates[0] if len(self.options) == 1 else self._likeliest(estimates)

    def case(self, experiment: Experiment, errors: Errors, unknown: tuple[UnknownLoad, ...]) -> Case:
        """The case of an experiment; the last few models are cached."""

        def steps() -> int:
            return _MORE * self._unloaded(experiment).solved().steps

        case = Case.of(self.robot, experiment, unknown, errors, self.loss, self.forward.compiled, steps, self._kept)
        older = [kept for kept in self._kept if kept.search.model is not case.search.model]
        self._kept = [case, *older][:_MODELS]
        return case

    def _unloaded(self, experiment: Experiment) -> Equilibrium:
        try:
            return self.forward.solve(experiment.actuation, experiment.loads)
        except SolveError as error:
            raise EstimationError(f"without the unknown loads the robot has no equilibrium: {error}") from error

    def _estimate(
        self, experiment: Experiment, errors: Errors, unknown: tuple[UnknownLoad, ...], initial: ForceEstimate | None
    ) -> ForceEstimate | None:
        """The estimate with these unknown loads; None if the search fails."""
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
        """The estimate whose number of contacts has the best criterion."""
        not_contacts, measured = len(self.unknown) - 1, len(estimates[0].state.misfit)
        table = [
            Evidence.of(len(one.case.numbered.unknown) - not_contacts, one.state.cost, len(one.labels), measured)
            for one in estimates
        ]
        best = estimates[int(np.argmin([row.criterion for row in table]))]
        if not not_contacts:
            table.insert(0, Evidence.of(0, self._resting(best.case).cost, 0, measured))
        return ForceEstimate(self.forward, best.case, best.states, table)

    def _near(self, case: Case, initial: ForceEstimate) -> tuple[Array, Array, Array]:
        if not isinstance(initial, ForceEstimate) or initial.labels != case.numbered.labels:
            raise DefinitionError(f"initial = {initial!r} must be a ForceEstimate of the same unknown loads")
        state = initial.state
        same = len(state.places) == case.search.blocks.places and not len(state.places)
        return state.z, state.x, state.places if same else case.places(initial.shape)

    def _smoothest(self, case: Case, initial: ForceEstimate | None) -> tuple[Case, list[SearchState]]:
        """The case with the estimated smoothness of a distributed force, and its solution, if there is one."""
        start = None
        if initial is not None:
            start = case.search.at(*self._near(case, initial), np.zeros(case.search.errors))
        chosen, state = smoothest(case, start or self._resting(case))
        return chosen, [] if state is None else [state]

    def shape(self, case: Case, x: Array) -> Equilibrium:
        """The robot's equilibrium under the loads with numbers ``x``."""
        return self.forward.solve(case.experiment.actuation, case.loads_at(x))

    def _resting(self, case: Case) -> SearchState:
        return case.resting(self._unloaded(case.experiment))

    def from_nothing(self, case: Case) -> list[SearchState]:
        """Solutions from the robot without the unknown loads; contacts start from likely places."""
        resting = self._resting(case)
        starts = contacts(case, resting.z, resting.places) if case.contacts else [case.start]
        rng = np.random.default_rng(_SEED)
        starts += [case.start + case.forces * rng.normal(size=len(case.start)) for _ in range(self.starts - 1)]
        states = _different(case, [case.search.solve(resting.z, x, resting.places) for x in starts])
        if case.contacts and not (states and case.likely(states[0])):
            profiles = [Profile.of(case, part, states, resting) for part in case.contacts]
            walked = [profile.least() for profile in profiles if profile.states]
            freed = [case.search.solve(state.z, state.x, state.places) or state for state in walked]
            states = _different(case, [*states, *freed])
        return states


def _different(case: Case, states: Sequence[SearchState | None]) -> list[SearchState]:
    """The distinct states, in order of their loss."""
    different: list[SearchState] = []
    for state in states:
        if state is not None and not any(_same(case, state, before) for before in different):
            different.append(state)
    return sorted(different, key=lambda state: state.cost)


def _same(case: Case, a: SearchState, b: SearchState) -> bool:
    return bool(np.abs((a.x - b.x) / case.search.unknowns.scale).max() < _SAME)


def _deviations(value: Any, field: str, tubes: int) -> Array | None:
    if value is None:
        return None
    deviations = array(value, field, (None,) * dimensions(value))
    if deviations.shape not in ((), (1,), (tubes,)) or not (deviations > 0.0).all():
        raise DefinitionError(f"{field} = {value!r} must be positive: a number, or one for each of {tubes} tubes")
    return np.array(np.broadcast_to(deviations, (tubes,)))


def _unknown(unknown: Any, tubes: int, prior: Any) -> tuple[UnknownLoad, ...]:
    loads = several(() if unknown is None else unknown, UNKNOWN_LOADS, "unknown")
    if not loads:
        raise DefinitionError("unknown = [] must name at least one load")
    for k, load in enumerate(loads):
        index(load.tube, f"unknown[{k}].tube", tubes)
    if sum(len(load.choices(alone=False)) > 1 for load in loads) > 1:
        raise DefinitionError("unknown: only one Contacts is allowed; use PointForce() for more forces")
    if sum(load.cone is not None for load in loads) > 1:
        raise DefinitionError("unknown: at most one contact can have friction")
    rough = [load.roughly for load in loads]
    if any(rough) and (sum(rough) > 1 or any(load.somewhere for load in loads)):
        raise DefinitionError(
            f"unknown[{rough.index(True)}].smoothness = None must be a number if there are contacts at unknown places "
            "or other distributed forces"
        )
    return tuple(_with(load, prior) for load in loads)


def _with(unknown: UnknownLoad, prior: Any) -> UnknownLoad:
    """The load with the problem's prior of forces, unless it has its own."""
    if unknown.prior is not None or not unknown.force_prior:
        return unknown
    return attrs.evolve(cast(Any, unknown), prior=prior)  # type: ignore[no-any-return]


def _options(unknown: tuple[UnknownLoad, ...]) -> list[tuple[UnknownLoad, ...]]:
    """All combinations of alternative loads, with the load that has several alternatives last."""
    choices = [load.choices(alone=len(unknown) == 1) for load in unknown]
    return [tuple(chain(*options)) for options in product(*sorted(choices, key=len))]
