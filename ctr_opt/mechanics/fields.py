"""Loads that depend on the shape, symbolically: fixed to a tube, or given as expressions."""

from __future__ import annotations

from typing import Any

import attrs
import casadi as ca

from ..loads.fields import ExpressionLoad, PotentialLoad
from .so3 import rotation_matrix, turn


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

    @classmethod
    def of(cls, load: PotentialLoad | ExpressionLoad) -> Field:
        """The expression of a load, without its place and factor."""
        if isinstance(load, PotentialLoad):
            p = ca.SX.sym("p", 3)
            downhill = ca.Function("downhill", [p], [ca.densify(-ca.gradient(load.potential(p), p))])
            return cls(load.potential.serialize(), load.tube, load.potential, downhill)
        return cls(load.function.serialize(), load.tube, load.function)

    def energy(self, position: Any) -> Any:
        """``V(p)``; SI."""
        return self.function(position)

    def wrench(self, s: Any, position: Any, frame: Any) -> tuple[Any, Any]:
        """Force and moment, world frame, at a place where the tube's material frame is ``frame``; SI."""
        if self.downhill is not None:
            return self.downhill(position), ca.DM.zeros(3)
        force, moment = self.function(s, position, frame)
        return force, moment


def material_frame(orientation: Any, angle: Any) -> Any:
    """``R Rz(psi_i)``, 3 x 3."""
    return rotation_matrix(orientation) @ _about_tangent(angle)


def in_world(orientation: Any, angles: Any, vectors: Any) -> Any:
    """Vectors ``(3, tubes)``, each in its tube's material frame, seen from the world."""
    x, y = turn(angles, vectors[0, :].T, vectors[1, :].T)
    return rotation_matrix(orientation) @ ca.vertcat(x.T, y.T, vectors[2, :])


def _about_tangent(angle: Any) -> Any:
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(ca.horzcat(c, -s, 0), ca.horzcat(s, c, 0), ca.horzcat(0, 0, 1))
