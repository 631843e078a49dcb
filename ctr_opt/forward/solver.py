"""Solves of one robot: by compiled code if it supports the loads, otherwise by the ways of ``ways.py``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..checks import listed
from ..errors import DefinitionError, SolveError
from ..layout.configuration import Configuration
from ..loads.kind import Load
from ..mechanics.kind import DEAD, Kind, kind_of
from ..native.library import library
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from ..solvers.homotopy import SINGULAR
from ..solvers.status import SolveStatus
from .attempt import Attempt, Failed
from .compiled import CompiledProblem, PathEnded, Record
from .continuation import Route
from .equilibrium import Equilibrium
from .run import Run
from .settings import Settings
from .ways import solve_configuration


class ForwardSolver:
    """The solver of one robot with its settings; ``compiled`` as in :class:`~ctr_opt.ForwardProblem`."""

    def __init__(self, robot: Robot, settings: Settings, compiled: bool | None) -> None:
        self.robot = robot
        self.settings = settings
        self._compilable = compiled is not False and settings.compilable
        self._requested = False
        self._compiled: dict[Kind, CompiledProblem] = {}

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_compiled": {}}  # libraries belong to this process

    def compile(self) -> None:
        """Compile the solver for this number of tubes if it is not cached; raises ``CompilationError``."""
        library(len(self.robot.tubes), DEAD).built()
        self._requested = True

    def compiled_for(self, loads: Iterable[Load]) -> CompiledProblem | None:
        """The compiled solver for these loads; None if it is not available or not wanted."""
        if not self._compilable:
            return None
        kind = kind_of(loads)
        problem = self._compiled.get(kind)
        if problem is None:
            kept = library(len(self.robot.tubes), kind)
            native = kept.built() if self._requested else kept.ready()
            if native is None:
                return None
            problem = self._compiled[kind] = CompiledProblem(self.robot, self.settings, native)
        return problem

    def configuration(self, actuation: Actuation, loads: tuple[Load, ...]) -> Configuration:
        """Actuation and loads as numbers along the arc length; raises ``DefinitionError``."""
        configuration = Configuration(self.robot, actuation, loads)
        if self.settings.formulation == "energy" and configuration.without_potential:
            raise DefinitionError(
                f"{configuration.without_potential}: formulation = 'energy' takes conservative loads only; "
                "use formulation = 'automatic' or 'equilibrium'"
            )
        return configuration

    def solve(
        self, actuation: Actuation, loads: tuple[Load, ...], initial: Equilibrium | None = None, throw: bool = False
    ) -> Equilibrium:
        """Solve from another equilibrium or from a cold start; with ``throw``, failure raises ``SolveError``."""
        start = None if initial is None else started(initial, self.robot)
        fast = self.compiled_for(loads)
        if fast is not None and isinstance(actuation, Actuation) and len(actuation.rotations) == len(self.robot.tubes):
            try:
                record = fast.solve(actuation, loads, start, far=True)
                if record is not None:
                    return Equilibrium(record)
            except PathEnded as ended:
                failed = self._folded(fast, self.configuration(actuation, loads), start, ended)
                if failed is not None:
                    return self._thrown(failed, throw)
        return self._thrown(solve_configuration(self.settings, self.configuration(actuation, loads), start), throw)

    def _folded(
        self, fast: CompiledProblem, target: Configuration, start: Record | None, ended: PathEnded
    ) -> Equilibrium | None:
        """The record of a continuation that ended at a fold, with the last equilibrium; None if it is no clear fold."""
        assert start is not None
        there = Route(start.configuration, target, self.settings.integrator).configuration(ended.reached)
        try:
            last = fast.solve(there.actuation, there.loads, start, far=True)
        except PathEnded:
            return None
        if last is None:
            return None
        jacobians = start.outcome.jacobian, last.outcome.jacobian
        sizes = [0.0 if jacobian is None else np.linalg.svd(jacobian, compute_uv=False)[-1] for jacobian in jacobians]
        if not sizes[1] < SINGULAR * sizes[0]:
            return None
        run = Run(self.settings, target, start)
        run.attempts.append(Attempt("continuation from initial", last.outcome.iterations, ended.reached))
        reason = f"{SolveStatus.FOLD.description}, {ended} (the Jacobian may have been singular on the way)"
        z = last.base.unknowns(target.scales, target.kind.live)
        failure = Failed(SolveStatus.FOLD, f"continuation from initial: {reason}", z, ended.reached)
        return Equilibrium(run.failure(failure), Equilibrium(last))

    @staticmethod
    def _thrown(result: Equilibrium, throw: bool) -> Equilibrium:
        if throw and not result.converged:
            raise SolveError(result.message, result)
        return result

    def _fits(self, actuation: Any) -> bool:
        """Whether it is an actuation of this number of tubes; if not, the general solver says so."""
        return isinstance(actuation, Actuation) and len(actuation.rotations) == len(self.robot.tubes)

    def neighbour(self, actuation: Actuation, loads: tuple[Load, ...], initial: Equilibrium) -> Equilibrium | None:
        """The equilibrium next to ``initial`` on the same branch, or None if that is in doubt."""
        fast, start = self.compiled_for(loads), started(initial, self.robot)
        if fast is not None and fast.knows(loads) and self._fits(actuation):
            record = fast.solve(actuation, loads, start)
            return None if record is None else Equilibrium(record)
        result = solve_configuration(self.settings, self.configuration(actuation, loads), start)
        return result if result.converged else None


def as_loads(loads: Any) -> tuple[Load, ...]:
    """A list of loads as a tuple."""
    if isinstance(loads, Load):
        raise DefinitionError(f"loads = {loads!r} must be a list of loads, like loads=[...]")
    checked = loads if type(loads) is tuple else tuple(listed(loads, "loads", "a list of loads"))
    for load in checked:
        if not isinstance(load, Load):
            k = next(k for k, one in enumerate(checked) if one is load)
            raise DefinitionError(f"loads[{k}] = {load!r} must be a load, such as a PointWrench")
    return checked


def started(initial: Any, robot: Robot) -> Record:
    """The record to start from; raises ``DefinitionError`` unless its robot has this number of tubes."""
    if not isinstance(initial, Equilibrium):
        raise DefinitionError(f"initial = {initial!r} must be an Equilibrium")
    record = initial.record
    if record.robot is not robot and len(record.robot.tubes) != len(robot.tubes):
        tubes = len(record.robot.tubes)
        raise DefinitionError(f"initial belongs to a robot with {tubes} tubes, but this one has {len(robot.tubes)}")
    return record
