"""Curvatures of many curves at once, in Bishop's rotation-minimizing frames."""

from __future__ import annotations

import numpy as np

from ..checks import Array


def bishop_curvature(t: Array, points: Array, first: Array, second: Array, normal: Array) -> tuple[Array, Array]:
    """Arc lengths ``(..., n)`` and ``u_x, u_y`` ``(..., n, 2)`` of curves ``(..., n, 3)`` at parameters ``t (n,)``.

    ``first`` and ``second`` are the derivatives by ``t``; ``normal`` is where x points at the base, as far as it is
    normal to the curve. The frame is carried by double reflection, of fourth order in the steps (W. Wang, B. Juettler,
    D. Zheng, Y. Liu, ACM Trans. Graphics 27(1), 2008).
    """
    from scipy.integrate import cumulative_simpson

    speed = np.linalg.norm(first, axis=-1, keepdims=True)
    tangent = first / speed
    bend = (second - tangent * _dot(tangent, second)) / speed**2
    x = np.empty_like(tangent)
    x[..., 0, :] = _across(tangent[..., 0, :], normal)
    for k in range(len(t) - 1):
        a = points[..., k + 1, :] - points[..., k, :]
        half = 2.0 / _dot(a, a)
        carried = x[..., k, :] - a * (half * _dot(a, x[..., k, :]))
        b = tangent[..., k + 1, :] - tangent[..., k, :] + a * (half * _dot(a, tangent[..., k, :]))
        x[..., k + 1, :] = carried - b * (2.0 / _dot(b, b) * _dot(b, carried))
    y = np.cross(tangent, x)
    lengths = cumulative_simpson(speed[..., 0], x=t, initial=0.0, axis=-1)
    return lengths, np.stack((-np.sum(bend * y, axis=-1), np.sum(bend * x, axis=-1)), axis=-1)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=-1, keepdims=True))


def _across(tangent: Array, normal: Array) -> Array:
    """The unit vector nearest to ``normal`` that is normal to each tangent."""
    part = normal - tangent * _dot(tangent, normal)
    return np.asarray(part / np.linalg.norm(part, axis=-1, keepdims=True))
