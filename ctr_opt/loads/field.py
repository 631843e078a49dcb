"""A load given as a CasADi expression of where the robot is, without its place and factor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

import attrs
import casadi as ca


@attrs.frozen
class Field:
    """A load given as an expression, on one tube; two of the same content are the same, unless their ``slot`` differs.

    The expression may depend on ``parameters`` numbers, which are data: fields that differ in them alone share their
    equations. Each has a slot of its own, as they do not add up.
    """

    content: str
    tube: int
    function: ca.Function = attrs.field(eq=False, repr=False)
    downhill: ca.Function | None = attrs.field(default=None, eq=False, repr=False)
    parameters: int = attrs.field(default=0, eq=False)
    slot: int = 0

    @property
    def conservative(self) -> bool:
        """Whether it is a potential."""
        return self.downhill is not None

    @property
    def varies_along(self) -> bool:
        """Whether it depends on the arc length itself."""
        if self.conservative:
            return False
        return any(self.function.jac_sparsity(i, 0).nnz() > 0 for i in range(2))

    def energy(self, position: Any, numbers: Any) -> Any:
        """``V(p)`` with its parameters' ``numbers``; SI."""
        return self.function(position, numbers) if self.parameters else self.function(position)

    def wrench(self, s: Any, position: Any, frame: Any, numbers: Any) -> tuple[Any, Any]:
        """Force and moment, world frame, at a place where the tube's material frame is ``frame``; SI."""
        if self.downhill is not None:
            force = self.downhill(position, numbers) if self.parameters else self.downhill(position)
            return force, ca.DM.zeros(3)
        force, moment = self.function(s, position, frame)
        return force, moment


def parted(fields: Sequence[Field], numbers: Any) -> Iterator[Any]:
    """The numbers of each field's parameters, out of those of all, one behind the other."""
    start = 0
    for field in fields:
        yield numbers[start : start + field.parameters]
        start += field.parameters


@lru_cache(maxsize=64)
def free(function: ca.Function, tube: int) -> Field:
    """Of a force and a moment ``(s, p, R) -> (force, moment)``."""
    return Field(function.serialize(), tube, function)


@lru_cache(maxsize=64)
def potential(function: ca.Function, tube: int) -> Field:
    """Of a potential ``V(p)``, or ``V(p, numbers)``."""
    symbols = [ca.SX.sym(name, *function.size_in(name)) for name in function.name_in()]
    downhill = ca.Function("downhill", symbols, [ca.densify(-ca.gradient(function(*symbols), symbols[0]))])
    return Field(function.serialize(), tube, function, downhill, sum(int(other.shape[0]) for other in symbols[1:]))
