"""Solves of one robot: by compiled code if it supports the loads, otherwise by the ways of ``ways.py``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ..checks import listed
from ..errors import DefinitionError, SolveError
from ..layout.configuration import Configuration
from ..loads.kind import Load
from ..mechanics.kind import DEAD, Kind, kind_of
from ..native.library import library
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from .compiled import CompiledProblem, Record
from .equilibrium import Equilibrium
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
        if fast is not None and self._fits(actuation):
            record = fast.solve(actuation, loads, start)
            if record is not None:
                return Equilibrium(record)
        result = solve_configuration(self.settings, self.configuration(actuation, loads), start)
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
    checked = tuple(listed(loads, "loads", "a list of loads"))
    for k, load in enumerate(checked):
        if not isinstance(load, Load):
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
