"""Load densities: a constant ``(3,)`` per arc length, a table, or a user's function of ``s``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import attrs
import numpy as np

from ..checks import Array, Entry, array
from ..errors import DefinitionError
from ..robot.piecewise import PiecewisePolynomial
from .resolution import called, resolve


@attrs.frozen(eq=False)
class LoadTable:
    """A load density given at points and interpolated linearly between them: ``(s (k,), values (k, 3))``."""

    arc_length: Array
    values: Any

    def polynomial(self) -> PiecewisePolynomial:
        """Return the interpolant between the first and the last point of the table."""
        slopes = np.diff(self.values, axis=0) / np.diff(self.arc_length)[:, None]
        return PiecewisePolynomial(self.arc_length, np.stack((self.values[:-1], slopes)))

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, LoadTable)
            and np.array_equal(self.arc_length, other.arc_length)
            and np.array_equal(self.values, other.values)
        )


LoadFunction: TypeAlias = Callable[[float], Any]
Density: TypeAlias = Array | LoadTable | LoadFunction


class DensityEntry(Entry):
    """Entry for a load density."""

    def checked(self, value: Any, field: str) -> Density:
        """Check a density as a user gives it, and return it clean."""
        return _density(value, field, self.unit)


def _density(value: Any, field: str, unit: str) -> Density:
    if callable(value) or isinstance(value, LoadTable):
        return value  # type: ignore[no-any-return]
    if isinstance(value, (tuple, list)) and len(value) == 2:
        s = array(value[0], f"{field}[0] (arc lengths)", (None,), unit="m")
        table = array(value[1], f"{field}[1] (values)", (None, 3), unit=unit)
        if len(s) < 2 or len(s) != len(table):
            raise DefinitionError(
                f"{field}: a table needs at least 2 arc lengths and a row for each, but has {len(s)} arc lengths "
                f"and {len(table)} rows"
            )
        if np.any(np.diff(s) <= 0.0):
            k = int(np.argmax(np.diff(s) <= 0.0)) + 1
            raise DefinitionError(f"{field}: arc length [{k}] = {s[k]:g} m must be above [{k - 1}] = {s[k - 1]:g} m")
        return LoadTable(s, table)
    return array(value, field, (3,), unit=unit)


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and np.array_equal(a, b)
    return bool(a == b)


DENSITY_EQ = attrs.cmp_using(eq=_same)
"""Equality of a field that holds a density."""


def numbers_of(density: Any) -> Any:
    """Return the values of a table; any other density unchanged."""
    return density.values if isinstance(density, LoadTable) else density


def scaled(density: Any, factor: float) -> Any:
    """Multiply a density, or a number, by a factor."""
    if isinstance(density, LoadTable):
        return attrs.evolve(density, values=factor * density.values)
    if callable(density):
        return lambda s: factor * np.asarray(density(s), dtype=np.float64)
    return factor * density


def acts(density: Density) -> bool:
    """Whether a density may be nonzero somewhere; a function always may."""
    return callable(density) or bool(np.any(numbers_of(density)))


def knots(density: Density, start: float, end: float, field: str) -> Sequence[float]:
    """Arc lengths between ``start`` and ``end`` where integration steps must end; messages name ``field``."""
    if isinstance(density, LoadTable):
        return density.arc_length[(density.arc_length > start) & (density.arc_length < end)].tolist()  # type: ignore[no-any-return]
    return resolve(density, start, end, field) if callable(density) else ()


def largest(density: Density, start: float, end: float) -> float:
    """Rough upper bound of a density's norm between ``start`` and ``end``."""
    if callable(density):
        return max(float(np.linalg.norm(called(density, float(s), "load"))) for s in np.linspace(start, end, 9))
    return float(np.linalg.norm(numbers_of(density), axis=-1).max())


def values_at(density: Density, s: Array, middle: Array, field: str) -> Array:
    """Values ``(k, nodes, 3)`` of a density at ``s (k, nodes)`` of steps whose sections contain ``middle (k,)``."""
    if isinstance(density, LoadTable):
        polynomial = density.polynomial()
        covered = (middle > density.arc_length[0]) & (middle < density.arc_length[-1])
        piece = np.broadcast_to(polynomial.piece(middle)[:, None], s.shape)
        return np.asarray(polynomial(s, piece) * covered[:, None, None])
    if callable(density):
        return np.array([[called(density, float(x), field) for x in row] for row in s])
    return np.broadcast_to(np.asarray(density), (*s.shape, 3))


def value_at(density: Density, s: float) -> Array:
    """Value ``(3,)`` of a density at ``s``; the ends of a table belong to it."""
    if isinstance(density, LoadTable):
        return np.array([np.interp(s, density.arc_length, column, 0.0, 0.0) for column in density.values.T])
    return np.asarray(density(s) if callable(density) else density, dtype=np.float64)
