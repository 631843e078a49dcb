"""Loads given as CasADi expressions of the robot's position and orientation, without place and factor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

import attrs
import casadi as ca


@attrs.frozen
class Field:
    """A load given as an expression, on one tube; fields of equal content, tube and ``slot`` are equal.

    The expression may depend on a number of ``parameters``. Their values are data, so fields that differ only in these
    values share their equations. Such fields have different slots, because their factors cannot be added.
    """

    content: str
    tube: int
    function: ca.Function = attrs.field(eq=False, repr=False)
    downhill: ca.Function | None = attrs.field(default=None, eq=False, repr=False)
    parameters: int = attrs.field(default=0, eq=False)
    slot: int = 0

    @property
    def conservative(self) -> bool:
        """Whether the expression is a potential."""
        return self.downhill is not None

    @property
    def varies_along(self) -> bool:
        """Whether the expression depends explicitly on the arc length."""
        if self.conservative:
            return False
        return any(self.function.jac_sparsity(i, 0).nnz() > 0 for i in range(2))

    def energy(self, position: Any, numbers: Any) -> Any:
        """Evaluate the potential ``V(p)`` with its parameters' ``numbers``, SI."""
        return self.function(position, numbers) if self.parameters else self.function(position)

    def wrench(self, s: Any, position: Any, frame: Any, numbers: Any) -> tuple[Any, Any]:
        """Evaluate force and moment, world frame, SI; ``frame`` is the tube's material frame there."""
        if self.downhill is not None:
            force = self.downhill(position, numbers) if self.parameters else self.downhill(position)
            return force, ca.DM.zeros(3)
        force, moment = self.function(s, position, frame)
        return force, moment


def parted(fields: Sequence[Field], numbers: Any) -> Iterator[Any]:
    """Split a vector of all fields' numbers into the numbers of each field."""
    start = 0
    for field in fields:
        yield numbers[start : start + field.parameters]
        start += field.parameters


@lru_cache(maxsize=64)
def free(function: ca.Function, tube: int) -> Field:
    """Make the field of a force and a moment, ``(s, p, R) -> (force, moment)``."""
    return Field(function.serialize(), tube, function)


@lru_cache(maxsize=64)
def potential(function: ca.Function, tube: int) -> Field:
    """Make the field of a potential, ``V(p)`` or ``V(p, numbers)``."""
    symbols = [ca.SX.sym(name, *function.size_in(name)) for name in function.name_in()]
    downhill = ca.Function("downhill", symbols, [ca.densify(-ca.gradient(function(*symbols), symbols[0]))])
    return Field(function.serialize(), tube, function, downhill, sum(int(symbol.shape[0]) for symbol in symbols[1:]))
