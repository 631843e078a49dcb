"""Rotations of the backbone frame, as quaternions ``(w, x, y, z)``.

A quaternion that has left the unit sphere by an integrator's error still represents an exact rotation, as every formula
divides by its squared length.
"""

from __future__ import annotations

from typing import TypeVar

import casadi as ca

SymT = TypeVar("SymT", ca.DM, ca.SX, ca.MX)
"""The type variable of symbolic code: a function of CasADi matrices keeps the kind it is given."""


def rotation_matrix(q: SymT) -> SymT:
    """The rotation matrix ``R(q)``, 3 x 3."""
    w, x, y, z = ca.vertsplit(q)
    scale = 2 / ca.sumsqr(q)
    return ca.vertcat(
        ca.horzcat(1 - scale * (y * y + z * z), scale * (x * y - w * z), scale * (x * z + w * y)),
        ca.horzcat(scale * (x * y + w * z), 1 - scale * (x * x + z * z), scale * (y * z - w * x)),
        ca.horzcat(scale * (x * z - w * y), scale * (y * z + w * x), 1 - scale * (x * x + y * y)),
    )


def quaternion_rate(q: SymT, u: SymT) -> SymT:
    """The rate ``q'`` for ``R' = R hat(u)``: half the quaternion product of ``q`` and ``(0, u)``."""
    w, x, y, z = ca.vertsplit(q)
    ux, uy, uz = ca.vertsplit(u)
    return 0.5 * ca.vertcat(
        -x * ux - y * uy - z * uz,
        w * ux + y * uz - z * uy,
        w * uy + z * ux - x * uz,
        w * uz + x * uy - y * ux,
    )


def turning(q: SymT) -> SymT:
    """Changes of a quaternion by unit turns about its own axes, 4 x 3: ``dq = T phi``, ``dR = R hat(phi)``."""
    return ca.horzcat(*(quaternion_rate(q, type(q)(ca.DM.eye(3)[:, k])) for k in range(3)))


def turn_of(q: SymT) -> SymT:
    """The matrix from a change of a quaternion to the turn ``phi`` about its own axes, 3 x 4; any length of ``q``."""
    return 4 / ca.sumsqr(q) * turning(q).T


def turn(psi: SymT, x: SymT, y: SymT) -> tuple[SymT, SymT]:
    """The vector ``(x, y)`` turned by ``psi``: ``Rz(psi) (x, y)``."""
    c, s = ca.cos(psi), ca.sin(psi)
    return c * x - s * y, s * x + c * y


def turn_back(psi: SymT, x: SymT, y: SymT) -> tuple[SymT, SymT]:
    """The vector ``(x, y)`` turned back: ``Rz(-psi) (x, y)``, by the sine and cosine of :func:`turn`."""
    c, s = ca.cos(psi), ca.sin(psi)
    return c * x + s * y, c * y - s * x


def quaternion_product(a: SymT, b: SymT) -> SymT:
    """The quaternion of ``R(a) R(b)``."""
    return ca.vertcat(a[0] * b[0] - ca.dot(a[1:], b[1:]), a[0] * b[1:] + b[0] * a[1:] + ca.cross(a[1:], b[1:]))


def quaternion_of_angles(angles: SymT) -> SymT:
    """The quaternion of ``Rx(angles_0) Ry(angles_1) Rz(angles_2)``."""
    c, s = ca.cos(0.5 * angles), ca.sin(0.5 * angles)
    x, y, z = (ca.vertcat(c[k], *(s[k] if j == k else 0 for j in range(3))) for k in range(3))
    return quaternion_product(quaternion_product(x, y), z)
