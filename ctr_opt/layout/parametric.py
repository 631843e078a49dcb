"""Symbolic counterpart of ``Configuration``: a robot under loads, as expressions of parameters.

Stiffnesses, preset curvatures, break points and loads are expressions of the requested parameters and plain numbers
otherwise. An ``Order`` says to which section they belong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial, reduce
from typing import Any

import attrs
import casadi as ca
import numpy as np

from ..loads.density import LoadTable
from ..loads.kind import Load, Push, pushes_of
from ..robot import tube as formulas
from .configuration import Configuration
from .ordering import AHEAD, ENTRY, PASSED, Key
from .parametric_robot import ParametricRobot


@attrs.frozen(eq=False)
class Density:
    """A symbolic load density: ``rows[j] + slopes[j] (s - arc_length[j])`` behind knot ``j``, or a ``function``."""

    knots: list[Key] = attrs.field(factory=list)
    arc_length: list[float] = attrs.field(factory=list)
    rows: list[Any] = attrs.field(factory=list)
    slopes: list[Any] = attrs.field(factory=list)
    function: Any = None


@attrs.frozen(eq=False)
class SymbolicPush:
    """A push in expressions of parameters: at the point ``start``, or up to ``end`` with densities."""

    push: Push
    start: Key
    end: Key | None


class Parametric(ParametricRobot):
    """A configuration in which columns of symbols, ``values``, replace some parameters.

    ``probes`` are arc lengths on a tube, or (None) on the robot, that become break points. The name ``"probes"`` in
    ``values`` may give symbols for them. ``placed`` holds the pushes of the loads.
    """

    def __init__(
        self,
        configuration: Configuration,
        values: Mapping[str, Any],
        probes: Sequence[tuple[float, int | None]] = (),
        clip: bool = False,
    ) -> None:
        super().__init__(configuration, values, clip)
        self.within: list[Any] = []  # distances of loads from the ends of their tubes, which must not be negative
        loads = configuration.loads
        pulling = [self._number(k, load, load.pulls) for k, load in enumerate(loads) if load.pulls]
        gravity, masses = sum(pulling, ca.DM.zeros(3)), self._masses() if pulling else []
        numbers = [partial(self._number, k, load) for k, load in enumerate(loads)]
        self.placed = [self._placed(k, loads[k], push) for k, push in pushes_of(loads, numbers, gravity, masses)]
        self._fix_resolving_points()
        moving = values.get("probes")
        for k, (s, tube) in enumerate(probes):
            end = self.length if tube is None else self.tube_ends[tube]
            self.add(("probe", k), s if moving is None else moving[k], s, end)

    @property
    def margin(self) -> Any:
        """Distance to the nearest infeasible configuration, m: a load beyond its tube, or a tube moved too far."""
        return reduce(ca.fmin, [*self.within, *self.tube_ends, *(-beta for beta in self.translations)])

    def _number(self, k: int, load: Load, field: str) -> Any:
        """Return a load's number: a scalar, a column, a table of columns, or a function."""
        value, name = getattr(load, field), f"loads[{k}].{field}"
        if isinstance(value, LoadTable):
            return LoadTable(value.arc_length, self.rows(name))
        if callable(value):
            return value
        return self.vector(name) if np.ndim(value) else self.at(name)

    def _masses(self) -> list[Any]:
        """Masses per length of the tubes; None for a tube without mass."""
        masses = []
        for i, tube in enumerate(self.configuration.robot.tubes):
            name = f"tubes[{i}]."
            area = formulas.cross_section(self.at(name + "outer_diameter"), self.at(name + "inner_diameter"))
            heavy = tube.density > 0.0 or name + "density" in self.values
            masses.append(self.at(name + "density") * area if heavy else None)
        return masses

    def _placed(self, k: int, load: Load, push: Push) -> SymbolicPush:
        start, *end = (self._point(k, field, load.where(field), push.tube) for field in push.places)
        if not end:
            return SymbolicPush(push, start, None)
        force, moment = (
            self._density(k, load, field, getattr(push, field), end[0], push.tube) for field in ("force", "moment")
        )
        return SymbolicPush(push._replace(force=force, moment=moment), start, end[0])

    def _point(self, k: int, field: str, nominal: float | None, tube: int) -> Key:
        """Add the break point where a load acts, begins or ends."""
        name = f"loads[{k}].{field}"
        if nominal is None:
            return self.tube_end(tube)
        if nominal == 0.0 and name not in self.values:
            return ENTRY
        end, value = self.points[self.tube_end(tube)], self.at(name)
        self.within.append(end - value)
        return self.add(("load", k, field), value, min(nominal, float(self.configuration.tube_ends[tube])), end)

    def _density(self, k: int, load: Load, field: str, value: Any, end: Key, tube: int) -> Density:
        if not isinstance(value, LoadTable):
            return Density(function=value) if callable(value) else Density(rows=[ca.SX(value)])
        places, rows, first = value.arc_length.tolist(), list(value.values), load.where("start") or 0.0
        slopes = [(b - a) / float(h) for a, b, h in zip(rows, rows[1:], np.diff(value.arc_length), strict=False)]
        knots: list[Key] = []
        for m, s in enumerate(places):
            if not self.clip and not first <= s <= self.nominal[end]:
                knots.append(PASSED if s < first else AHEAD)
            else:
                knots.append(self.add(("knot", k, field, m), s, s, self.points[self.tube_end(tube)]))
        return Density(knots, places, rows, slopes)

    def _fix_resolving_points(self) -> None:
        """Fix the break points that resolve loads given as functions where the configuration has them."""
        known = np.array(list(self.nominal.values()))
        for k, s in enumerate(self.configuration.break_points):
            if np.abs(known - s).min() > self.configuration.ends.slack:
                self.add(("fixed", k), float(s), float(s), self.length)
