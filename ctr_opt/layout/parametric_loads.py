"""Loads with parameters for numbers, and the break points where they act, begin and end."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import attrs
import casadi as ca
import numpy as np

from ..loads.density import LoadTable
from ..loads.kind import Load, Push, pushes_of
from ..robot import tube as formulas
from .ordering import AHEAD, ENTRY, PASSED, Key

if TYPE_CHECKING:
    from .parametric import Parametric


@attrs.frozen(eq=False)
class Density:
    """A load per arc length: ``rows[j] + slopes[j] (s - arc_length[j])`` behind knot ``j``; or a ``function``."""

    knots: list[Key] = attrs.field(factory=list)
    arc_length: list[float] = attrs.field(factory=list)
    rows: list[Any] = attrs.field(factory=list)
    slopes: list[Any] = attrs.field(factory=list)
    function: Any = None


@attrs.frozen(eq=False)
class Placed:
    """A push with parameters for numbers: at the point ``start``, or up to ``end`` with a :class:`Density`."""

    push: Push
    start: Key
    end: Key | None


class ParametricLoads:
    """What the loads of a parametric robot come to, dead, body and expressed ones."""

    def __init__(self, of: Parametric) -> None:
        self.of = of
        loads = of.configuration.loads
        pulling = [self._number(k, load, load.pulls) for k, load in enumerate(loads) if load.pulls]
        gravity, masses = sum(pulling, ca.DM.zeros(3)), self._masses() if pulling else []
        numbers = [partial(self._number, k, load) for k, load in enumerate(loads)]
        self.placed = [self._placed(k, loads[k], push) for k, push in pushes_of(loads, numbers, gravity, masses)]

    def _number(self, k: int, load: Load, field: str) -> Any:
        """A load's number: a scalar, a column, a table of columns, or a function."""
        given, name = getattr(load, field), f"loads[{k}].{field}"
        if isinstance(given, LoadTable):
            return LoadTable(given.arc_length, self.of.rows(name))
        if callable(given):
            return given
        return self.of.vector(name) if np.ndim(given) else self.of.at(name)

    def _masses(self) -> list[Any]:
        """The tubes' masses per length; None where there is none."""
        masses = []
        for i, tube in enumerate(self.of.configuration.robot.tubes):
            name = f"tubes[{i}]."
            area = formulas.cross_section(self.of.at(name + "outer_diameter"), self.of.at(name + "inner_diameter"))
            heavy = tube.density > 0.0 or name + "density" in self.of.values
            masses.append(self.of.at(name + "density") * area if heavy else None)
        return masses

    def _placed(self, k: int, load: Load, push: Push) -> Placed:
        start, *end = (self._point(k, field, load.where(field), push.tube) for field in push.places)
        if not end:
            return Placed(push, start, None)
        force, moment = (
            self._density(k, load, field, getattr(push, field), end[0], push.tube) for field in ("force", "moment")
        )
        return Placed(push._replace(force=force, moment=moment), start, end[0])

    def _point(self, k: int, field: str, nominal: float | None, tube: int) -> Key:
        """The break point where a load acts, begins or ends."""
        name = f"loads[{k}].{field}"
        if nominal is None:
            return self.of.tube_end(tube)
        if nominal == 0.0 and name not in self.of.values:
            return ENTRY
        end, value = self.of.points[self.of.tube_end(tube)], self.of.at(name)
        self.of.within.append(end - value)
        return self.of.add(("load", k, field), value, min(nominal, float(self.of.configuration.tube_ends[tube])), end)

    def _density(self, k: int, load: Load, field: str, value: Any, end: Key, tube: int) -> Density:
        if not isinstance(value, LoadTable):
            return Density(function=value) if callable(value) else Density(rows=[ca.SX(value)])
        places, rows, first = value.arc_length.tolist(), list(value.values), load.where("start") or 0.0
        slopes = [(b - a) / float(h) for a, b, h in zip(rows, rows[1:], np.diff(value.arc_length), strict=False)]
        knots: list[Key] = []
        for m, s in enumerate(places):
            if not self.of.clip and not first <= s <= self.of.nominal[end]:
                knots.append(PASSED if s < first else AHEAD)
            else:
                knots.append(self.of.add(("knot", k, field, m), s, s, self.of.points[self.of.tube_end(tube)]))
        return Density(knots, places, rows, slopes)
