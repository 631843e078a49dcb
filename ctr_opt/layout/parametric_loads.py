"""Loads with parameters for numbers, and the break points where they act, begin and end."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import attrs
import casadi as ca
import numpy as np

from ..loads.fields import ExpressionLoad, PotentialLoad
from ..loads.gravity import DistributedMass, Gravity, PointMass
from ..loads.wrenches import DistributedLoad, Load, LoadTable, PointWrench
from ..mechanics.fields import Field
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
class Push:
    """A load of given direction: at the point ``start``, where there is no ``end``, or between two break points."""

    start: Key
    end: Key | None
    tube: int
    body: bool
    force: Any
    moment: Any


@attrs.frozen(eq=False)
class FieldPush:
    """A load given as an expression, likewise."""

    start: Key
    end: Key | None
    field: Field
    factor: Any


class ParametricLoads:
    """The loads of a parametric robot: dead and body ones as ``pushes``, expressions as ``fields``."""

    def __init__(self, of: Parametric) -> None:
        self.of = of
        self.gravity = sum(
            (
                of.vector(f"loads[{k}].acceleration")
                for k, load in enumerate(of.configuration.loads)
                if isinstance(load, Gravity)
            ),
            ca.DM.zeros(3),
        )
        self.pushes: list[Push] = []
        self.fields: list[FieldPush] = []
        for k, load in enumerate(of.configuration.loads):
            self._place(k, load)

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

    def _place(self, k: int, load: Load) -> None:
        name = f"loads[{k}]"
        if isinstance(load, Gravity):
            self._place_weights(k)
            return
        begin, stop = self._points_of(k, load)
        if isinstance(load, (PotentialLoad, ExpressionLoad)):
            if load.factor != 0.0:
                self.fields.append(FieldPush(begin, stop, Field.of(load), self.of.at(f"{name}.factor")))
            return
        if isinstance(load, (PointMass, DistributedMass)):
            field = "mass" if isinstance(load, PointMass) else "mass_per_length"
            force, none = self.of.at(f"{name}.{field}") * self.gravity, ca.DM.zeros(3)
            constant = (force, none) if stop is None else (Density(rows=[force]), Density(rows=[none]))
            self.pushes.append(Push(begin, stop, load.tube, False, *constant))
            return
        body = load.frame == "body"
        if isinstance(load, PointWrench):
            both = self.of.vector(f"{name}.force"), self.of.vector(f"{name}.moment")
        else:
            assert stop is not None
            both = self._density(k, load, "force", stop), self._density(k, load, "moment", stop)
        self.pushes.append(Push(begin, stop, load.tube, body, *both))

    def _points_of(self, k: int, load: Any) -> tuple[Key, Key | None]:
        """Where a load begins and ends, or the point where it acts."""
        if isinstance(load, (DistributedLoad, DistributedMass)) or getattr(load, "distributed", False):
            return self._point(k, "start", load.start or 0.0, load.tube), self._point(k, "end", load.end, load.tube)
        return self._point(k, "arc_length", load.arc_length, load.tube), None

    def _place_weights(self, k: int) -> None:
        acceleration = self.of.vector(f"loads[{k}].acceleration")
        for i, tube in enumerate(self.of.configuration.robot.tubes):
            name = f"tubes[{i}]."
            if tube.density > 0.0 or name + "density" in self.of.values:
                area = formulas.cross_section(self.of.at(name + "outer_diameter"), self.of.at(name + "inner_diameter"))
                weight = Density(rows=[self.of.at(name + "density") * area * acceleration])
                self.pushes.append(Push(ENTRY, self.of.tube_end(i), i, False, weight, Density(rows=[ca.DM.zeros(3)])))

    def _density(self, k: int, load: DistributedLoad, field: str, end: Key) -> Density:
        value, name = getattr(load, field), f"loads[{k}].{field}"
        if callable(value) and not isinstance(value, LoadTable):
            return Density(function=value)
        rows = self.of.rows(name)
        if not isinstance(value, LoadTable):
            return Density(rows=rows)
        steps = np.diff(value.arc_length)
        slopes = [(b - a) / float(h) for a, b, h in zip(rows, rows[1:], steps, strict=False)]
        knots: list[Key] = []
        for m, s in enumerate(value.arc_length.tolist()):
            if not self.of.clip and not load.start <= s <= self.of.nominal[end]:
                knots.append(PASSED if s < load.start else AHEAD)
            else:
                knots.append(self.of.add(("knot", k, field, m), s, s, self.of.points[self.of.tube_end(load.tube)]))
        return Density(knots, value.arc_length.tolist(), rows, slopes)
