"""Parameters as combinations of the directions of change that compiled code supports."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import attrs
import numpy as np

from ..checks import Array
from ..errors import DefinitionError
from ..loads.kind import Load, lowered
from ..mechanics.law import Stiffness
from ..robot.names import parsed
from ..robot.precurvature import Piece
from ..robot.robot import Robot
from ..robot.tube import SOURCES, STIFFNESSES, Tube
from .abi import By

_Row: TypeAlias = tuple[By, int, int]
_Parts: TypeAlias = Mapping[_Row, float]  # a number as a combination of directions
_STEP = 1e-30j  # so small that real parts do not change


@attrs.frozen(eq=False)
class Directions:
    """Directions, tables of changes of precurvature, and parameters as combinations ``(rows, parameters)``."""

    rows: list[_Row]
    tables: Array
    combination: Array

    @classmethod
    def of(cls, robot: Robot, loads: Sequence[Load], load_rows: Mapping[int, int], names: Sequence[str]) -> Directions:
        """The directions of the named parameters; ``load_rows`` maps loads to rows, behind those of the probes."""
        columns: list[_Parts] = []
        tables: list[Array] = []
        for name in names:
            numbers = _numbers(name, robot, loads, load_rows, tables)
            if numbers is None:
                raise DefinitionError(f"{name!r}: compiled code does not support derivatives by this parameter")
            columns += numbers
        rows = list(dict.fromkeys(row for parts in columns for row in parts))
        combination = np.array([[parts.get(row, 0.0) for parts in columns] for row in rows])
        return cls(rows, np.array(tables), combination.reshape(len(rows), len(columns)))


def supported(name: str, robot: Robot, loads: Sequence[Load] = ()) -> bool:
    """Whether compiled code supports derivatives by this parameter.

    It supports ``rotations``, ``translations``, ``base.translation`` and ``base.rotation``; stiffnesses, moduli and
    (without weight) diameters of tubes; curvatures and coefficients of their pieces; force, moment and arc length of
    point wrenches; arc lengths of point masses; force and moment of constant distributed loads.
    """
    return _numbers(name, robot, loads, dict.fromkeys(range(len(loads)), 0), []) is not None


def _plain(kind: By, places: Iterable[tuple[int, int]]) -> list[_Parts]:
    """One direction for each of the numbers at ``places``."""
    return [{(kind, *place): 1.0} for place in places]


def _numbers(
    name: str, robot: Robot, loads: Sequence[Load], load_rows: Mapping[int, int], tables: list[Array]
) -> list[_Parts] | None:
    """The numbers of a parameter, None if not supported; its changes of precurvature are added to ``tables``."""
    match parsed(name):
        case ("rotations" | "translations" as actuated,):
            return _plain(By[actuated[:-1].upper()], ((i, 0) for i in range(len(robot.tubes))))
        case ("base", "translation" | "rotation" as field):
            return _plain(By.POSITION if field == "translation" else By.TURN, ((0, r) for r in range(3)))
        case ("loads", int(j), str(field)) if j < len(loads):
            return _of_load(j, field, robot, loads, load_rows)
        case ("tubes", int(i), "precurvature", int(k), str(field)) if i < len(robot.tubes):
            return _of_piece(robot, i, k, field, tables)
        case ("tubes", int(i), str(field)) if i < len(robot.tubes):
            rates = _stiffness_rates(robot.tubes[i], field, loads)
            names = Stiffness.names()
            if rates is not None:
                return [{(By.STIFFNESS, i, names.index(k)): rate for k, rate in rates.items() if rate != 0.0}]
    return None


def _of_load(
    j: int, field: str, robot: Robot, loads: Sequence[Load], load_rows: Mapping[int, int]
) -> list[_Parts] | None:
    """The numbers of a load with a single row, if the row contains them unchanged."""
    load, pushes = loads[j], [push for k, push in lowered(robot, loads) if k == j]
    if len(pushes) != 1 or not pushes[0].constant or field not in load.fields:
        return None
    (push,), value = pushes, getattr(load, field)
    spans = "SPAN_" if len(push.places) > 1 else ""
    if field in ("force", "moment") and getattr(push, field) is value:
        return _plain(By[spans + field.upper()], ((load_rows[j], r) for r in range(3)))
    if field in push.places and not spans and value is not None:
        return _plain(By.PLACE, [(load_rows[j], 0)])
    return None


def _of_piece(robot: Robot, i: int, k: int, field: str, tables: list[Array]) -> list[_Parts] | None:
    """The numbers of a piece of precurvature."""
    pieces = robot.tubes[i].precurvature
    if k >= len(pieces) or field != pieces[k].rows:
        return None
    shapes, before = [tube.shape.coefficients for tube in robot.tubes], len(tables)
    counts = [shape.shape[1] for shape in shapes]
    first = sum(counts[:i]) + sum(piece.polynomial().coefficients.shape[1] for piece in pieces[:k])
    for basis in _basis(pieces[k]):  # (degree + 1, pieces)
        for r in range(3):
            tables.append(np.zeros((sum(counts), max(map(len, shapes)), 3)))
            tables[-1][first : first + basis.shape[1], : len(basis), r] = basis.T
    return _plain(By.PRECURVATURE, ((table, i) for table in range(before, len(tables))))


def _basis(piece: Piece) -> list[Array]:
    """The polynomials ``(degree + 1, pieces)`` that the rows of a piece's numbers multiply."""
    units = np.eye(len(np.atleast_2d(getattr(piece, piece.rows)))).tolist()
    return [np.array([coefficients for _, coefficients in piece.parts(unit)]).T for unit in units]


def _stiffness_rates(tube: Tube, field: str, loads: Sequence[Load]) -> dict[str, float] | None:
    """Derivatives of the stiffnesses by a stiffness, a modulus or a diameter; None if it changes more than these.

    They are taken by a complex step. Stiffnesses that the user gave have no derivatives.
    """
    if field in Stiffness.names():
        return {field: 1.0}
    heavy = tube.density > 0.0 and any(load.pulls for load in loads)
    if field not in SOURCES or (heavy and field.endswith("diameter")) or getattr(tube, field) is None:
        return None

    def number(name: str) -> Any:
        value = getattr(tube, name)
        return value + _STEP if name == field else value

    rates = {name: rule(number) for name, rule in STIFFNESSES.items() if name not in tube.given_stiffnesses}
    return {name: complex(rate).imag / _STEP.imag for name, rate in rates.items()}
