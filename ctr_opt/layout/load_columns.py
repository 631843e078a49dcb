"""The data of loads inside a column, and the loads they stand for at a given state."""

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
    """A datum of a column: of how many numbers, which grow with nothing, or with loads or precurvatures.

    ``unit`` gives what they are multiplied by to be dimensionless. ``at_nodes``: whether they are those of one node
    behind the other. ``grows``: with what each is multiplied where that is, in turn: ``"conservative"`` loads, the
    ``"rest"`` of them, or the ``"precurvature"``.
    """

    size: int
    unit: Callable[[Scales], float] = _one
    at_nodes: bool = False
    grows: tuple[str, ...] = ()


@attrs.frozen
class LoadColumns:
    """Order of the data of loads at ``nodes`` places, for functions that provide for ``kind``.

    Dead: ``force (3,)``, ``moment (3, tubes)``. Body: the same for every tube, in its frame. Fields: ``place`` (s, m),
    the ``unit`` of length (m), their parameters' ``numbers`` (SI), and factors ``field`` that make forces and energies
    dimensionless. Those at the end of a step are loads and have the prefix ``point_``, others are densities.
    """

    tubes: int
    nodes: int
    kind: Kind
    prefix: str = ""

    @property
    def table(self) -> dict[str, Datum]:
        """The data, all nodes together."""
        c, fields, along = self.nodes, self.kind.fields, not self.prefix

        def force(scales: Scales) -> float:
            return (scales.length if along else 1.0) / scales.force

        def moment(scales: Scales) -> float:
            return (scales.length if along else 1.0) / scales.moment

        each, rest = 3 * self.tubes * c, ("rest",)
        table = {"force": Datum(3 * c, force, along, ("conservative",)), "moment": Datum(each, moment, along, rest)}
        if self.kind.body:
            table |= {"body_force": Datum(each, force, along, rest), "body_moment": Datum(each, moment, along, rest)}
        if fields:
            table |= {"place": Datum(c, at_nodes=along), "unit": Datum(1)}
            table["numbers"] = Datum(sum(field.parameters for field in fields))
            grows = tuple("conservative" if field.conservative else "rest" for field in fields)
            table["field"] = Datum(len(fields) * c, force, along, grows)
        return {self.prefix + name: part for name, part in table.items()}

    def values(self, loads: LoadValues, places: Array, scales: Scales) -> dict[str, Array]:
        """The data ``(k, size)`` of loads at ``places (k, nodes)``, SI."""
        count = len(places)
        given = {"place": places, "unit": np.full(count, scales.length), "numbers": np.tile(loads.numbers, (count, 1))}
        names = (name.removeprefix(self.prefix) for name in self.table)
        values = {name: given[name] if name in given else getattr(loads, name) for name in names}
        return {self.prefix + name: value.reshape(count, -1) for name, value in values.items()}

    def _part(self, column: Any, parts: dict[str, slice], name: str, width: int, node: int) -> Any:
        start = parts[self.prefix + name].start + width * node
        return column[start : start + width]

    def at(self, column: Any, parts: dict[str, slice], node: int, state: State[Any] | None) -> tuple[Any, Any]:
        """Total force ``(3,)`` and the tubes' moments ``(3, tubes)``, world frame; without ``state``, the dead ones."""
        n = self.tubes
        force = self._part(column, parts, "force", 3, node)
        moment = self._part(column, parts, "moment", 3 * n, node).reshape((3, n))
        if state is None:
            return force, moment
        if self.kind.body:
            own = [
                self._part(column, parts, name, 3 * n, node).reshape((3, n)) for name in ("body_force", "body_moment")
            ]
            force += ca.sum2(in_world(state.orientation, state.angles, own[0]))
            moment += in_world(state.orientation, state.angles, own[1])
        for field, factor, unit, numbers in self._fields(column, parts, node):
            s = self._part(column, parts, "place", 1, node)
            frame = material_frame(state.orientation, state.angles[field.tube])
            pushes, twists = field.wrench(s, state.position * unit, frame, numbers)
            force += _active(factor, factor * pushes)
            turning = _active(factor, factor / unit * twists)
            own_moment = [turning if i == field.tube else ca.DM.zeros(3) for i in range(n)]
            moment += ca.horzcat(*own_moment)
        return force, moment

    def energy(self, column: Any, parts: dict[str, slice], node: int, position: Any) -> Any:
        """The potential of the forces: dead and by potential."""
        total = -ca.dot(self._part(column, parts, "force", 3, node), position)
        for field, factor, unit, numbers in self._fields(column, parts, node):
            if field.conservative:
                total += _active(factor, factor / unit * field.energy(position * unit, numbers))
        return total

    def _fields(self, column: Any, parts: dict[str, slice], node: int) -> Iterator[tuple[Field, Any, Any, Any]]:
        """The expressions, their factors, the unit of length, and their parameters' numbers."""
        fields = self.kind.fields
        if fields:
            unit, numbers = (column[parts[self.prefix + name]] for name in ("unit", "numbers"))
            factors = self._part(column, parts, "field", len(fields), node)
            for k, (field, given) in enumerate(zip(fields, parted(fields, numbers), strict=True)):
                yield field, factors[k], unit, given


def _active(factor: Any, value: Any) -> Any:
    """The value where the load acts, zero elsewhere, even if the expression has no value there."""
    return ca.if_else(factor != 0, value, 0)
