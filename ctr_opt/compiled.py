"""Solves by compiled code: called through buffers, answers made into objects only as far as they are looked at."""

from __future__ import annotations

import threading
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np

from .equilibrium import BaseMoments, Equilibrium, Outcome
from .mechanics.sections import Configuration
from .robot.actuation import Actuation
from .robot.checks import Array
from .robot.loads import Load
from .robot.robot import Robot
from .settings import Settings
from .solvers.native import LoadRows, Native, RobotTable
from .solvers.status import SolveStatus
from .transcription.shape import Shape
from .transcription.shooting import Nodes

_STEPS = 24  # room for so many steps in a result, until one needs more


class CompiledProblem:
    """A robot and settings before a compiled library: every call gives None where the slower way must be taken."""

    def __init__(self, robot: Robot, settings: Settings, native: Native) -> None:
        self.robot = robot
        self.native = native
        self._robot = RobotTable(robot)
        self._tolerances = (settings.tolerance, settings.residual_tolerance)
        self._tubes = len(robot.tubes)
        self._size = native.size(_STEPS)
        self._mine = threading.local()

    def solve(
        self, actuation: Actuation, loads: tuple[Load, ...], initial: Equilibrium | None
    ) -> CompiledEquilibrium | None:
        """An equilibrium from another one, or from nothing."""
        begin = perf_counter()
        start = None
        if initial is not None:
            start = start_of(initial, self.native)
            if start is None:
                return None
        rows, inputs = self._inputs(actuation, loads)
        if rows is None:
            return None
        while True:
            numbers = np.empty(self._size)
            result = (*self._tolerances, numbers.ctypes.data, numbers.size)
            if start is None:
                failed = self.native.cold(self._robot.address, rows.address, inputs, *result)
            else:
                failed = self.native.warm(self._robot.address, rows.address, inputs, start, *result)
            if not failed:
                break
            if failed != Native.TOO_SMALL:
                return None
            self._size = 2 * int(numbers[Native.NEEDED])
        return CompiledEquilibrium(self, actuation, loads, numbers, start is None, perf_counter() - begin)

    def derive(self, of: CompiledEquilibrium, tube: int) -> tuple[Array, Array] | None:
        """The tip's pose rates with actuation ``(6, 2n)`` and with a wrench at the tip of a tube ``(6, 6)``."""
        rows, inputs = self._inputs(of.actuation, of.loads)
        assert rows is not None
        jacobian, compliance = np.empty((6, 2 * self._tubes)), np.empty((6, 6))
        unknowns = of.numbers.ctypes.data + 8 * self.native.header
        refinements = int(of.numbers[Native.REFINEMENTS])
        outputs = (refinements, tube, jacobian.ctypes.data, compliance.ctypes.data)
        failed = self.native.derive(self._robot.address, rows.address, inputs, unknowns, *outputs)
        return None if failed else (jacobian, compliance)

    def _inputs(self, actuation: Actuation, loads: tuple[Load, ...]) -> tuple[LoadRows | None, int]:
        """Loads as rows, made anew when they are others than last time, and the address of the actuation."""
        mine = self._mine.__dict__
        known = mine.get("loads")
        if known is None or len(known) != len(loads) or any(a is not b for a, b in zip(known, loads, strict=True)):
            mine["rows"], mine["loads"] = LoadRows.of(self.robot, loads), loads
        if "actuation" not in mine:
            mine["actuation"] = np.empty(2 * self._tubes)
            mine["address"] = mine["actuation"].ctypes.data
        inputs = mine["actuation"]
        inputs[: self._tubes] = actuation.rotations
        inputs[self._tubes :] = actuation.translations
        return mine["rows"], mine["address"]


class CompiledEquilibrium(Equilibrium):
    """An equilibrium whose parts are made of the compiled solver's numbers when they are asked for."""

    def __init__(
        self,
        problem: CompiledProblem,
        actuation: Actuation,
        loads: tuple[Load, ...],
        numbers: Array,
        cold: bool,
        solve_time: float,
    ) -> None:
        self._problem: CompiledProblem | None = problem
        self._given = (problem.robot, actuation, loads)
        self.numbers = numbers
        self._how = ("homotopy" if cold else "newton from initial", solve_time)
        self._sizes = (problem.native.header, problem.native.start, problem.native.unknowns, problem.native.states)
        self._last = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_problem": None}  # the library is of this process

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self._given[0]

    @property
    def actuation(self) -> Actuation:
        """Its actuation."""
        return self._given[1]

    @property
    def loads(self) -> tuple[Load, ...]:
        """The loads on it."""
        return self._given[2]

    @property
    def status(self) -> SolveStatus:
        """How the solve ended."""
        return SolveStatus.CONVERGED

    @property
    def length(self) -> float:
        """Arc length from the entry point to the tip, m."""
        return float(self.numbers[Native.LENGTH])

    @cached_property
    def _configuration(self) -> Configuration:  # type: ignore[override]
        return Configuration(*self._given)

    @property
    def _start(self) -> Array:
        header, start, _, _ = self._sizes
        return self.numbers[header : header + start]

    @cached_property
    def _base(self) -> BaseMoments:  # type: ignore[override]
        unknowns = self._sizes[2]
        return BaseMoments.of(self._start[:unknowns], self._configuration.scales, len(self.robot.tubes))

    @cached_property
    def _outcome(self) -> Outcome:  # type: ignore[override]
        unknowns = self._sizes[2]
        path, solve_time = self._how
        return Outcome(
            SolveStatus.CONVERGED,
            path,
            iterations=int(self.numbers[Native.ITERATIONS]),
            solve_time=solve_time,
            residual_norm=float(self.numbers[Native.RESIDUAL]),
            discretization_error=float(self.numbers[Native.ERROR]) * self.length,
            jacobian=self._start[unknowns : unknowns + unknowns**2].reshape(unknowns, unknowns),
        )

    @cached_property
    def _solved_shape(self) -> Shape:  # type: ignore[override]
        header, start, _, states = self._sizes
        steps = int(self.numbers[Native.STEPS])
        blocks = np.split(self.numbers[header + start :], np.cumsum((2 * steps, states * (steps + 1), states * steps)))
        right, left = (block.reshape(-1, states).T for block in blocks[1:3])
        return Shape(self._configuration, blocks[0].reshape(steps, 2), Nodes(right[:, :steps], left, right[:, steps]))

    @cached_property
    def tip_position(self) -> Array:
        """Position at ``s = length``, m, world frame."""
        header, start, _, states = self._sizes
        steps = int(self.numbers[Native.STEPS])
        first = header + start + 2 * steps + states * steps
        return self.numbers[first : first + 3] * self.length


def start_of(initial: Equilibrium, native: Native) -> int | None:
    """Address of the numbers that a solve starts from; None where it cannot start from this equilibrium."""
    if isinstance(initial, CompiledEquilibrium):
        if initial._sizes[2] != native.unknowns:
            return None
        return int(initial.numbers.ctypes.data) + 8 * native.header
    jacobian = initial.shooting_jacobian
    if jacobian is None or len(jacobian) != native.unknowns:
        return None
    configuration = initial.configuration
    scales = configuration.scales
    unknowns = initial.last_iterate.unknowns(scales, configuration.kind.live)
    block = np.concatenate((unknowns, jacobian.ravel(), [scales.moment, scales.force]))
    initial.__dict__["_compiled_start"] = block  # kept as long as the equilibrium, so that the address stays good
    return int(block.ctypes.data)
