"""Solves by compiled code: called through buffers, answers made into objects only as far as they are looked at."""

from __future__ import annotations

import ctypes
import threading
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np

from .equilibrium import BaseMoments, Equilibrium, Outcome
from .mechanics.sections import Configuration
from .robot.actuation import Actuation
from .robot.checks import Array, index
from .robot.loads import Load
from .robot.robot import Robot
from .settings import Settings
from .solvers.accuracy import estimate_error_of_nodes
from .solvers.native import Goal, LoadRows, Native, RobotTable
from .solvers.status import SolveStatus
from .transcription.shape import Shape
from .transcription.shooting import Nodes, Shooting
from .transcription.stability import SecondVariation

_STEPS = 24  # room for so many steps in a result, until one needs more


class CompiledProblem:
    """A robot and settings before a compiled library: every call gives None where the slower way must be taken."""

    def __init__(self, robot: Robot, settings: Settings, native: Native) -> None:
        self.robot = robot
        self.native = native
        self._robot = RobotTable(robot)
        self._address = self._robot.address
        self._tubes = len(robot.tubes)
        self.sizes = (native.header, native.start, native.unknowns, native.states)
        self._size = native.size(_STEPS)
        self._automatic = settings.formulation == "automatic"
        self._tolerances = Goal(settings.tolerance, settings.compiled_residual)
        self._goal = ctypes.addressof(self._tolerances)
        self._mine = threading.local()

    def solve(
        self, actuation: Actuation, loads: tuple[Load, ...], initial: Equilibrium | None
    ) -> CompiledEquilibrium | None:
        """An equilibrium from another one, or from nothing."""
        begin = perf_counter()
        start = None if initial is None else self._start(initial)
        rows, inputs = self._inputs(actuation, loads)
        if rows is None or (start is None and initial is not None):
            return None
        while True:
            numbers = np.empty(self._size)
            address = numbers.ctypes.data
            if start is None:
                failed = self.native.cold(self._address, rows.address, inputs, self._goal, address, self._size)
            else:
                failed = self.native.warm(self._address, rows.address, inputs, start, self._goal, address, self._size)
            if not failed:
                found = CompiledEquilibrium(self, actuation, loads, numbers, address, perf_counter() - begin)
                leave = start is None and self._automatic and found.unstable_directions
                return None if leave else found
            if failed != Native.TOO_SMALL:
                return None
            self._size = 2 * int(numbers[Native.NEEDED])

    def _start(self, initial: Equilibrium) -> int | None:
        """Address of the numbers that a solve starts from; None where it cannot start from this equilibrium."""
        if isinstance(initial, CompiledEquilibrium):
            return initial.start if initial.sizes[2] == self.native.unknowns else None
        jacobian = initial.shooting_jacobian
        if jacobian is None or len(jacobian) != self.native.unknowns:
            return None
        configuration = initial.configuration
        scales = configuration.scales
        unknowns = initial.last_iterate.unknowns(scales, configuration.kind.live)
        block = np.concatenate((unknowns, jacobian.ravel(), 0.0 * unknowns, [scales.moment, scales.force]))
        self._mine.block = block  # kept until the solve is over
        return int(block.ctypes.data)

    def solve_many(
        self, actuations: Array, loads: list[tuple[Load, ...]], initial: Equilibrium | None, chained: bool
    ) -> list[CompiledEquilibrium | None]:
        """The equilibria of many rows; None for those that must take the slower way."""
        count, size = len(actuations), self._size
        tables: dict[int, LoadRows] = {}
        for each in loads:
            if id(each) not in tables:
                table = LoadRows.of(self.robot, each)
                if table is None:
                    return [None] * count
                tables[id(each)] = table
        addresses = np.array([tables[id(each)].address for each in loads], dtype=np.uintp)
        start = None if initial is None else self._start(initial)
        numbers, failed = np.empty((count, size)), np.empty(count, dtype=np.intc)
        begin, first = perf_counter(), numbers.ctypes.data
        case = (self._address, addresses.ctypes.data, actuations.ctypes.data, count)
        self.native.many(*case, start, chained, self._goal, first, size, failed.ctypes.data)
        seconds = (perf_counter() - begin) / max(count, 1)
        tubes = self._tubes
        return [
            CompiledEquilibrium(self, (row[:tubes], row[tubes:]), loads[k], numbers[k], first + 8 * size * k, seconds)
            if not failed[k]
            else None
            for k, row in enumerate(actuations)
        ]

    def derive(self, of: CompiledEquilibrium, tube: int) -> tuple[Array, Array] | None:
        """The tip's pose rates with actuation ``(6, 2n)`` and with a wrench at the tip of a tube ``(6, 6)``."""
        rows, inputs = self._inputs(of.actuation, of.loads)
        assert rows is not None
        jacobian, compliance = np.empty((6, 2 * self._tubes)), np.empty((6, 6))
        refinements = int(of._numbers[Native.REFINEMENTS])
        outputs = (refinements, tube, jacobian.ctypes.data, compliance.ctypes.data)
        failed = self.native.derive(self._address, rows.address, inputs, of.start, *outputs)
        return None if failed else (jacobian, compliance)

    def inspect(self, of: CompiledEquilibrium) -> tuple[Array, float] | None:
        """The exact Jacobian of the tip conditions, and the estimated error over the length."""
        rows, inputs = self._inputs(of.actuation, of.loads)
        assert rows is not None
        k = self.native.unknowns
        out = np.empty(k * k + 1)
        failed = self.native.inspect(
            self._address, rows.address, inputs, of.start - 8 * self.native.header, out.ctypes.data
        )
        return None if failed else (out[:-1].reshape(k, k), float(out[-1]))

    def stability(self, of: CompiledEquilibrium) -> SecondVariation | None:
        """The second variation of the potential energy; None where the slower way must be taken."""
        rows, inputs = self._inputs(of.actuation, of.loads)
        assert rows is not None
        margin = ctypes.c_double()
        result = of.start - 8 * self.native.header
        negative = self.native.stability(self._address, rows.address, inputs, result, margin)
        return None if negative < 0 else SecondVariation(negative, margin.value > 0.0, abs(margin.value))

    def _inputs(self, actuation: Actuation, loads: tuple[Load, ...]) -> tuple[LoadRows | None, int]:
        """Loads as rows, made anew when they are others than last time, and the address of the actuation."""
        mine = self._mine.__dict__
        if mine.get("loads") != loads:
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
        actuation: Actuation | tuple[Array, Array],
        loads: tuple[Load, ...],
        numbers: Array,
        address: int,
        solve_time: float,
    ) -> None:
        self._problem: CompiledProblem | None = problem
        self._robot, self._actuation, self._loads = problem.robot, actuation, loads
        self._numbers = numbers
        self._time = solve_time
        self.sizes = problem.sizes
        self._last = None
        self._rates: dict[int, tuple[Array, Array] | None] = {}
        self.start = address + 8 * self.sizes[0]

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_problem": None}  # the library is of this process

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.start = self._numbers.ctypes.data + 8 * self.sizes[0]

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self._robot

    @property
    def actuation(self) -> Actuation:
        """Its actuation."""
        if isinstance(self._actuation, tuple):
            self._actuation = Actuation(*self._actuation)
        return self._actuation

    @property
    def loads(self) -> tuple[Load, ...]:
        """The loads on it."""
        return self._loads

    @property
    def status(self) -> SolveStatus:
        """How the solve ended."""
        return SolveStatus.CONVERGED

    @property
    def length(self) -> float:
        """Arc length from the entry point to the tip, m."""
        return float(self._numbers[Native.LENGTH])

    @cached_property
    def _configuration(self) -> Configuration:  # type: ignore[override]
        return Configuration(self.robot, self.actuation, self.loads)

    @property
    def _block(self) -> Array:
        header, start, _, _ = self.sizes
        return self._numbers[header : header + start]

    @cached_property
    def _base(self) -> BaseMoments:  # type: ignore[override]
        unknowns = self.sizes[2]
        return BaseMoments.of(self._block[:unknowns], self._configuration.scales, len(self.robot.tubes))

    @cached_property
    def _outcome(self) -> Outcome:  # type: ignore[override]
        jacobian, error = self._inspected
        return Outcome(
            SolveStatus.CONVERGED,
            "homotopy" if self._numbers[Native.COLD] else "newton from initial",
            iterations=int(self._numbers[Native.ITERATIONS]),
            solve_time=self._time,
            residual_norm=float(self._numbers[Native.RESIDUAL]),
            discretization_error=error * self.length,
            jacobian=jacobian,
        )

    @cached_property
    def _inspected(self) -> tuple[Array, float]:
        """What a solve leaves for later: the Jacobian and the estimated error, of which it only needs a bound."""
        found = None if self._problem is None else self._problem.inspect(self)
        if found is not None:
            return found
        configuration, shape = self._configuration, self._solved_shape
        shooting = Shooting(configuration, shape.mesh)
        z = self._base.unknowns(configuration.scales, configuration.kind.live)
        estimate, solution = estimate_error_of_nodes(shooting, z, shape.nodes)
        return solution.jacobian, estimate.error

    @cached_property
    def _solved_shape(self) -> Shape:  # type: ignore[override]
        header, start, _, states = self.sizes
        steps = int(self._numbers[Native.STEPS])
        blocks = np.split(self._numbers[header + start :], np.cumsum((2 * steps, states * (steps + 1), states * steps)))
        right, left = (block.reshape(-1, states).T for block in blocks[1:3])
        return Shape(self._configuration, blocks[0].reshape(steps, 2), Nodes(right[:, :steps], left, right[:, steps]))

    def jacobian(self, s: float | None = None, side: int = 1) -> Array:
        """Derivative of the pose by actuation: see :meth:`Differentiable.jacobian`."""
        tip = self.length if s is None and side in (1, -1) else np.inf
        innermost = [
            i for i, tube in enumerate(self.robot.tubes) if tube.length + self.actuation.translations[i] >= tip
        ]
        found = self._tip_rates(innermost[0]) if innermost else None
        return super().jacobian(s, side) if found is None else found[0]

    def compliance(self, s: float | None = None, load_at: float | None = None, tube: int = 0) -> Array:
        """Derivative of the pose by a wrench: see :meth:`Differentiable.compliance`."""
        found = self._tip_rates(index(tube, "tube", len(self.robot.tubes))) if s is load_at is None else None
        return super().compliance(s, load_at, tube) if found is None else found[1]

    def _tip_rates(self, tube: int) -> tuple[Array, Array] | None:
        """Both at the tip, where this tube ends there; None where the slower way must be taken."""
        if tube not in self._rates:
            self._rates[tube] = None if self._problem is None else self._problem.derive(self, tube)
        return self._rates[tube]

    @cached_property
    def _second_variation(self) -> SecondVariation | None:
        if any(load.nonconservative for load in self.loads):
            return None
        found = None if self._problem is None else self._problem.stability(self)
        return found or self._solved_shape.second_variation

    @cached_property
    def tip_position(self) -> Array:
        """Position at ``s = length``, m, world frame."""
        header, start, _, states = self.sizes
        steps = int(self._numbers[Native.STEPS])
        first = header + start + 2 * steps + states * steps
        return self._numbers[first : first + 3] * self.length
