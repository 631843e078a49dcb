"""Noise of points: one standard deviation, one per point, or a covariance per point."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..checks import Array, array, number
from ..errors import DefinitionError


def points_of(value: Any, field: str, *, least: int) -> Array:
    """Convert ``value`` to points ``(k, 3)``, m, with ``k >= least``."""
    points = array(value, field, (None, 3), unit="m")
    if len(points) < least:
        raise DefinitionError(f"{field} has {len(points)} points, but must have at least {least}")
    return points


def deviations_of(sigma: Any, size: int, unit: str = "m") -> Array:
    """Expand one standard deviation, or check one per item, to ``(size,)``."""
    if np.ndim(sigma) == 0:
        return np.full(size, number(sigma, "sigma", above=0.0, unit=unit))
    return array(sigma, "sigma", (size,), above=0.0, unit=unit)


def covariances_of(sigma: Any, value: Any, field: str, shape: tuple[int, ...], unit: str = "") -> Array | None:
    """Check ``value`` as covariances of a shape; None for None, and an error if ``sigma`` is also given."""
    if value is None:
        return None
    if sigma is not None:
        raise DefinitionError(f"sigma and {field} are both given: give one of them")
    values = array(value, field, shape, unit=unit)
    for place in np.ndindex(shape[:-2]):
        matrix, name = values[place], field + "".join(f"[{k}]" for k in place)
        scale = np.abs(matrix).max()
        if not (np.abs(matrix - matrix.T).max() <= 1e-9 * scale and np.linalg.eigvalsh(matrix)[0] > 0.0):
            entries = f", with entries in {unit}" if unit else ""
            raise DefinitionError(f"{name} must be symmetric and positive definite{entries}")
    return values


def spreads_of(sigma: Any, covariances: Any, size: int) -> tuple[Array, bool]:
    """Covariances of points ``(size, 3, 3)``, m^2, and whether they are mere unit weights because none are given."""
    checked = covariances_of(sigma, covariances, "covariances", (size, 3, 3), "m^2")
    if checked is not None:
        return checked, False
    deviations = deviations_of(1.0 if sigma is None else sigma, size)
    return np.eye(3) * deviations[:, None, None] ** 2, sigma is None


def symmetric(matrix: Any) -> Array:
    """Symmetrize matrices that rounding made asymmetric."""
    return np.asarray(0.5 * (matrix + np.swapaxes(matrix, -1, -2)), dtype=np.float64)


def numbers(values: Array, style: str = ".3f") -> str:
    """Format numbers as text, separated by commas."""
    return ", ".join(format(value, style) for value in values)
