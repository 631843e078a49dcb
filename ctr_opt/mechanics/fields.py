"""Material frames of tubes in symbols, for loads that turn with them."""

from __future__ import annotations

from typing import Any

import casadi as ca

from .so3 import rotation_matrix, turn


def material_frame(orientation: Any, angle: Any) -> Any:
    """The material frame ``R Rz(psi_i)`` of a tube, 3 x 3."""
    return rotation_matrix(orientation) @ _about_tangent(angle)


def in_world(orientation: Any, angles: Any, vectors: Any) -> Any:
    """World components of vectors ``(3, tubes)``, each given in its tube's material frame."""
    x, y = turn(angles, vectors[0, :].T, vectors[1, :].T)
    return rotation_matrix(orientation) @ ca.vertcat(x.T, y.T, vectors[2, :])


def _about_tangent(angle: Any) -> Any:
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(ca.horzcat(c, -s, 0), ca.horzcat(s, c, 0), ca.horzcat(0, 0, 1))
