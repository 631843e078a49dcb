"""The compiled solver: robots and loads as tables of numbers, and calls through buffers."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..loads.gravity import DistributedMass, Gravity, PointMass
from ..loads.wrenches import DistributedLoad, Load, PointWrench
from ..robot.robot import Robot

_DOUBLES = ctypes.POINTER(ctypes.c_double)
_INTS = ctypes.POINTER(ctypes.c_int)


class _Robot(ctypes.Structure):
    _fields_ = (
        ("bending", _DOUBLES),
        ("torsional", _DOUBLES),
        ("pieces", _INTS),
        ("degree", ctypes.c_int),
        ("breaks", _DOUBLES),
        ("coefficients", _DOUBLES),
        ("position", _DOUBLES),
        ("orientation", _DOUBLES),
    )


class _Loads(ctypes.Structure):
    _fields_ = (("points", ctypes.c_int), ("spans", ctypes.c_int), ("point", _DOUBLES), ("span", _DOUBLES))


class _Asked(ctypes.Structure):
    _fields_ = (
        ("directions", _INTS),
        ("count", ctypes.c_int),
        ("tables", _DOUBLES),
        ("probes", _INTS),
        ("probe_count", ctypes.c_int),
    )


def _pointer(array: NDArray[Any]) -> Any:
    return array.ctypes.data_as(_INTS if array.dtype == np.intc else _DOUBLES)


class RobotTable:
    """A robot as the compiled solver reads it."""

    def __init__(self, robot: Robot) -> None:
        shapes = [tube.shape for tube in robot.tubes]
        degree = max(len(shape.coefficients) for shape in shapes) - 1
        padded = [np.pad(c, ((0, degree + 1 - len(c)), (0, 0), (0, 0))) for c in (s.coefficients for s in shapes)]
        self._arrays = {
            "bending": np.array([tube.bending_stiffness for tube in robot.tubes]),
            "torsional": np.array([tube.torsional_stiffness for tube in robot.tubes]),
            "pieces": np.concatenate(([0], np.cumsum([shape.coefficients.shape[1] for shape in shapes]))).astype(
                np.intc
            ),
            "breaks": np.concatenate([shape.breaks for shape in shapes]),
            "coefficients": np.concatenate([c.transpose(1, 0, 2).ravel() for c in padded]),
            "position": robot.base_pose[:3, 3].copy(),
            "orientation": robot.base_quaternion,
        }
        pointers = {name: _pointer(array) for name, array in self._arrays.items()}
        self._struct = _Robot(degree=degree, **pointers)
        self.address = ctypes.addressof(self._struct)


class LoadRows:
    """Loads as the compiled solver reads them; ``rows`` says in which row a load's own numbers stand."""

    def __init__(
        self, points: list[tuple[float, ...]], spans: list[tuple[float, ...]], rows: dict[int, int] | None = None
    ) -> None:
        self.rows = rows or {}
        self._point, self._span = np.array(points, dtype=np.float64), np.array(spans, dtype=np.float64)
        self._struct = _Loads(len(points), len(spans), _pointer(self._point), _pointer(self._span))
        self.address = ctypes.addressof(self._struct)

    def placed(self, points: list[int], s: NDArray[np.float64]) -> LoadRows:
        """The same with some rows of points at other arc lengths."""
        other = copy(self)
        other._point = self._point.copy()
        other._point[points, 0] = s
        other._struct = _Loads(len(other._point), len(self._span), _pointer(other._point), _pointer(self._span))
        other.address = ctypes.addressof(other._struct)
        return other

    def numbers(self, load: Load | None, row: int, field: str) -> NDArray[np.float64]:
        """A view of a load's numbers, in the row where it stands, or of a probe's (None): may be written to."""
        spans = isinstance(load, (DistributedLoad, DistributedMass))
        table, first = (self._span, 4) if spans else (self._point, 3)
        parts = {"arc_length": slice(0, 1), "force": slice(first, first + 3), "moment": slice(first + 3, first + 6)}
        return np.asarray(table[row, parts[field]])

    @classmethod
    def of(
        cls, robot: Robot, loads: Sequence[Load], probes: Sequence[tuple[float | None, int]] = ()
    ) -> LoadRows | None:
        """The loads, or None where there are some that the compiled solver does not know.

        ``probes`` are places, an arc length (or None: the end) and a tube, which come first, as point loads of zero.
        """
        points: list[tuple[float, ...]] = [(np.nan if s is None else s, tube, *(0.0,) * 7) for s, tube in probes]
        spans: list[tuple[float, ...]] = []
        rows: dict[int, int] = {}
        gravity = sum((load.acceleration for load in loads if isinstance(load, Gravity)), np.zeros(3))
        for k, load in enumerate(loads):
            rows[k] = len(points if isinstance(load, (PointWrench, PointMass)) else spans)
            if isinstance(load, PointWrench):
                points.append(_row(load.arc_length, None, load, load.force, load.moment))
            elif isinstance(load, PointMass):
                points.append(_row(load.arc_length, None, load, load.mass * gravity))
            elif isinstance(load, DistributedMass):
                spans.append(_row(load.start, load.end, load, load.mass_per_length * gravity))
            elif isinstance(load, Gravity):
                weights = [(i, tube.mass_per_length * load.acceleration) for i, tube in enumerate(robot.tubes)]
                spans += [(0.0, np.nan, i, 0.0, *weight, 0.0, 0.0, 0.0) for i, weight in weights if weight.any()]
            elif isinstance(load, DistributedLoad) and all(
                isinstance(f, np.ndarray) for f in (load.force, load.moment)
            ):
                spans.append(_row(load.start, load.end, load, load.force, load.moment))
            else:
                return None
        return cls(points, spans, rows)


def _row(s: float | None, end: float | None, load: Any, force: Any, moment: Any = (0.0, 0.0, 0.0)) -> tuple[float, ...]:
    """A point load or, with an end, a distributed one; what rides on the tube's end is not a number."""
    body = getattr(load, "frame", "world") == "body"
    places = (s,) if isinstance(load, (PointWrench, PointMass)) else (s, end)
    return (*(np.nan if x is None else x for x in places), load.tube, body, *_floats(force), *_floats(moment))


def _floats(vector: Any) -> Any:
    return vector.tolist() if isinstance(vector, np.ndarray) else vector


class Questions:
    """What is asked of the model, one experiment after the other; see ``native/directions.h``.

    ``directions (experiments, k, 3)``: kinds, indices and components; ``tables``: changes of the robot's coefficients;
    ``probes (experiments, k, 2)``: rows of point loads, and tubes.
    """

    KINDS = (
        *("bending", "torsional", "rotation", "translation", "position", "turn"),
        *("force", "moment", "place", "span_force", "span_moment", "precurvature"),
    )

    def __init__(self, directions: NDArray[Any], tables: NDArray[Any], probes: NDArray[Any]) -> None:
        self._arrays = [np.ascontiguousarray(each, dtype=np.intc) for each in (directions, probes)]
        self._tables = np.ascontiguousarray(tables, dtype=np.float64)
        asked, places = self._arrays
        counts = asked.shape[1], places.shape[1]
        rows = zip(asked, places, strict=True)
        self._structs = (_Asked * len(asked))(
            *(_Asked(_pointer(a), counts[0], _pointer(self._tables), _pointer(b), counts[1]) for a, b in rows)
        )
        first, size = ctypes.addressof(self._structs), ctypes.sizeof(_Asked)
        self._addresses = np.array([first + size * k for k in range(len(asked))], dtype=np.uintp)
        self.addresses = self._addresses.ctypes.data


class Goal(ctypes.Structure):
    """What a solve must meet: position error over length, and scaled residual."""

    _fields_ = (("error", ctypes.c_double), ("residual", ctypes.c_double))


_ADDRESS, _LONG, _INT = ctypes.c_void_p, ctypes.c_long, ctypes.c_int


class Native:
    """The functions of a compiled library and the layout of what they return; see ``native/driver.c``.

    All take addresses; ``0`` is success, ``TOO_SMALL`` asks for a result of ``NEEDED`` numbers.
    """

    TOO_SMALL = 3
    ITERATIONS, RESIDUAL, ERROR, STEPS, LENGTH, REFINEMENTS, NEEDED, COLD = range(8)

    def __init__(self, library: ctypes.CDLL) -> None:
        def function(name: str, *arguments: Any) -> Any:
            found = getattr(library, name)
            found.argtypes, found.restype = arguments, _INT
            return found

        case = (_ADDRESS, _ADDRESS, _ADDRESS)  # robot, loads, actuation
        self.warm = function("warm", *case, _ADDRESS, _ADDRESS, _ADDRESS, _LONG)
        self.cold = function("cold", *case, _ADDRESS, _ADDRESS, _LONG)
        self.many = function("many", *case, _INT, _ADDRESS, _INT, _ADDRESS, _ADDRESS, _LONG, _ADDRESS)
        self.derive = function("derive", *case, _ADDRESS, _INT, _INT, _ADDRESS, _ADDRESS)
        self.models = function("models", *case, _ADDRESS, _INT, _INT, *[_ADDRESS] * 10)
        self.stability = function("stability", *case, _ADDRESS, ctypes.POINTER(ctypes.c_double))
        self.inspect = function("inspect", *case, _ADDRESS, _ADDRESS)
        self.integrate = function("integrate", *case, _ADDRESS, _INT, _INT, _ADDRESS)
        numbers = (_INT * 3)()
        library.sizes(numbers)
        self.states, self.unknowns, self.header = numbers
        self.start = self.unknowns * (self.unknowns + 2) + 2

    def size(self, steps: int) -> int:
        """Numbers in the result of a solve with so many steps."""
        return self.header + self.start + 2 * steps + self.states * (2 * steps + 1)
