"""Vector-valued piecewise polynomials, which represent precurvatures and load tables."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array


@attrs.frozen(eq=False)
class PiecewisePolynomial:
    """A piecewise polynomial with values ``(3,)``.

    ``f(x) = sum_k coefficients[k, j] (x - breaks[j])^k`` on ``breaks[j] <= x <= breaks[j + 1]``. ``breaks`` has shape
    ``(pieces + 1,)``, ``coefficients`` ``(degree + 1, pieces, 3)``. The value at a break depends on the side, so the
    caller names the piece.
    """

    breaks: Array
    coefficients: Array

    @staticmethod
    def join(parts: list[PiecewisePolynomial]) -> PiecewisePolynomial:
        """Join parts one behind the other; each starts where the one before it ends."""
        breaks, end = [np.zeros(1)], 0.0
        for part in parts:
            breaks.append(end + part.breaks[1:])
            end = float(breaks[-1][-1])
        orders, pieces = zip(*(part.coefficients.shape[:2] for part in parts), strict=True)
        coefficients, first = np.zeros((max(orders), sum(pieces), 3)), 0  # many times as fast as numpy.pad
        for part, order, count in zip(parts, orders, pieces, strict=True):
            coefficients[:order, first : first + count] = part.coefficients
            first += count
        return PiecewisePolynomial(np.concatenate(breaks), coefficients)

    def piece(self, x: Array) -> NDArray[np.intp]:
        """Find the piece in which each ``x`` lies; outside the breaks, the first or the last."""
        return np.asarray(np.searchsorted(self.breaks[1:-1], x, side="right"))

    def __call__(self, x: Array, piece: NDArray[np.intp]) -> Array:
        """Evaluate at each ``x`` on the given ``piece``: ``x.shape + (3,)``."""
        local = (x - self.breaks[piece])[..., None]
        value = np.zeros((*np.shape(x), 3))
        for coefficient in self.coefficients[::-1]:
            value = value * local + coefficient[piece]
        return value

    def integrate(self, start: float, end: float, of: Callable[[Array], Array] | None = None) -> Array:
        """Integrate ``f`` over ``[start, end]``, ``(3,)``, or a function ``of`` its values ``(.., 3)``.

        It is exact for polynomials of ``f`` up to the third degree.
        """
        inner = self.breaks[(self.breaks > start) & (self.breaks < end)]
        edges = np.concatenate(([start], inner, [end]))
        points, weights = gauss(len(self.coefficients) + 1 if of is None else 2 * len(self.coefficients))
        half = 0.5 * np.diff(edges)[:, None]
        middle = 0.5 * (edges[1:] + edges[:-1])[:, None]
        values = self(middle + half * points, np.broadcast_to(self.piece(middle), (len(half), len(points))))
        return np.asarray(np.einsum("ij,ij...->...", half * weights, values if of is None else of(values)))


@cache
def gauss(count: int) -> tuple[Array, Array]:
    """Nodes and weights of the Gauss-Legendre rule."""
    points, weights = np.polynomial.legendre.leggauss(count)
    return points, weights
