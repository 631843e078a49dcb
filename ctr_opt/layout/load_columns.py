"""Data of loads inside a column, and the loads that they describe at a given state."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import attrs
import casadi as ca
import numpy as np

from ..checks import Array
from ..loads.field import Field, parted
from ..mechanics.fields import in_world, material_frame
from ..mechanics.kind import Kind
from ..mechanics.state import State
from .configuration import LoadValues, Scales


def _one(scales: Scales) -> float:  # noqa: ARG001
    return 1.0


@attrs.frozen
class Datum:
    """A datum of a column: its size, its unit, and what its numbers grow with.

    ``unit`` gives the factor that makes the numbers dimensionless. ``at_nodes`` says whether the numbers of the nodes
    follow one another. ``grows`` names, in turn, what multiplies each number: ``"conservative"`` loads, the ``"rest"``
    of the loads, or the ``"precurvature"``; empty if nothing does.
    """

    size: int
    unit: Callable[[Scales], float] = _one
    at_nodes: bool = False
    grows: tuple[str, ...] = ()


@attrs.frozen
class LoadColumns:
    """Order of the data of loads at ``nodes`` places, for functions that support ``kind``.

    Dead loads: ``force (3,)`` and ``moment (3, tubes)``. Body loads: both for every tube, in its frame. Fields:
    ``place`` (s, m), the ``unit`` of length (m), their parameters' ``numbers`` (SI), and factors ``field`` that make
    forces and energies dimensionless. The prefix ``point_`` marks loads at the end of a step; others are densities.
    """

    tubes: int
    nodes: int
    kind: Kind
    prefix: str = ""

    @property
    def table(self) -> dict[str, Datum]:
        """The data, with all nodes together."""
        c, fields, along = self.nodes, self.kind.fields, not self.prefix

        def force(scales: Scales) -> float:
            return (scales.length if along else 1.0) / scales.force

        def moment(scales: Scales) -> float:
            return (scales.length if along else 1.0) / scales.moment

        size, rest = 3 * self.tubes * c, ("rest",)
        table = {"force": Datum(3 * c, force, along, ("conservative",)), "moment": Datum(size, moment, along, rest)}
        if self.kind.body:
            table |= {"body_force": Datum(size, force, along, rest), "body_moment": Datum(size, moment, along, rest)}
        if fields:
            table |= {"place": Datum(c, at_nodes=along), "unit": Datum(1)}
            table["numbers"] = Datum(sum(field.parameters for field in fields))
            grows = tuple("conservative" if field.conservative else "rest" for field in fields)
            table["field"] = Datum(len(fields) * c, force, along, grows)
        return {self.prefix + name: part for name, part in table.items()}

    def values(self, loads: LoadValues, places: Array, scales: Scales) -> dict[str, Array]:
        """Data ``(k, size)`` of loads at ``places (k, nodes)``, SI."""
        count = len(places)
        extra = {"place": places, "unit": np.full(count, scales.length), "numbers": np.tile(loads.numbers, (count, 1))}
        names = (name.removeprefix(self.prefix) for name in self.table)
        values = {name: extra[name] if name in extra else getattr(loads, name) for name in names}
        return {self.prefix + name: value.reshape(count, -1) for name, value in values.items()}

    def _part(self, column: Any, parts: dict[str, slice], name: str, width: int, node: int) -> Any:
        start = parts[self.prefix + name].start + width * node
        return column[start : start + width]

    def at(self, column: Any, parts: dict[str, slice], node: int, state: State[Any] | None) -> tuple[Any, Any]:
        """Total force ``(3,)`` and the tubes' moments ``(3, tubes)``, world frame; without ``state``, of dead loads."""
        n = self.tubes
        force = self._part(column, parts, "force", 3, node)
        moment = self._part(column, parts, "moment", 3 * n, node).reshape((3, n))
        if state is None:
            return force, moment
        if self.kind.body:
            body = [
                self._part(column, parts, name, 3 * n, node).reshape((3, n)) for name in ("body_force", "body_moment")
            ]
            force += ca.sum2(in_world(state.orientation, state.angles, body[0]))
            moment += in_world(state.orientation, state.angles, body[1])
        for field, factor, unit, numbers in self._fields(column, parts, node):
            s = self._part(column, parts, "place", 1, node)
            frame = material_frame(state.orientation, state.angles[field.tube])
            pushes, twists = field.wrench(s, state.position * unit, frame, numbers)
            force += _active(factor, factor * pushes)
            turning = _active(factor, factor / unit * twists)
            moments = [turning if i == field.tube else ca.DM.zeros(3) for i in range(n)]
            moment += ca.horzcat(*moments)
        return force, moment

    def energy(self, column: Any, parts: dict[str, slice], node: int, position: Any) -> Any:
        """Potential of dead forces and of loads given as potentials."""
        total = -ca.dot(self._part(column, parts, "force", 3, node), position)
        for field, factor, unit, numbers in self._fields(column, parts, node):
            if field.conservative:
                total += _active(factor, factor / unit * field.energy(position * unit, numbers))
        return total

    def _fields(self, column: Any, parts: dict[str, slice], node: int) -> Iterator[tuple[Field, Any, Any, Any]]:
        """Yield each expression with its factor, the unit of length, and its parameters' numbers."""
        fields = self.kind.fields
        if fields:
            unit, numbers = (column[parts[self.prefix + name]] for name in ("unit", "numbers"))
            factors = self._part(column, parts, "field", len(fields), node)
            for k, (field, part) in enumerate(zip(fields, parted(fields, numbers), strict=True)):
                yield field, factors[k], unit, part


def _active(factor: Any, value: Any) -> Any:
    """Return the value where the load acts and zero elsewhere, even if the expression has no value there."""
    return ca.if_else(factor != 0, value, 0)
