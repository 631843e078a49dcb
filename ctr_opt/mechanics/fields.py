"""Material frames of tubes, symbolically: where loads that turn with them point."""

from __future__ import annotations

from typing import Any

import casadi as ca

from .so3 import rotation_matrix, turn


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
