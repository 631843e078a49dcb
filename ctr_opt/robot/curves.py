"""From a preset curve ``r*(s)`` to the precurvature ``u*(s)`` of a tube (paper, II-B)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import attrs
import numpy as np

from ..checks import Array, array, choice, index
from ..errors import DefinitionError
from .precurvature import SampledCurvature

_FIT_SAMPLES = 201  # of a curve given as a function; the third derivative of a seventh-degree spline is good to 1e-9
_FLAT = 1e-3  # of the largest curvature: below, the normal of the curve is not asked for its direction


def precurvature_from_curve(
    curve: Any,
    *,
    framing: str = "bishop",
    interval: tuple[float, float] = (0.0, 1.0),
    samples: int = 101,
    normal: Any = (1.0, 0.0, 0.0),
) -> SampledCurvature:
    """Precurvature of a tube whose preset shape is a given curve, in a chosen framing.

    Parameters
    ----------
    curve
        Points ``(k, 3)`` along the curve, ``k >= 4``, m, interpolated by a spline of degree five (so they should be
        smooth: fit noisy measurements first); or a function ``t -> (3,)`` of any regular parameter.
    framing
        ``"bishop"``: rotation-minimizing, ``u* = (u_x, u_y, 0)``; ``"frenet"``: Frenet-Serret, ``u* = (0, kappa,
        tau)`` with x along the principal normal. At an inflection the normal is continued smoothly, so ``kappa``
        changes its sign there and ``tau`` stays finite.
    interval
        Range of the parameter of a function.
    samples
        Points of the returned curvature, uniform in arc length, at least 5.
    normal
        Direction of x at the base for ``"bishop"``, as far as it is normal to the curve.

    Raises
    ------
    DefinitionError
        Points that coincide, too few of them, a curve that stands still, an unknown framing.

    Notes
    -----
    Both framings describe the same curve (paper, II-B); they differ in how the tube's frame turns along it.

    Examples
    --------
    A quarter of a circle of radius 50 mm:

    >>> import numpy as np
    >>> circle = lambda t: 0.05 * np.array([1 - np.cos(t), 0.0, np.sin(t)])
    >>> piece = precurvature_from_curve(circle, interval=(0.0, np.pi / 2))
    >>> round(piece.length, 6), (np.round(piece.curvature[50], 6) + 0.0).tolist()
    (0.07854, [0.0, 20.0, 0.0])
    """
    choice(framing, "framing", ("bishop", "frenet"))
    if index(samples, "samples") < 5:
        raise DefinitionError(f"samples = {samples!r} must be at least 5")
    geometry = _Geometry.of(curve, interval, samples)
    bishop = _bishop(geometry, array(normal, "normal", (3,)))
    return SampledCurvature(geometry.s, bishop if framing == "bishop" else _frenet(geometry.s, bishop))


@attrs.frozen(eq=False)
class _Geometry:
    """Arc lengths ``s (k,)`` and, as functions of arc length, the tangent and its derivative."""

    s: Array
    tangent: Callable[[Any], Array]
    bend: Callable[[Any], Array]

    @classmethod
    def of(cls, curve: Any, interval: tuple[float, float], samples: int) -> _Geometry:
        spline = _spline_of_function(curve, interval) if callable(curve) else _spline_of_points(curve)
        first, second = spline.derivative(1), spline.derivative(2)
        knots = np.unique(spline.t)
        points, weights = np.polynomial.legendre.leggauss(12)
        half = 0.5 * np.diff(knots)
        inner = 0.5 * (knots[1:] + knots[:-1])[:, None] + half[:, None] * points
        slopes = first(inner)
        speeds = np.linalg.norm(slopes, axis=-1)
        ahead = np.einsum("...i,...i", slopes.reshape(-1, 3)[1:], slopes.reshape(-1, 3)[:-1])
        if not (np.all(speeds > 1e-9 * speeds.max()) and np.all(ahead > 0.0)):
            raise DefinitionError("curve: it stands still or turns back at a point, so it has no tangent there")
        lengths = np.concatenate(([0.0], np.cumsum(half * (speeds @ weights))))
        paces = 1.0 / np.linalg.norm(first(knots), axis=-1)

        def parameter(s: Any) -> Array:
            """``t`` at an arc length: a guess from the knots, then Newton's method on the length of the last piece."""
            s = np.asarray(s, dtype=np.float64)
            k = np.clip(np.searchsorted(lengths, s, side="right") - 1, 0, len(half) - 1)
            t = knots[k] + (s - lengths[k]) * paces[k]
            for _ in range(8):
                part = 0.5 * (t - knots[k])
                nodes = knots[k][..., None] + part[..., None] * (points + 1.0)
                reached = lengths[k] + part * (np.linalg.norm(first(nodes), axis=-1) @ weights)
                t = t - (reached - s) / np.linalg.norm(first(t), axis=-1)
            return np.asarray(t)

        def tangent(s: Any) -> Array:
            slope = first(parameter(s))
            return np.asarray(slope / np.linalg.norm(slope, axis=-1, keepdims=True))

        def bend(s: Any) -> Array:
            """``dT/ds``."""
            t = parameter(s)
            slope, change = first(t), second(t)
            speed = np.linalg.norm(slope, axis=-1, keepdims=True)
            along = slope / speed
            normal = change - along * np.sum(along * change, axis=-1, keepdims=True)
            return np.asarray(normal / speed**2)

        return cls(np.linspace(0.0, lengths[-1], samples), tangent, bend)


def _spline_of_points(points: Any) -> Any:
    from scipy.interpolate import make_interp_spline

    rows = array(points, "curve", (None, 3), unit="m")
    if len(rows) < 4:
        raise DefinitionError(f"curve has {len(rows)} points, but needs at least 4")
    chords = np.linalg.norm(np.diff(rows, axis=0), axis=1)
    if np.any(chords == 0.0):
        k = int(np.argmin(chords))
        raise DefinitionError(f"curve[{k}] and curve[{k + 1}] are the same point {rows[k].tolist()} but must differ")
    degree = 5 if len(rows) >= 6 else 3
    return make_interp_spline(np.concatenate(([0.0], np.cumsum(chords))), rows, k=degree)


def _spline_of_function(curve: Callable[[float], Any], interval: tuple[float, float]) -> Any:
    from scipy.interpolate import make_interp_spline

    ends = array(interval, "interval", (2,))
    if ends[1] <= ends[0]:
        raise DefinitionError(f"interval = {ends.tolist()} must be increasing")
    t = np.linspace(ends[0], ends[1], _FIT_SAMPLES)
    rows = array([np.asarray(curve(float(x)), dtype=np.float64) for x in t], "curve(t)", (None, 3), unit="m")
    return make_interp_spline(t, rows, k=7)


def _bishop(geometry: _Geometry, normal: Array) -> Array:
    """``u*`` in the frame whose x axis is carried along without turning about the tangent: ``x' = -(x . T') T``."""
    from scipy.integrate import solve_ivp

    start = geometry.tangent(0.0)
    across = normal - start * (start @ normal)
    if np.linalg.norm(across) < 1e-9 * max(1.0, float(np.linalg.norm(normal))):
        across = np.cross(start, np.roll(start, 1) + np.array([0.0, 0.0, 1e-3]))
    s = geometry.s
    found = solve_ivp(
        lambda at, x: -(x @ geometry.bend(at)) * geometry.tangent(at),
        (0.0, s[-1]),
        across / np.linalg.norm(across),
        "DOP853",
        s,
        rtol=1e-11,
        atol=1e-12,
        max_step=s[-1] / 20.0,
    )
    x, bend = found.y.T, geometry.bend(s)
    y = np.cross(geometry.tangent(s), x)
    return np.column_stack((-np.sum(bend * y, axis=1), np.sum(bend * x, axis=1), np.zeros(len(s))))


def _frenet(s: Array, bishop: Array) -> Array:
    """``(0, kappa, tau)``: the frame turned by the angle of the normal, which gives ``tau`` by its derivative."""
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
    """The angles with multiples of pi added, so that each follows the line of the two before it."""
    result = angles.copy()
    for k in range(1, len(s)):
        guess = result[k - 1]
        if k > 1:
            guess += (result[k - 1] - result[k - 2]) * (s[k] - s[k - 1]) / (s[k - 1] - s[k - 2])
        result[k] += np.pi * np.round((guess - result[k]) / np.pi)
    return result
