"""Solves by compiled code: called through buffers, answers made into objects only as far as they are looked at."""

from __future__ import annotations

import ctypes
import threading
from functools import cached_property
from math import cos, sin
from time import perf_counter
from typing import Any, TypeAlias

import numpy as np

from ..checks import Array
from ..layout.configuration import Configuration
from ..layout.ends import Ends
from ..loads.kind import Load
from ..mechanics.kind import built_once
from ..native.abi import Failure, Goal, Head
from ..native.calls import LoadRows, Native, robot_table
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from ..solvers.accuracy import estimate_error_of_nodes
from ..solvers.status import SolveStatus
from ..transcription.shape import Shape
from ..transcription.shooting import NodeStates
from ..transcription.stability import SecondVariation
from .attempt import Attempt
from .record import BaseMoments, Outcome, SolvedRecord
from .settings import Settings

_STEPS = 24  # room for so many steps in a result, until one needs more


class CompiledProblem:
    """A robot and settings before a compiled library: every call gives None where the slower way must be taken."""

    def __init__(self, robot: Robot, settings: Settings, native: Native) -> None:
        self.robot = robot
        self.native = native
        self._robot = robot_table(robot)
        self._address = self._robot.address
        self._tubes = len(robot.tubes)
        self.sizes = native.sizes
        self.offset = 8 * native.sizes.at("start", 0)
        self._make_room(native.sizes.at("size", _STEPS))
        self._automatic = settings.formulation == "automatic"
        self._tolerances = Goal(settings.tolerance, settings.compiled_residual)
        self._goal = ctypes.addressof(self._tolerances)
        self._mine = threading.local()

    def solve(self, actuation: Actuation, loads: tuple[Load, ...], initial: Record | None) -> CompiledRecord | None:
        """An equilibrium from another one, or from nothing."""
        begin = perf_counter()
        start = None if initial is None else self._start(initial)
        rows, inputs = self._inputs(actuation, loads)
        if rows is None or (start is None and initial is not None):
            return None
        while True:
            size, room = self._room  # read together: another thread may make more room meanwhile
            numbers = room()  # made and located much faster than an array
            address = ctypes.addressof(numbers)
            if start is None:
                failed = self.native.cold(self._address, rows.address, inputs, self._goal, address, size)
            else:
                failed = self.native.warm(self._address, rows.address, inputs, start, self._goal, address, size)
            if not failed:
                found = CompiledRecord(self, actuation, loads, numbers, address, perf_counter() - begin)
                return None if start is None and self.left(found) else found
            if failed != Failure.TOO_SMALL:
                return None
            self._make_room(2 * int(numbers[Head.NEEDED]))

    def _make_room(self, size: int) -> None:
        self._room = size, ctypes.c_double * size

    def knows(self, loads: tuple[Load, ...]) -> bool:
        """Whether there is compiled code for all of the loads."""
        return self._rows(loads) is not None

    def left(self, record: CompiledRecord) -> bool:
        """Whether an answer is not good enough for a cold start: it is unstable, and there are other ways to go."""
        if not (self._automatic and record.cold):
            return False
        counted = record.second_variation
        return counted is not None and counted.negative > 0

    def _start(self, initial: Record) -> int | None:
        """Address of the numbers that a solve starts from; None where it cannot start from this equilibrium."""
        if isinstance(initial, CompiledRecord):
            return initial.start if initial.sizes.unknowns == self.sizes.unknowns else None
        jacobian = initial.outcome.jacobian
        if jacobian is None or len(jacobian) != self.sizes.unknowns:
            return None
        configuration = initial.configuration
        scales = configuration.scales
        unknowns = initial.base.unknowns(scales, configuration.kind.live)
        parts = self.sizes.start
        block = np.zeros(parts["rotations"].stop)
        block[parts["unknowns"]], block[parts["jacobian"]] = unknowns, jacobian.ravel()
        block[parts["units"]] = scales.moment, scales.force
        block[parts["rotations"]] = initial.actuation.rotations
        self._mine.block = block  # kept until the solve is over
        return int(block.ctypes.data)

    def batch(self, actuations: Array, loads: list[tuple[Load, ...]]) -> CompiledBatch | None:
        """Many rows of actuations and loads; None where there are loads that the compiled solver does not know."""
        tables: dict[int, LoadRows] = {}
        for each in loads:
            if id(each) not in tables:
                table = LoadRows.of(self.robot, each)
                if table is None:
                    return None
                tables[id(each)] = table
        return CompiledBatch(self, np.ascontiguousarray(actuations), loads, tables)

    def derive(self, of: CompiledRecord, tube: int) -> tuple[Array, Array] | None:
        """The tip's pose rates with actuation ``(6, 2n)`` and with a wrench at the tip of a tube ``(6, 6)``."""
        jacobian, compliance = np.empty((6, 2 * self._tubes)), np.empty((6, 6))
        refinements = int(of.numbers[Head.REFINEMENTS])
        outputs = jacobian.ctypes.data, compliance.ctypes.data
        failed = self.native.derive(*self._case(of), of.start, refinements, tube, *outputs)
        return None if failed else (jacobian, compliance)

    def inspect(self, of: CompiledRecord) -> tuple[Array, float] | None:
        """The exact Jacobian of the tip conditions, and the estimated error over the length."""
        k = self.sizes.unknowns
        out = np.empty(k * k + 1)
        failed = self.native.inspect(*self._case(of), of.address, out.ctypes.data)
        return None if failed else (out[:-1].reshape(k, k), float(out[-1]))

    def stability(self, of: CompiledRecord) -> SecondVariation | None:
        """The second variation of the potential energy; None where the slower way must be taken."""
        margin = ctypes.c_double()
        negative = self.native.stability(*self._case(of), of.address, ctypes.byref(margin))
        return None if negative < 0 else SecondVariation(negative, margin.value > 0.0, abs(margin.value))

    def _case(self, of: CompiledRecord) -> tuple[int, int, int]:
        """The addresses of robot, loads and actuation of a result."""
        rows, inputs = self._inputs(of.actuation, of.loads)
        assert rows is not None
        return self._address, rows.address, inputs

    def _inputs(self, actuation: Actuation, loads: tuple[Load, ...]) -> tuple[LoadRows | None, int]:
        """Loads as rows and the address of the actuation."""
        mine = self._mine.__dict__
        rows = self._rows(loads)
        if "actuation" not in mine:
            mine["actuation"] = np.empty(2 * self._tubes)
            mine["address"] = mine["actuation"].ctypes.data
        inputs = mine["actuation"]
        inputs[: self._tubes] = actuation.rotations
        inputs[self._tubes :] = actuation.translations
        return rows, mine["address"]

    def _rows(self, loads: tuple[Load, ...]) -> LoadRows | None:
        """Loads as rows, made anew when they are others than last time."""
        mine = self._mine.__dict__
        if mine.get("loads") != loads:
            mine["rows"], mine["loads"] = LoadRows.of(self.robot, loads), loads
        rows: LoadRows | None = mine["rows"]
        return rows


class CompiledBatch:
    """Many rows before a compiled solver, and the room for their results."""

    def __init__(
        self, problem: CompiledProblem, actuations: Array, loads: list[tuple[Load, ...]], tables: dict[int, LoadRows]
    ) -> None:
        count, size = len(actuations), problem._room[0]
        self._problem, self._actuations, self._loads, self._tables = problem, actuations, loads, tables
        self._addresses = np.array([tables[id(each)].address for each in loads], dtype=np.uintp)
        self._numbers, self._failed = np.empty((count, size)), np.empty(count, dtype=np.intc)

    def solve(self, first: int, before: Record | None, chained: bool) -> list[CompiledRecord | None]:
        """The equilibria of the rows from ``first`` on, up to one that must take the slower way: None.

        Rows that are not ``chained`` are all there, with None for each that must take the slower way. So must a chain's
        cold start, as its stability is to be known before it is followed.
        """
        problem, count = self._problem, len(self._actuations) - first
        start = None if before is None else problem._start(before)
        if start is None and (chained or before is not None):
            return [None] * (1 if chained else count)
        actuations, numbers, failed = self._actuations[first:], self._numbers[first:], self._failed[first:]
        begin, size = perf_counter(), numbers.shape[1]
        case = (problem._address, self._addresses[first:].ctypes.data, actuations.ctypes.data, count)
        address, goal = numbers.ctypes.data, problem._goal
        done = problem.native.many(*case, start, chained, goal, address, size, failed.ctypes.data)
        seconds, tubes = (perf_counter() - begin) / max(done, 1), actuations.shape[1] // 2
        cold, lost = numbers[:done, Head.COLD].tolist(), failed[:done].tolist()
        found: list[CompiledRecord | None] = []
        for k, row in enumerate(actuations[:done]):
            actuation, loads = (row[:tubes], row[tubes:]), self._loads[first + k]
            each = CompiledRecord(problem, actuation, loads, numbers[k], address + 8 * size * k, seconds)
            found.append(None if lost[k] or (cold[k] and problem.left(each)) else each)
        return found


class CompiledRecord:
    """The record of a compiled solve: its parts are made of the result's numbers when they are asked for.

    It has the members of a :class:`SolvedRecord`, and outlives the library, which is of one process.
    """

    status = SolveStatus.CONVERGED

    def __init__(
        self,
        problem: CompiledProblem,
        actuation: Actuation | tuple[Array, Array],
        loads: tuple[Load, ...],
        numbers: Array | ctypes.Array[ctypes.c_double],
        address: int,
        solve_time: float,
    ) -> None:
        self._problem: CompiledProblem | None = problem
        self.robot, self._actuation, self.loads = problem.robot, actuation, loads
        self._held = numbers
        self._time = solve_time
        self.sizes = problem.sizes
        self.address = address
        self.start = address + problem.offset  # of the block that another solve may start from

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_problem": None, "_held": self.numbers}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.start += self.numbers.ctypes.data - self.address
        self.address = self.numbers.ctypes.data

    @cached_property
    def numbers(self) -> Array:
        """The result as the library left it."""
        return np.asarray(self._held)

    @property
    def cold(self) -> bool:
        """Whether it was found from nothing."""
        return bool(self.numbers[Head.COLD])

    @property
    def actuation(self) -> Actuation:
        """The actuation."""
        if isinstance(self._actuation, tuple):
            self._actuation = Actuation(*self._actuation)
        return self._actuation

    @property
    def length(self) -> float:
        """Arc length from the entry point to the tip, m."""
        return float(self.numbers[Head.LENGTH])

    @cached_property
    def configuration(self) -> Configuration:
        """Robot, actuation and loads as numbers along the arc length."""
        return Configuration(self.robot, self.actuation, self.loads)

    def _block(self, name: str, end: str) -> Array:
        """The part of the result that begins with a block and ends where another one begins."""
        steps = int(self.numbers[Head.STEPS])
        return self.numbers[self.sizes.at(name, steps) : self.sizes.at(end, steps)]

    def _start(self, name: str) -> Array:
        return self._block("start", "mesh")[self.sizes.start[name]]

    @property
    def unknowns(self) -> Array:
        """Moments, N m, and force, N, at the base in the order of the equations."""
        z, (moment, force) = self._start("unknowns"), self._start("units")
        moments = 2 + len(self.robot.tubes)
        return np.concatenate((z[:moments] * moment, z[moments:] * force))

    @cached_property
    def base(self) -> BaseMoments:
        """The same, by what they are."""
        return BaseMoments.of(self._start("unknowns"), self.configuration.scales, len(self.robot.tubes))

    @cached_property
    def outcome(self) -> Outcome:
        """How the solve went."""
        jacobian, error = self._inspected
        return Outcome(
            SolveStatus.CONVERGED,
            (Attempt("homotopy" if self.cold else "newton from initial", int(self.numbers[Head.ITERATIONS])),),
            solve_time=self._time,
            residual_norm=float(self.numbers[Head.RESIDUAL]),
            discretization_error=error * self.length,
            jacobian=jacobian,
        )

    @cached_property
    def _inspected(self) -> tuple[Array, float]:
        """What a solve leaves for later: the Jacobian and the estimated error, of which it only needs a bound."""
        inspected = None if self._problem is None else self._problem.inspect(self)
        if inspected is not None:
            return inspected
        own, shape = self.configuration, self.shape
        z = self.base.unknowns(own.scales, own.kind.live)
        estimate, solution = estimate_error_of_nodes(shape.shooting, z, shape.nodes)
        return solution.jacobian, estimate.error

    @cached_property
    def shape(self) -> Shape:
        """The states at the nodes."""
        mesh, states = self._block("mesh", "right").reshape(-1, 2), self.sizes.states
        right, left = (self._block(*ends).reshape(-1, states).T for ends in (("right", "left"), ("left", "size")))
        return Shape(self.configuration, mesh, NodeStates(right[:, :-1], left, right[:, -1]))

    @cached_property
    def second_variation(self) -> SecondVariation | None:
        """Of the potential energy; None where there is none."""
        if any(load.nonconservative for load in self.loads):
            return None
        counted = None if self._problem is None else self._problem.stability(self)
        return counted or self.shape.second_variation

    def tip_rates(self, tube: int | None = None) -> tuple[Array, Array] | None:
        """Derivatives of the tip's pose by actuation and by a wrench, where this tube (None: the innermost) ends there.

        None where the slower way must be taken.
        """
        return self._tip_rates(self._innermost_at_tip if tube is None else tube)

    @built_once
    def _tip_rates(self, tube: int) -> tuple[Array, Array] | None:
        return None if self._problem is None else self._problem.derive(self, tube)

    @property
    def one_sided(self) -> bool:
        """Whether it is known that derivatives at the tip have sides."""
        return self._problem is not None and self.tip_rates() is None

    @cached_property
    def _tip_state(self) -> Array:
        """The state before any load at the tip, positions over the length."""
        end = self.sizes.at("left", int(self.numbers[Head.STEPS]))
        return self.numbers[end - self.sizes.states : end]

    @cached_property
    def tip_position(self) -> Array:
        """Position of the tip, m, world frame."""
        return self._tip_state[:3] * self.length

    @cached_property
    def tip_pose(self) -> Array:
        """The tip's frame in the world, 4 x 4."""
        orientation, angles = 3, 7
        state = self._tip_state[: angles + len(self.robot.tubes)].tolist()
        pose = np.eye(4)
        pose[:3, :3] = _turned(state[orientation:angles], state[angles + self._innermost_at_tip])
        pose[:3, 3] = self.tip_position
        return pose

    @cached_property
    def _innermost_at_tip(self) -> int:
        """The innermost tube that ends at ``length``."""
        return Ends.tube_at_tip(self.robot, self.actuation.translations)


def _turned(quaternion: list[float], angle: float) -> Array:
    """``R(q) Rz(angle)`` of a quaternion of any length."""
    w, x, y, z = quaternion
    c, s = cos(0.5 * angle), sin(0.5 * angle)
    w, x, y, z = w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s
    k = 2.0 / (w * w + x * x + y * y + z * z)
    return np.array(
        [
            [1.0 - k * (y * y + z * z), k * (x * y - w * z), k * (x * z + w * y)],
            [k * (x * y + w * z), 1.0 - k * (x * x + z * z), k * (y * z - w * x)],
            [k * (x * z - w * y), k * (y * z + w * x), 1.0 - k * (x * x + y * y)],
        ]
    )


Record: TypeAlias = SolvedRecord | CompiledRecord
"""What an equilibrium may be made of."""
