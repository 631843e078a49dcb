"""A load given as a CasADi expression of where the robot is, without its place and factor."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import attrs
import casadi as ca


@attrs.frozen
class Field:
    """A load given as an expression, on one tube; two of the same content are the same."""

    content: str
    tube: int
    function: ca.Function = attrs.field(eq=False, repr=False)
    downhill: ca.Function | None = attrs.field(default=None, eq=False, repr=False)

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

    def energy(self, position: Any) -> Any:
        """``V(p)``; SI."""
        return self.function(position)

    def wrench(self, s: Any, position: Any, frame: Any) -> tuple[Any, Any]:
        """Force and moment, world frame, at a place where the tube's material frame is ``frame``; SI."""
        if self.downhill is not None:
            return self.downhill(position), ca.DM.zeros(3)
        force, moment = self.function(s, position, frame)
        return force, moment


@lru_cache(maxsize=64)
def free(function: ca.Function, tube: int) -> Field:
    """Of a force and a moment ``(s, p, R) -> (force, moment)``."""
    return Field(function.serialize(), tube, function)


@lru_cache(maxsize=64)
def potential(function: ca.Function, tube: int) -> Field:
    """Of a potential ``V(p)``."""
    p = ca.SX.sym("p", 3)
    downhill = ca.Function("downhill", [p], [ca.densify(-ca.gradient(function(p), p))])
    return Field(function.serialize(), tube, function, downhill)
