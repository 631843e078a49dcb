"""The data of loads inside a column, and the loads they stand for at a given state."""

from __future__ import annotations

from collections.abc import Iterator
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


@attrs.frozen
class LoadColumns:
    """Order of the data of loads at ``nodes`` places, for functions that provide for ``kind``.

    Dead: ``force (3,)``, ``moment (3, tubes)``. Body: the same for every tube, in its frame. Fields: ``place`` (s, m),
    the ``unit`` of length (m), their parameters' ``numbers`` (SI), and factors ``field`` that make forces and energies
    dimensionless.
    """

    tubes: int
    nodes: int
    kind: Kind
    prefix: str = ""

    @property
    def sizes(self) -> dict[str, int]:
        """Entries of each part, all nodes together."""
        n, c = self.tubes, self.nodes
        sizes = {"force": 3 * c, "moment": 3 * n * c}
        if self.kind.body:
            sizes |= {"body_force": 3 * n * c, "body_moment": 3 * n * c}
        if self.kind.fields:
            numbers = sum(field.parameters for field in self.kind.fields)
            sizes |= {"place": c, "unit": 1, "numbers": numbers, "field": len(self.kind.fields) * c}
        return {self.prefix + name: size for name, size in sizes.items()}

    def pack(self, loads: LoadValues, places: Array, scales: Scales, length: float) -> dict[str, Array]:
        """The parts, ``(k, size)``, from loads at ``places (k, nodes)``; ``length`` turns densities into loads."""
        count, factors = len(places), self.units(scales, length)
        parts = {"force": loads.force, "moment": loads.moment}
        if self.kind.body:
            parts |= {"body_force": loads.body_force, "body_moment": loads.body_moment}
        if self.kind.fields:
            parts |= {"place": places, "unit": np.full((count, 1), scales.length), "field": loads.field}
            parts["numbers"] = np.tile(loads.numbers, (count, 1))
        named = {self.prefix + name: part for name, part in parts.items()}
        return {name: part.reshape(count, -1) * factors[name] for name, part in named.items()}

    def units(self, scales: Scales, length: float) -> dict[str, float]:
        """By what the parts are multiplied to be dimensionless."""
        force, moment = length / scales.force, length / scales.moment
        of = {"force": force, "moment": moment, "body_force": force, "body_moment": moment, "field": force}
        of |= {"place": 1.0, "unit": 1.0, "numbers": 1.0}
        return {self.prefix + name: factor for name, factor in of.items()}

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

    def factors(self, parts: dict[str, slice], conservative: float, rest: float) -> dict[str, Any]:
        """By what each part is multiplied when loads with and without a potential are."""
        fields = [conservative if field.conservative else rest for field in self.kind.fields]
        of: dict[str, Any] = {"force": conservative, "moment": rest, "body_force": rest, "body_moment": rest}
        if fields:
            of["field"] = np.tile(fields, self.nodes)
        return {self.prefix + name: factor for name, factor in of.items() if self.prefix + name in parts}


def _active(factor: Any, value: Any) -> Any:
    """The value where the load acts, zero elsewhere, even if the expression has no value there."""
    return ca.if_else(factor != 0, value, 0)
