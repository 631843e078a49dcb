"""Solves by compiled code, called through buffers; result objects are built lazily."""

from __future__ import annotations

import ctypes
import threading
from functools import cached_property
from math import cos, sin
from time import perf_counter
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..checks import Array, frozen
from ..layout.configuration import Configuration
from ..layout.ends import Ends
from ..loads.kind import Load
from ..native.abi import Failure, Goal, Head
from ..native.calls import LoadRows, Native, robot_table
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from ..solvers.accuracy import estimate_error_of_nodes
from ..solvers.status import SolveStatus
from ..transcription.shape import Shape, Values
from ..transcription.shooting import NodeStates
from ..transcription.stability import SecondVariation
from .attempt import Attempt
from .record import BaseMoments, Outcome, PoseRate, PoseRates, SolvedRecord
from .settings import Settings

_TOO_FAR = (Failure.DIVERGED, Failure.SINGULAR, Failure.PERHAPS_ANOTHER_BRANCH)
_STEPS = 24  # room for this number of steps in a result, until one needs more


class PathEnded(Exception):  # noqa: N818 - never leaves this package
    """A continuation from another equilibrium ended on its way."""

    def __init__(self, reached: float, steps: int) -> None:
        super().__init__(f"at {reached:g} of the way, after {steps} steps")
        self.reached, self.steps = reached, steps


class CompiledProblem:
    """A robot and its settings for a compiled library; calls return None if the general solver must be used."""

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

    def solve(
        self, actuation: Actuation, loads: tuple[Load, ...], initial: Record | None, far: bool = False
    ) -> CompiledRecord | None:
        """Solve from another equilibrium, or from a cold start.

        With ``far`` the other equilibrium may be followed in steps; raises ``PathEnded`` if that ends on its way.
        """
        begin = perf_counter()
        start = None if initial is None else self._start(initial)
        rows, inputs = self._inputs(actuation, loads)
        if rows is None or (start is None and initial is not None):
            return None
        while True:
            size, room = self._room  # read together: another thread may make more room meanwhile
            numbers = room()  # created and located much faster than an array
            address = ctypes.addressof(numbers)
            if start is None:
                failed = self.native.cold(self._address, rows.address, inputs, self._goal, address, size)
            else:
                failed = self.native.warm(self._address, rows.address, inputs, start, self._goal, address, size)
            if not failed:
                record = CompiledRecord(self, actuation, loads, numbers, address, perf_counter() - begin)
                return None if start is None and self.rejects(record) else record
            if failed in _TOO_FAR and far and isinstance(initial, CompiledRecord):
                failed = self._travel(initial, rows, inputs, address, size)
                if not failed:
                    return CompiledRecord(self, actuation, loads, numbers, address, perf_counter() - begin)
                if failed == Failure.PATH_ENDED:
                    raise PathEnded(numbers[Head.REACHED], int(numbers[Head.STEPS_OF_PATH]))
            if failed != Failure.TOO_SMALL:
                return None
            self._make_room(2 * int(numbers[Head.NEEDED]))

    def _travel(self, initial: CompiledRecord, rows: LoadRows, inputs: int, address: int, size: int) -> int:
        """Follow another equilibrium in steps; why that failed, or 0."""
        before = rows if initial.loads == self._mine.loads else LoadRows.of(self.robot, initial.loads)
        if before is None:
            return Failure.REFUSED
        joints = np.concatenate((initial.actuation.rotations, initial.actuation.translations))
        ways = (self._address, before.address, joints.ctypes.data, rows.address, inputs, initial.start)
        return int(self.native.travel(*ways, self._goal, address, size))

    def _make_room(self, size: int) -> None:
        self._room = size, ctypes.c_double * size

    def knows(self, loads: tuple[Load, ...]) -> bool:
        """Whether compiled code supports all of the loads."""
        return self._rows(loads) is not None

    def rejects(self, record: CompiledRecord) -> bool:
        """Whether a cold start's answer is rejected: it is unstable, and other ways remain."""
        if not (self._automatic and record.cold):
            return False
        counted = record.second_variation
        return counted is not None and counted.negative > 0

    def _start(self, initial: Record) -> int | None:
        """Address of the numbers that a solve starts from; None if it cannot start from this equilibrium."""
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
        """Many rows of actuations and loads; None if the compiled solver does not support some load."""
        tables: dict[int, LoadRows] = {}
        for row in loads:
            if id(row) not in tables:
                table = LoadRows.of(self.robot, row)
                if table is None:
                    return None
                tables[id(row)] = table
        return CompiledBatch(self, np.ascontiguousarray(actuations), loads, tables)

    def derive(self, of: CompiledRecord, wanted: PoseRate) -> PoseRates | None:
        """Derivatives of a pose; None if the general solver must compute them."""
        n, k = self._tubes, self.sizes.unknowns
        numbers, coincide = np.empty(12 * n + 36 + 2 * n * k), np.empty(n, dtype=np.intc)
        address = numbers.ctypes.data
        outputs = (address, address + 96 * n, address + 96 * n + 288, coincide.ctypes.data)  # of doubles
        point = (of.start, int(of.numbers[Head.REFINEMENTS]), wanted.side, _number(wanted.s), wanted.frame)
        if self.native.derive(*self._case(of), *point, _number(wanted.load_at), wanted.tube, *outputs):
            return None
        numbers.setflags(write=False)
        coincide.setflags(write=False)
        jacobian, compliance, unknowns = numbers[: 12 * n], numbers[12 * n : 12 * n + 36], numbers[12 * n + 36 :]
        shapes = jacobian.reshape(6, 2 * n), compliance.reshape(6, 6), unknowns.reshape(k, 2 * n)
        return PoseRates(*shapes, coincide)

    def sample(self, of: CompiledRecord, s: Array, left: NDArray[np.intc]) -> Array | None:
        """Values at ascending arc lengths, a row each (``Sizes.place``); None if the general solver must be used."""
        values = np.empty((len(s), self.sizes.place["energy"].stop))
        places = (of.address, len(s), s.ctypes.data, left.ctypes.data, values.ctypes.data)
        return None if self.native.sample(*self._case(of), *places) else values

    def push(self, of: CompiledRecord, tube: int, side: int) -> float | None:
        """The axial force of the actuator on a tube's base, N; None if the general solver must compute it."""
        if self._robot.values["degree"]:
            return None
        z, force = of.unknowns, ctypes.c_double()
        point = (z.ctypes.data, int(of.numbers[Head.REFINEMENTS]), tube, side, ctypes.addressof(force))
        return None if self.native.push(*self._case(of), *point) else force.value

    def inspect(self, of: CompiledRecord) -> tuple[Array, float] | None:
        """The exact Jacobian of the tip conditions, and the estimated error over the length."""
        k = self.sizes.unknowns
        out = np.empty(k * k + 1)
        failed = self.native.inspect(*self._case(of), of.address, out.ctypes.data)
        return None if failed else (out[:-1].reshape(k, k), float(out[-1]))

    def stability(self, of: CompiledRecord) -> SecondVariation | None:
        """The second variation of the potential energy; None if the general solver must compute it."""
        margin = ctypes.c_double()
        negative = self.native.stability(*self._case(of), of.address, ctypes.byref(margin))
        return None if negative < 0 else SecondVariation(negative, margin.value > 0.0, abs(margin.value))

    def _case(self, of: CompiledRecord) -> tuple[int, int, int]:
        """The addresses of a result's robot, loads and actuation."""
        rows, inputs = self._inputs(of.actuation, of.loads)
        assert rows is not None
        return self._address, rows.address, inputs

    def _inputs(self, actuation: Actuation, loads: tuple[Load, ...]) -> tuple[LoadRows | None, int]:
        """The loads as rows, and the address of the actuation."""
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
        """The loads as rows, made again only if they differ from those of the last call."""
        mine = self._mine.__dict__
        if mine.get("loads") != loads:
            mine["rows"], mine["loads"] = LoadRows.of(self.robot, loads), loads
        rows: LoadRows | None = mine["rows"]
        return rows


class CompiledBatch:
    """Many rows for a compiled solver, with memory for their results."""

    def __init__(
        self, problem: CompiledProblem, actuations: Array, loads: list[tuple[Load, ...]], tables: dict[int, LoadRows]
    ) -> None:
        count, size = len(actuations), problem._room[0]
        self._problem, self._actuations, self._loads, self._tables = problem, actuations, loads, tables
        self._addresses = np.array([tables[id(row)].address for row in loads], dtype=np.uintp)
        self._numbers, self._failed = np.empty((count, size)), np.empty(count, dtype=np.intc)

    def solve(self, first: int, before: Record | None, chained: bool) -> list[CompiledRecord | None]:
        """The equilibria of the rows from ``first`` on, up to a None for a row that needs the general solver.

        If the rows are not ``chained`` all are returned, with None for each that needs the general solver. The cold
        start of a chain needs it too, as its stability must be known before it is followed.
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
        records: list[CompiledRecord | None] = []
        for k, row in enumerate(actuations[:done]):
            actuation, loads = (row[:tubes], row[tubes:]), self._loads[first + k]
            record = CompiledRecord(problem, actuation, loads, numbers[k], address + 8 * size * k, seconds)
            records.append(None if lost[k] or (cold[k] and problem.rejects(record)) else record)
        return records


class CompiledRecord:
    """The record of a compiled solve, whose parts are built from the result's numbers on request.

    It has the members of a :class:`SolvedRecord`. It outlives the library, which belongs to one process.
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
        self._rates: dict[PoseRate, PoseRates | None] = {}
        self.sizes = problem.sizes
        self.address = address
        self.start = address + problem.offset  # address of the block that another solve may start from

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_problem": None, "_held": self.numbers}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.start += self.numbers.ctypes.data - self.address
        self.address = self.numbers.ctypes.data

    @cached_property
    def numbers(self) -> Array:
        """The numbers that the library wrote."""
        return frozen(np.asarray(self._held))

    @property
    def compiled(self) -> bool:
        """Whether the library is at hand; not in another process."""
        return self._problem is not None

    @property
    def refinements(self) -> int:
        """Number of times that the steps were halved."""
        return int(self.numbers[Head.REFINEMENTS])

    @property
    def _way(self) -> str:
        """The way that the solve took."""
        if self.cold:
            return "homotopy"
        return "continuation from initial" if self.numbers[Head.STEPS_OF_PATH] else "newton from initial"

    @property
    def cold(self) -> bool:
        """Whether the solve was a cold start."""
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
        """The part of the result from the beginning of one block to the beginning of another."""
        steps = int(self.numbers[Head.STEPS])
        return self.numbers[self.sizes.at(name, steps) : self.sizes.at(end, steps)]

    def _start(self, name: str) -> Array:
        return self._block("start", "mesh")[self.sizes.start[name]]

    @property
    def unknowns(self) -> Array:
        """Moments (N m) and force (N) at the base in the order of the equations."""
        return np.asarray(self._start("unknowns") * self.unit)

    @property
    def unit(self) -> Array:
        """Units of the unknowns, N m and N."""
        moment, force = self._start("units")
        unit = np.full(self.sizes.unknowns, moment)
        unit[2 + len(self.robot.tubes) :] = force
        return unit

    @cached_property
    def base(self) -> BaseMoments:
        """Moments and force at the base, by name."""
        return BaseMoments.of(self._start("unknowns"), self.configuration.scales, len(self.robot.tubes))

    @cached_property
    def outcome(self) -> Outcome:
        """The outcome of the solve."""
        jacobian, error = self._inspected
        return Outcome(
            SolveStatus.CONVERGED,
            (Attempt(self._way, int(self.numbers[Head.ITERATIONS])),),
            solve_time=self._time,
            residual_norm=float(self.numbers[Head.RESIDUAL]),
            discretization_error=error * self.length,
            jacobian=jacobian,
        )

    @cached_property
    def _inspected(self) -> tuple[Array, float]:
        """The Jacobian and the estimated error; the solve itself needs only a bound of the error."""
        inspected = None if self._problem is None else self._problem.inspect(self)
        if inspected is not None:
            return inspected
        configuration, shape = self.configuration, self.shape
        z = self.base.unknowns(configuration.scales, configuration.kind.live)
        estimate, solution = estimate_error_of_nodes(shape.shooting, z, shape.nodes)
        return solution.jacobian, estimate.error

    @cached_property
    def shape(self) -> Shape:
        """The states at the nodes."""
        mesh, states = self._block("mesh", "right").reshape(-1, 2), self.sizes.states
        right, left = (self._block(*ends).reshape(-1, states).T for ends in (("right", "left"), ("left", "size")))
        return _CompiledShape(self, mesh, NodeStates(right[:, :-1], left, right[:, -1]))

    def sample(self, s: Array, left: NDArray[np.intc]) -> Array | None:
        """Values at ascending arc lengths; None if the general solver must be used."""
        return None if self._problem is None else self._problem.sample(self, s, left)

    @cached_property
    def second_variation(self) -> SecondVariation | None:
        """The second variation of the potential energy; None without a potential."""
        if any(load.nonconservative for load in self.loads):
            return None
        counted = None if self._problem is None else self._problem.stability(self)
        return counted or self.shape.second_variation

    def rates(self, wanted: PoseRate) -> PoseRates | None:
        """Derivatives of a pose; None if the general solver must compute them."""
        if wanted not in self._rates:
            self._rates[wanted] = None if self._problem is None else self._problem.derive(self, wanted)
        return self._rates[wanted]

    def tip_rates(self, tube: int) -> PoseRates | None:
        """Derivatives of the tip's pose under a wrench on a tube, if that is the innermost there."""
        return self.rates(PoseRate(tube=tube)) if tube == self._innermost_at_tip else None

    def push(self, tube: int, side: int) -> float | None:
        """The axial force of the actuator on a tube's base, N; None if the general solver must compute it."""
        return None if self._problem is None else self._problem.push(self, tube, side)

    @cached_property
    def _tip_state(self) -> Array:
        """The state before any load at the tip, positions over the length."""
        end = self.sizes.at("left", int(self.numbers[Head.STEPS]))
        return self.numbers[end - self.sizes.states : end]

    @cached_property
    def tip_position(self) -> Array:
        """Position of the tip, m, world frame."""
        return frozen(self._tip_state[:3] * self.length)

    @cached_property
    def tip_pose(self) -> Array:
        """The tip's frame in the world, 4 x 4."""
        orientation, angles = 3, 7
        state = self._tip_state[: angles + len(self.robot.tubes)].tolist()
        pose = np.eye(4)
        pose[:3, :3] = _turned(state[orientation:angles], state[angles + self._innermost_at_tip])
        pose[:3, 3] = self.tip_position
        return frozen(pose)

    @cached_property
    def ends(self) -> Ends:
        """Where the tubes end."""
        return Ends.of_robot(self.robot, self.actuation.translations)

    @cached_property
    def _innermost_at_tip(self) -> int:
        """The innermost tube that ends at ``length``."""
        return Ends.tube_at_tip(self.robot, self.actuation.translations)


class _CompiledShape(Shape):
    """The shape of a compiled solve: values at places come from compiled code."""

    def __init__(self, record: CompiledRecord, mesh: Array, nodes: NodeStates) -> None:
        super().__init__(record.configuration, mesh, nodes)
        self._record = record

    def at(self, s: Array, from_left: NDArray[np.bool_] | bool = False) -> Values:
        """Values at ``s (k,)``: limits from the right; from the left on request and at ``length``."""
        left = np.broadcast_to(from_left, s.shape) | (s >= self.configuration.length)
        order = np.lexsort((~left, s))
        rows = self._record.sample(np.ascontiguousarray(s[order]), left[order].astype(np.intc))
        if rows is None:
            return super().at(s, from_left)
        sorted_back = np.empty_like(rows)
        sorted_back[order] = rows
        parts = {name: sorted_back[:, part].T for name, part in self._record.sizes.place.items()}
        return self.values(s, parts["state"], parts["bent"], parts["twisted"], parts["moments"], parts["energy"][0])


def _number(s: float | None) -> float:
    return np.nan if s is None else s


def _turned(quaternion: list[float], angle: float) -> Array:
    """The rotation ``R(q) Rz(angle)`` of a quaternion of any length."""
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
"""The record of an equilibrium."""
