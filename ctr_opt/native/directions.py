"""Parameters as combinations of the directions that compiled code knows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from ..checks import Array
from ..errors import DefinitionError
from ..loads.kind import Load, lowered
from ..mechanics.law import Stiffness
from ..robot.names import parsed
from ..robot.precurvature import Arc, PolynomialCurvature, PrecurvaturePiece, SampledCurvature
from ..robot.robot import Robot
from ..robot.tube import STIFFNESSES, Tube
from .abi import By

Row = tuple[int, int, int]
_STEP = 1e-30j  # so small that real parts stay as they are
_SOURCES = ("youngs_modulus", "shear_modulus", "poisson_ratio", "outer_diameter", "inner_diameter")


@attrs.frozen(eq=False)
class Directions:
    """Directions, the changes of precurvature among them, and parameters as combinations ``(rows, parameters)``."""

    rows: list[Row]
    tables: Array
    combination: Array

    @classmethod
    def of(
        cls,
        robot: Robot,
        loads: Sequence[Load],
        load_rows: Mapping[int, int],
        names: Sequence[str],
        probes: int,
    ) -> Directions:
        """Those of the named parameters; ``load_rows`` says in which row each load stands, behind the probes'."""
        made = _Collected(robot)
        for name in names:
            made.add(name, loads, load_rows, probes)
        combination = np.zeros((len(made.rows), len(made.columns)))
        for column, parts in enumerate(made.columns):
            for row, weight in parts.items():
                combination[row, column] = weight
        return cls(list(made.rows), np.array(made.tables), combination)


def supported(name: str, robot: Robot, loads: Sequence[Load] = ()) -> bool:
    """Whether compiled code takes derivatives by this parameter.

    By ``rotations``, ``translations``, ``base.translation``, ``base.rotation``; stiffnesses, moduli and, without
    weights, diameters of tubes; curvatures and coefficients of their pieces; force, moment and arc length of point
    wrenches, arc lengths of point masses, force and moment of constant distributed loads.
    """
    return _of(name, robot, loads) is not None


class _Collected:
    """Directions without repetition, and what each number of a parameter takes of them."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.rows: dict[Row, int] = {}
        self.tables: list[Array] = []
        self.columns: list[dict[int, float]] = []

    def add(self, name: str, loads: Sequence[Load], load_rows: Mapping[int, int], probes: int) -> None:
        """The directions of a parameter."""
        match parsed(name):
            case ("probes", int(k), "arc_length") if k < probes:
                self.plain(By.PLACE, [(k, 0)])
                return
        add = _of(name, self.robot, loads)
        if add is None:
            raise DefinitionError(f"{name!r}: compiled code takes no derivatives by it")
        add(self, load_rows)

    def _number(self, parts: Mapping[Row, float]) -> None:
        self.columns.append({self.rows.setdefault(row, len(self.rows)): weight for row, weight in parts.items()})

    def plain(self, kind: By, places: Sequence[tuple[int, int]]) -> None:
        """One direction for each number."""
        for place in places:
            self._number({(kind, *place): 1.0})

    def stiffness(self, i: int, rates: Mapping[str, float]) -> None:
        """A number on which stiffnesses of a tube depend."""
        names = Stiffness.names()
        self._number({(By.STIFFNESS, i, names.index(name)): rate for name, rate in rates.items() if rate != 0.0})

    def curvature(self, i: int, k: int) -> None:
        """The numbers of a piece of precurvature."""
        shapes = [tube.shape for tube in self.robot.tubes]
        counts = [shape.coefficients.shape[1] for shape in shapes]
        degree = max(len(shape.coefficients) for shape in shapes)
        pieces = self.robot.tubes[i].precurvature
        first = sum(counts[:i]) + sum(piece.polynomial().coefficients.shape[1] for piece in pieces[:k])
        for basis in _basis(pieces[k]):  # (degree + 1, pieces)
            for r in range(3):
                table = np.zeros((sum(counts), degree, 3))
                table[first : first + basis.shape[1], : len(basis), r] = basis.T
                self._number({(By.PRECURVATURE, len(self.tables), i): 1.0})
                self.tables.append(table)


def _basis(piece: PrecurvaturePiece) -> list[Array]:
    """The polynomials ``(degree + 1, pieces)`` that the rows of a piece's numbers multiply."""
    if isinstance(piece, SampledCurvature):
        return list(np.moveaxis(piece.basis(), -1, 0))
    if isinstance(piece, PolynomialCurvature):
        return list(np.diag(piece.length ** -np.arange(float(len(piece.coefficients))))[:, :, None])
    return [np.ones((1, 1))]


_Added = Callable[[_Collected, Mapping[int, int]], None]


def _of(name: str, robot: Robot, loads: Sequence[Load]) -> _Added | None:
    """What adds the directions of a parameter, or None."""
    tubes, axes = range(len(robot.tubes)), range(3)
    match parsed(name):
        case ("rotations" | "translations" as actuated,):
            return lambda made, _: made.plain(By[actuated[:-1].upper()], [(i, 0) for i in tubes])
        case ("base", "translation" | "rotation" as field):
            kind = By.POSITION if field == "translation" else By.TURN
            return lambda made, _: made.plain(kind, [(0, r) for r in axes])
        case ("loads", int(j), str(field)) if j < len(loads):
            return _of_load(j, field, robot, loads)
        case ("tubes", int(i), "precurvature", int(k), str(field)) if i < len(robot.tubes):
            return _of_piece(robot, i, k, field)
        case ("tubes", int(i), str(field)) if i < len(robot.tubes):
            return _of_tube(robot.tubes[i], i, field, loads)
    return None


def _of_piece(robot: Robot, i: int, k: int, field: str) -> _Added | None:
    pieces = robot.tubes[i].precurvature
    kinds = {"curvature": (Arc, SampledCurvature), "coefficients": (PolynomialCurvature,)}.get(field, ())
    if k >= len(pieces) or not isinstance(pieces[k], kinds):
        return None
    return lambda made, _: made.curvature(i, k)


def _of_load(j: int, field: str, robot: Robot, loads: Sequence[Load]) -> _Added | None:
    """Of a load that comes to one row, those of its numbers that stand there as they are."""
    load, pushes = loads[j], [push for k, push in lowered(robot, loads) if k == j]
    if len(pushes) != 1 or not pushes[0].constant or field not in load.fields:
        return None
    (push,), given = pushes, getattr(load, field)
    spans = "SPAN_" if len(push.places) > 1 else ""
    if field in ("force", "moment") and getattr(push, field) is given:
        return lambda made, rows: made.plain(By[spans + field.upper()], [(rows[j], r) for r in range(3)])
    if field in push.places and not spans and given is not None:
        return lambda made, rows: made.plain(By.PLACE, [(rows[j], 0)])
    return None


def _of_tube(tube: Tube, i: int, field: str, loads: Sequence[Load]) -> _Added | None:
    if field in Stiffness.names():
        return lambda made, _: made.stiffness(i, {field: 1.0})
    heavy = tube.density > 0.0 and any(load.pulls for load in loads)
    if field not in _SOURCES or (heavy and field.endswith("diameter")) or getattr(tube, field) is None:
        return None
    return lambda made, _: made.stiffness(i, _stiffness_rates(tube, field))


def _stiffness_rates(tube: Tube, field: str) -> dict[str, float]:
    """Derivatives of the stiffnesses by a modulus or a diameter, by a complex step; none of one that is given."""

    def number(name: str) -> Any:
        value = getattr(tube, name)
        return value + _STEP if name == field else value

    rates = {name: rule(number) for name, rule in STIFFNESSES.items() if name not in tube.given_stiffnesses}
    return {name: complex(rate).imag / _STEP.imag for name, rate in rates.items()}
