"""Loads that depend on the shape, symbolically: fixed to a tube, or given as expressions."""

from __future__ import annotations

from typing import Any

import attrs
import casadi as ca

from ..robot.fields import ExpressionLoad, PotentialLoad
from .so3 import rotation_matrix, turn


@attrs.frozen
class Field:
    """A load given as an expression, on one tube; two of the same content are the same."""

    content: str
    tube: int
    function: ca.Function = attrs.field(eq=False, repr=False)
    conservative: bool = True

    @classmethod
    def of(cls, load: PotentialLoad | ExpressionLoad) -> Field:
        """The expression of a load, without its place and factor."""
        function = load.potential if isinstance(load, PotentialLoad) else load.function
        return cls(function.serialize(), load.tube, function, isinstance(load, PotentialLoad))

    def energy(self, position: Any) -> Any:
        """``V(p)``; SI."""
        return self.function(position)

    def wrench(self, s: Any, position: Any, frame: Any) -> tuple[Any, Any]:
        """Force and moment, world frame, at a place where the tube's material frame is ``frame``; SI."""
        if not self.conservative:
            force, moment = self.function(s, position, frame)
            return force, moment
        p = ca.SX.sym("p", 3)
        downhill = ca.Function("downhill", [p], [ca.densify(-ca.gradient(self.function(p), p))])
        return downhill(position), ca.DM.zeros(3)


@attrs.frozen
class LoadKind:
    """What the symbolic functions must provide for: loads in tubes' frames (``body``), and ``fields``."""

    body: bool = False
    fields: tuple[Field, ...] = ()

    @property
    def live(self) -> bool:
        """Whether loads depend on the shape, so that the force at the entry point is unknown."""
        return self.body or bool(self.fields)

    def joined(self, other: LoadKind) -> LoadKind:
        """What provides for both."""
        fields = dict.fromkeys((*self.fields, *other.fields))
        return LoadKind(self.body or other.body, tuple(fields))


DEAD = LoadKind()
"""Dead loads only."""


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
