"""Calls of the compiled solver: robots and loads as tables of numbers, results in buffers."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import CompilationError
from ..loads.kind import Load, Push, lowered
from ..mechanics.kind import Kind
from ..mechanics.law import Stiffness
from ..robot.robot import Robot
from . import abi

_POINT, _SPAN = abi.columns(abi.PointLoad), abi.columns(abi.SpanLoad)


def robot_table(robot: Robot) -> abi.Structure:
    """The table of a robot that the compiled solver reads."""
    shapes = [tube.shape for tube in robot.tubes]
    size = max(len(shape.coefficients) for shape in shapes)
    padded = [np.zeros((size, *shape.coefficients.shape[1:])) for shape in shapes]
    for rows, shape in zip(padded, shapes, strict=True):
        rows[: len(shape.coefficients)] = shape.coefficients
    return abi.Structure(
        abi.Robot,
        stiffness=np.array([[getattr(tube, name) for name in Stiffness.names()] for tube in robot.tubes]),
        pieces=np.cumsum([0, *(shape.coefficients.shape[1] for shape in shapes)], dtype=np.intc),
        degree=size - 1,
        breaks=np.concatenate([shape.breaks for shape in shapes]),
        coefficients=np.concatenate([c.transpose(1, 0, 2).ravel() for c in padded]),
        position=robot.base_pose[:3, 3].copy(),
        orientation=robot.base_quaternion,
    )


class LoadRows:
    """The tables of loads that the compiled solver reads; ``rows`` maps each load to the row of its numbers."""

    def __init__(
        self, points: list[tuple[float, ...]], spans: list[tuple[float, ...]], rows: dict[int, int] | None = None
    ) -> None:
        self.rows = rows or {}
        self._hold(np.array(points, dtype=np.float64), np.array(spans, dtype=np.float64))

    def _hold(self, point: NDArray[np.float64], span: NDArray[np.float64]) -> None:
        self._point, self._span = point, span
        self._table = abi.Structure(abi.Loads, points=len(point), spans=len(span), point=point, span=span)
        self.address = self._table.address

    def placed(self, points: list[int], s: NDArray[np.float64]) -> LoadRows:
        """A copy with some rows of points moved to other arc lengths."""
        moved = copy(self)
        point = self._point.copy()
        point[points, _POINT["s"]] = s[:, None]
        moved._hold(point, self._span)
        return moved

    def numbers(self, load: Load | None, row: int, field: str) -> NDArray[np.float64]:
        """A writable view of the numbers of a load, or of a probe (None), in a row."""
        spans = load is not None and "start" in load.places
        table, parts = (self._span, _SPAN) if spans else (self._point, _POINT)
        return np.asarray(table[row, parts["s" if field == "arc_length" else field]])

    @classmethod
    def of(cls, robot: Robot, loads: Sequence[Load], probes: Sequence[tuple[float, int]] = ()) -> LoadRows | None:
        """The tables of loads, or None if the compiled solver does not support some load.

        A probe is an arc length (NaN: the end) and a tube. Probes come first, as loads of zero.
        """
        points: list[tuple[float, ...]] = [(s, tube, *(0.0,) * 7) for s, tube in probes]
        spans: list[tuple[float, ...]] = []
        rows: dict[int, int] = {}
        if not all(isinstance(load, Load) for load in loads):
            return None
        for k, push in lowered(robot, loads):
            row = _row(loads[k], push)
            if row is None:
                return None
            table = points if len(push.places) == 1 else spans
            rows.setdefault(k, len(table))
            table.append(row)
        return cls(points, spans, rows)


def _row(load: Load, push: Push) -> tuple[float, ...] | None:
    """The row of a push, with NaN for places at the tube's end; None if it is not constant."""
    if not push.constant:
        return None
    places = (np.nan if s is None else s for s in map(load.where, push.places))
    return (*places, push.tube, push.body, *push.force.tolist(), *push.moment.tolist())


class Native:
    """The functions of a compiled library, which take addresses, and its sizes; see ``native/abi.py``.

    Raises
    ------
    CompilationError
        The library was not built for these structures.
    """

    def __init__(self, library: ctypes.CDLL, tubes: int, kind: Kind) -> None:
        self.library, self.sizes = library, abi.Sizes.of(tubes, kind)
        expected = self.sizes.expected
        numbers = (ctypes.c_int * len(expected))()
        library.sizes(numbers)
        if list(numbers) != expected:
            raise CompilationError(
                f"the compiled library for {tubes} tubes has other structures than ctr_opt.native.abi: its compiler "
                "must agree with that of Python; name another compiler in CC"
            )
        for name in abi.FUNCTIONS:
            function = getattr(library, name)
            function.argtypes, function.restype = abi.arguments(name), ctypes.c_int
            setattr(self, name, function)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"the compiled library has no function {name!r}")
