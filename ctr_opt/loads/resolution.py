"""Break points for a load given as a function, so that integration steps between them resolve it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..checks import Array
from ..errors import DefinitionError

_GRID = 1024  # parts of the interval at whose ends a function is sampled: narrower features may be missed
_DEGREE = 7  # of the polynomial that must describe each part
_DEVIATION = 1e-3  # from this polynomial, relative to the function's peak; the solver halves steps further if needed
_DEEPEST = 14  # halvings of the interval at most: jumps and kinks never become polynomials


def resolve(density: Any, start: float, end: float, field: str) -> list[float]:
    """Break points that cut ``[start, end]`` into parts on which the function is nearly a polynomial."""
    grid = np.linspace(start, end, _GRID + 1)
    values = np.array([called(density, float(s), field) for s in grid])
    peak = float(np.abs(values).max())
    break_points: list[float] = []

    def cut(a: float, b: float, depth: int) -> None:
        inside = (grid >= a) & (grid <= b)
        s, f = (grid[inside], values[inside]) if inside.sum() >= 2 * _DEGREE else _samples(density, a, b, field)
        nodes, at_nodes = _samples(density, a, b, field, chebyshev=True)
        scaled = (2.0 * nodes - a - b) / (b - a)
        fit = np.polynomial.chebyshev.chebfit(scaled, at_nodes, _DEGREE)
        deviation = np.abs(np.polynomial.chebyshev.chebval((2.0 * s - a - b) / (b - a), fit).T - f).max()
        if deviation > _DEVIATION * peak and depth < _DEEPEST:
            middle = 0.5 * (a + b)
            cut(a, middle, depth + 1)
            break_points.append(middle)
            cut(middle, b, depth + 1)

    if peak > 0.0:
        cut(start, end, 0)
    return break_points


def called(density: Any, s: float, field: str) -> Array:
    """Call a user's function at ``s`` and check its value ``(3,)``."""
    try:
        value = np.asarray(density(s), dtype=np.float64)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise DefinitionError(f"{field}({s:g} m) must return three finite numbers, but failed: {reason}") from error
    if value.shape != (3,) or not np.all(np.isfinite(value)):
        raise DefinitionError(f"{field}({s:g} m) = {value.tolist()!r} must be three finite numbers")
    return value


def _samples(density: Any, a: float, b: float, field: str, *, chebyshev: bool = False) -> tuple[Array, Array]:
    count = _DEGREE + 1 if chebyshev else 2 * _DEGREE
    points = np.cos(np.pi * (np.arange(count) + 0.5) / count) if chebyshev else np.linspace(-1.0, 1.0, count)
    s = np.asarray(0.5 * (a + b) + 0.5 * (b - a) * points)
    return s, np.array([called(density, float(x), field) for x in s])
