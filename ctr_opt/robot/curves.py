"""Precurvature ``u*(s)`` of a tube from its preset curve ``r*(s)`` (paper, II-B)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..checks import Array, array, choice, whole
from ..errors import DefinitionError
from .precurvature import SampledCurvature

_FIT_SAMPLES = 201  # of a curve given as a function; the third derivative of a seventh-degree spline is good to 1e-9
_FINE, _FINER = 4001, 10  # points at which frames are carried: at least in total, and per knot
_FLAT = 1e-3  # of the largest curvature: below it, the direction of the curve's normal is not used


def precurvature_from_curve(
    curve: Any,
    *,
    framing: str = "bishop",
    interval: tuple[float, float] = (0.0, 1.0),
    samples: int = 101,
    normal: Any = (1.0, 0.0, 0.0),
) -> SampledCurvature:
    """Compute the precurvature of a tube whose preset shape is a given curve.

    Parameters
    ----------
    curve
        Points ``(k, 3)`` along the curve, ``k >= 4``, m, or a function ``t -> (3,)`` of any regular parameter. A
        spline of degree five interpolates points, so they must be smooth: fit noisy measurements first.
    framing
        ``"bishop"``: rotation-minimizing, ``u* = (u_x, u_y, 0)``. ``"frenet"``: Frenet-Serret, ``u* = (0, kappa,
        tau)`` with x along the principal normal. The normal is continued smoothly through an inflection, so ``kappa``
        changes its sign there and ``tau`` stays finite.
    interval
        Range of the parameter of a function.
    samples
        Number of points of the returned curvature, uniform in arc length, at least 5.
    normal
        Direction of x at the base for ``"bishop"``. Only its component normal to the curve counts.

    Raises
    ------
    DefinitionError
        Points coincide or are too few, the curve stands still, or the framing is unknown.

    Notes
    -----
    Both framings describe the same curve (paper, II-B). They differ in how the tube's frame turns along it.

    Examples
    --------
    A quarter of a circle of radius 50 mm:

    >>> import numpy as np
    >>> circle = lambda t: 0.05 * np.array([1 - np.cos(t), 0.0, np.sin(t)])
    >>> piece = precurvature_from_curve(circle, interval=(0.0, np.pi / 2))
    >>> round(piece.length, 6), (np.round(piece.curvature[50], 6) + 0.0).tolist()
    (0.07854, [0.0, 20.0, 0.0])
    """
    from scipy.interpolate import CubicSpline

    choice(framing, "framing", ("bishop", "frenet"))
    samples = whole(samples, "samples", 5)
    spline = _spline_of_function(curve, interval) if callable(curve) else _spline_of_points(curve)
    t = np.linspace(spline.t[0], spline.t[-1], max(_FINE, _FINER * len(spline.t)))
    points, first, second = (np.asarray(spline(t, n)) for n in range(3))
    speeds = np.linalg.norm(first, axis=1)
    if not (np.all(speeds > 1e-9 * speeds.max()) and np.all(np.sum(first[1:] * first[:-1], axis=1) > 0.0)):
        raise DefinitionError("curve stands still or turns back at a point, so it has no tangent there")
    reached, bends = bishop_curvature(t, points, first, second, _across(first[0], array(normal, "normal", (3,))))
    s = np.linspace(0.0, reached[-1], samples)
    bishop = np.column_stack((CubicSpline(reached, bends)(s), np.zeros(samples)))
    return SampledCurvature(s, bishop if framing == "bishop" else _frenet(s, bishop))


def bishop_curvature(t: Array, points: Array, first: Array, second: Array, normal: Array) -> tuple[Array, Array]:
    """Arc lengths ``(..., n)`` and ``u_x, u_y`` ``(..., n, 2)`` of curves ``(..., n, 3)`` at parameters ``t (n,)``.

    ``first`` and ``second`` are the derivatives by ``t``. ``normal`` is the direction of x at the base; only its
    component normal to the curve counts. Double reflection carries the frame, with an error of fourth order in the
    steps (W. Wang, B. Juettler, D. Zheng, Y. Liu, ACM Trans. Graphics 27(1), 2008). The first reflection is across the
    plane halfway to the next point. The second takes the reflected tangent to the next tangent.
    """
    from scipy.integrate import cumulative_simpson

    speed = np.linalg.norm(first, axis=-1, keepdims=True)
    tangent = first / speed
    bend = (second - tangent * _dot(tangent, second)) / speed**2
    halfway = _reflection(np.diff(points, axis=-2))
    reflected = (halfway @ tangent[..., :-1, :, None])[..., 0]
    turns = _reflection(tangent[..., 1:, :] - reflected) @ halfway
    x = np.empty_like(tangent)
    start = normal - tangent[..., 0, :] * _dot(tangent[..., 0, :], normal)
    x[..., 0, :] = start / np.linalg.norm(start, axis=-1, keepdims=True)
    for k in range(len(t) - 1):
        x[..., k + 1, :] = (turns[..., k, :, :] @ x[..., k, :, None])[..., 0]
    y = np.cross(tangent, x)
    lengths = cumulative_simpson(speed[..., 0], x=t, initial=0.0, axis=-1)
    return lengths, np.stack((-np.sum(bend * y, axis=-1), np.sum(bend * x, axis=-1)), axis=-1)


def _reflection(across: Array) -> Array:
    """Reflection matrices ``(..., 3, 3)`` across planes normal to the vectors ``(..., 3)``."""
    square = _dot(across, across)[..., None]
    return np.asarray(np.eye(3) - 2.0 * across[..., :, None] * across[..., None, :] / square)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=-1, keepdims=True))


def _across(slope: Array, normal: Array) -> Array:
    """Return ``normal``, or another direction if it is along the curve at the base."""
    start = slope / np.linalg.norm(slope)
    if np.linalg.norm(normal - start * (start @ normal)) < 1e-9 * max(1.0, float(np.linalg.norm(normal))):
        return np.cross(start, np.roll(start, 1) + np.array([0.0, 0.0, 1e-3]))
    return normal


def _spline_of_points(points: Any) -> Any:
    from scipy.interpolate import make_interp_spline

    rows = array(points, "curve", (None, 3), unit="m")
    if len(rows) < 4:
        raise DefinitionError(f"curve has {len(rows)} points, but must have at least 4")
    return make_interp_spline(chord_lengths(rows, "curve"), rows, k=5 if len(rows) >= 6 else 3)


def chord_lengths(points: Array, field: str) -> Array:
    """Lengths along the chords of points ``(k, 3)``, from 0. Neighbours must differ; errors name ``field``."""
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if np.any(chords == 0.0):
        k = int(np.argmin(chords))
        raise DefinitionError(
            f"{field}[{k}] and {field}[{k + 1}] are the same point {points[k].tolist()} but must differ"
        )
    return np.concatenate(([0.0], np.cumsum(chords)))


def _spline_of_function(curve: Callable[[float], Any], interval: tuple[float, float]) -> Any:
    from scipy.interpolate import make_interp_spline

    ends = array(interval, "interval", (2,))
    if ends[1] <= ends[0]:
        raise DefinitionError(f"interval = {ends.tolist()} must be increasing")
    t = np.linspace(ends[0], ends[1], _FIT_SAMPLES)
    rows = array([np.asarray(curve(float(x)), dtype=np.float64) for x in t], "curve(t)", (None, 3), unit="m")
    return make_interp_spline(t, rows, k=7)


def _frenet(s: Array, bishop: Array) -> Array:
    """Turn a Bishop frame to the principal normal: ``(0, kappa, tau)``; ``tau`` is the derivative of the angle."""
    from scipy.interpolate import make_interp_spline

    size = np.hypot(bishop[:, 0], bishop[:, 1])
    curved = size > _FLAT * size.max()
    if curved.sum() < 4:
        return np.column_stack((np.zeros(len(s)), size, np.zeros(len(s))))
    angles = _continued(s[curved], np.arctan2(-bishop[curved, 0], bishop[curved, 1]))
    angle = make_interp_spline(s[curved], angles, k=min(5, int(curved.sum()) - 1 | 1))
    phi = angle(s)
    kappa = bishop[:, 1] * np.cos(phi) - bishop[:, 0] * np.sin(phi)
    return np.column_stack((np.zeros(len(s)), kappa, angle.derivative()(s)))


def _continued(s: Array, angles: Array) -> Array:
    """Add multiples of pi to the angles, so that each continues the line through the two before it."""
    result = angles.copy()
    for k in range(1, len(s)):
        guess = result[k - 1]
        if k > 1:
            guess += (result[k - 1] - result[k - 2]) * (s[k] - s[k - 1]) / (s[k - 1] - s[k - 2])
        result[k] += np.pi * np.round((guess - result[k]) / np.pi)
    return result
