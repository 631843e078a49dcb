"""Data of steps and of the entry point as expressions of parameters, in the columns that ``columns.py`` packs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import attrs
import casadi as ca
import numpy as np

from ..checks import Array
from ..loads.field import Field
from ..loads.kind import Push
from ..mechanics.kind import Kind
from ..mechanics.law import transmission_compliance
from ..mechanics.so3 import quaternion_of_angles, quaternion_product
from .columns import EntryColumn, StepColumns, existing
from .ordering import Order
from .parametric import Density, Parametric


@attrs.frozen(eq=False)
class SampledLoad:
    """Values ``(3, places)`` of a load given as a function, at places that parameters may move."""

    places: Any
    value: Any
    function: Callable[[float], Any]


class ParametricColumns:
    """Columns of a parametric robot whose break points have an order."""

    def __init__(self, parametric: Parametric, order: Order, kind: Kind) -> None:
        self.parametric = parametric
        self.order = order
        self.kind = kind
        self.samples: list[SampledLoad] = []
        self._scales = parametric.configuration.scales
        numbers = {placed.push.field: placed.push.numbers for placed in parametric.placed}
        self._numbers = ca.vertcat(ca.SX(0, 1), *(numbers[field] for field in kind.fields if field.parameters))
        self._pieces: dict[tuple[int, int], tuple[Any, list[Any]]] = {}

    def place(self, section: int, fraction: float) -> Any:
        """Arc length ``s`` at a fraction of a section."""
        start, end = self.order.places[section], self.order.places[section + 1]
        return start + float(fraction) * (end - start)

    def step(self, section: int, low: float, high: float, fractions: Array, *, jump: bool = True) -> Any:
        """Column of a step between two fractions of a section; the last step includes point loads at its end."""
        layout = StepColumns(self.parametric.tubes, len(fractions), self.kind)
        start, end, nodes = self._nodes(section, low, high, fractions)
        of, order, tubes = self.parametric, self.order, range(self.parametric.tubes)
        data = {
            "length": end - start,
            **existing(of.stiffness, ca.vertcat(*(of.present(order, i, section) for i in tubes))),
            "precurvature": self._curvatures(section, nodes),
            **self._distributed(section, nodes),
            **self._points(section + 1, end, active=jump and high == 1.0),
        }
        return _column(data, layout.parts, layout.units(self._scales))

    def slopes(self, section: int, low: float, high: float, fractions: Array) -> Any:
        """Slopes ``du*_i / ds (3 tubes,)`` at the nodes of a step, one node behind the other, dimensionless."""
        *_, nodes = self._nodes(section, low, high, fractions)
        return self._curvatures(section, nodes, derivative=True) * self._scales.length**2

    def _nodes(self, section: int, low: float, high: float, fractions: Array) -> tuple[Any, Any, Any]:
        """Arc lengths of a step's start, end, and nodes in a row."""
        start, end = self.place(section, low), self.place(section, high)
        return start, end, start + ca.SX(ca.DM(fractions)).T * (end - start)

    def entry(self, total_force: Any) -> Any:
        """Column of the entry point; ``total_force`` of the dead loads beyond it is dimensionless."""
        of, robot = self.parametric, self.parametric.configuration.robot
        layout = EntryColumn(of.tubes, self.kind)
        rotations, moved, turned = of.base
        units = layout.units(self._scales)
        point = self._points(0, 0.0, active=True)
        base = ca.SX(ca.DM(of.configuration.robot.base_quaternion))
        data = {
            "position": ca.DM(robot.base_pose[:3, 3]) + moved,
            "orientation": quaternion_product(base, quaternion_of_angles(ca.SX(turned))),
            "rotations": rotations,
            "twist": ca.vertcat(*(of.twist_behind(self.order, i) for i in range(of.tubes))),
            "compliance": transmission_compliance(-ca.vertcat(*of.translations), of.stiffness),
            "force": total_force + point["point_force"] * units["point_force"],
            **point,
        }
        return _column(data, layout.parts, units)

    @property
    def straightening_energy(self) -> Any:
        """Energy of curved parts held straight behind the entry point, J."""
        return sum(self.parametric.energy_behind(self.order, i) for i in range(self.parametric.tubes))

    # -- parts -----------------------------------------------------------------------------------------------------

    def _curvatures(self, section: int, nodes: Any, *, derivative: bool = False) -> Any:
        """Precurvatures of all tubes at places in a section, or their derivatives by ``s``, place behind place."""
        values = []
        for i in range(self.parametric.tubes):
            if (i, section) not in self._pieces:
                self._pieces[i, section] = self.parametric.precurvature(self.order, i, section)
            start, rows = self._pieces[i, section]
            if derivative:
                rows = [float(d) * row for d, row in enumerate(rows)][1:] or [ca.SX.zeros(3)]
            powers = [ca.SX.ones(nodes.shape)]
            for _ in rows[1:]:
                powers.append(powers[-1] * (nodes - start))
            values.append(ca.horzcat(*rows) @ ca.vertcat(*powers))
        return ca.vec(ca.vertcat(*values))

    def _distributed(self, section: int, nodes: Any) -> dict[str, Any]:
        """Data of loads per arc length at places in a section."""
        total = _Sums(self.parametric.tubes, nodes.shape[1], self.kind.fields)
        for placed in self.parametric.placed:
            weight = 0.0 if placed.end is None else self.order.within(placed.start, placed.end, section)
            if isinstance(weight, float) and weight == 0.0:
                continue
            both = (self._density(density, section, nodes) for density in (placed.push.force, placed.push.moment))
            total.add(placed.push, weight, *both)
        return self._named(total, nodes, "")

    def _points(self, position: int, s: Any, *, active: bool) -> dict[str, Any]:
        """Data of point loads at a position."""
        total = _Sums(self.parametric.tubes, 1, self.kind.fields)
        for placed in self.parametric.placed if active else ():
            if placed.end is None:
                weight = self.order.at(placed.start, position)
                total.add(placed.push, weight, placed.push.force, placed.push.moment)
        return self._named(total, ca.SX(s), "point_")

    def _named(self, total: _Sums, places: Any, prefix: str) -> dict[str, Any]:
        data: dict[str, Any] = {name: ca.vec(part) for name, part in total.parts.items()}
        data |= {"place": places.T, "unit": self._scales.length, "numbers": self._numbers}
        data["field"] = ca.repmat(data["field"], places.shape[1], 1)
        return {prefix + name: part for name, part in data.items()}

    def _density(self, density: Density, section: int, nodes: Any) -> Any:
        """Value of a load per arc length at places in a section, ``(3, places)``."""
        if density.function is not None:
            value = ca.SX.sym("load", 3, nodes.shape[1])
            self.samples.append(SampledLoad(nodes, value, density.function))
            return value
        if not density.knots:
            return ca.repmat(density.rows[0], 1, nodes.shape[1])
        value, order = ca.SX.zeros(3, nodes.shape[1]), self.order
        for j, slope in enumerate(density.slopes):
            weight = order.within(density.knots[j], density.knots[j + 1], section)
            if not (isinstance(weight, float) and weight == 0.0):
                value += weight * (
                    ca.repmat(density.rows[j], 1, nodes.shape[1]) + slope @ (nodes - density.arc_length[j])
                )
        return value


class _Sums:
    """Sums of forces and tubes' moments at places, ``(.., places)`` by name, and of the factors of ``fields``."""

    def __init__(self, tubes: int, places: int, fields: tuple[Field, ...]) -> None:
        rows = {"force": 3, "moment": 3 * tubes, "body_force": 3 * tubes, "body_moment": 3 * tubes}
        self.parts = {name: ca.SX.zeros(size, places) for name, size in rows.items()}
        self.parts["field"] = ca.SX.zeros(len(fields))
        self.fields = fields

    def add(self, push: Push, weight: Any, force: Any, moment: Any) -> None:
        rows, prefix = slice(3 * push.tube, 3 * push.tube + 3), "body_" if push.body else ""
        if push.field is not None:
            self.parts["field"][self.fields.index(push.field)] += weight * push.factor
        else:
            self.parts[f"{prefix}force"][rows if push.body else slice(0, 3), :] += weight * force
            self.parts[f"{prefix}moment"][rows, :] += weight * moment


def _column(data: dict[str, Any], parts: dict[str, slice], units: dict[str, float]) -> Any:
    return ca.densify(ca.SX(ca.vertcat(*(data[name] * units[name] for name in parts))))


def fractions_of(mesh: Array, start: float, end: float, slack: float) -> Array:
    """Fractions of a section at which the nodes of a mesh cut it, both ends included."""
    if end - start <= slack:
        return np.array([0.0, 1.0])
    nodes = mesh[1:, 0]
    inner = nodes[(nodes > start + slack) & (nodes < end - slack)]
    return np.concatenate(([0.0], (inner - start) / (end - start), [1.0]))
