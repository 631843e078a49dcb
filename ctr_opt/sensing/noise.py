"""How well points are known: one number, one for each point, or a covariance for each."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..checks import Array, array, number
from ..errors import DefinitionError


def points_of(value: Any, field: str, *, least: int) -> Array:
    """``value`` as points ``(k, 3)``, m, at least so many."""
    points = array(value, field, (None, 3), unit="m")
    if len(points) < least:
        raise DefinitionError(f"{field} has {len(points)} points, but needs at least {least}")
    return points


def deviations_of(sigma: Any, size: int, field: str = "sigma", unit: str = "m") -> Array:
    """Standard deviations ``(size,)`` from one for all or one for each."""
    if np.ndim(sigma) == 0:
        return np.full(size, number(sigma, field, above=0.0, unit=unit))
    values = array(sigma, field, (size,), unit=unit)
    if not (values > 0.0).all():
        k = int(np.argmin(values > 0.0))
        raise DefinitionError(f"{field}[{k}] = {values[k]:g}{unit and f' {unit}'} must be above 0")
    return values


def covariances_of(sigma: Any, covariances: Any, size: int) -> Array | None:
    """Covariances ``(size, 3, 3)``, m^2, from what was given of the two; None if nothing was."""
    if sigma is not None and covariances is not None:
        raise DefinitionError("sigma and covariances say the same thing: give one of them")
    if sigma is not None:
        return np.eye(3) * deviations_of(sigma, size)[:, None, None] ** 2
    if covariances is None:
        return None
    values = array(covariances, "covariances", (size, 3, 3), unit="m^2")
    for k, value in enumerate(values):
        scale = np.abs(value).max()
        if not (np.abs(value - value.T).max() <= 1e-9 * scale and np.linalg.eigvalsh(value)[0] > 0.0):
            raise DefinitionError(f"covariances[{k}] must be symmetric and positive definite, with entries in m^2")
    return values


def symmetric(matrix: Any) -> Array:
    """The matrices without the rounding that makes them asymmetric."""
    return np.asarray(0.5 * (matrix + np.swapaxes(matrix, -1, -2)), dtype=np.float64)


def millimetres(values: Array) -> str:
    """Lengths in m as text in mm."""
    return "(" + ", ".join(f"{1e3 * value:.3f}" for value in values) + ") mm"
