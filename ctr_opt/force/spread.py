"""Errors of forces within bounds or a friction cone: moments of truncated normal distributions.

An active bound does not make an estimate more precise: the force may be anywhere inside that the measurements allow.
The density is that of the free estimate, to first order, in the allowed region, and zero elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable

import attrs
import numpy as np

from ..checks import Array

_GRID = 33  # points of the grid that locates a density
_PUSHES, _SLIDES = 48, 32  # integration nodes
_ROUNDS = 12  # refinements of the grid
_LEAST = -30.0  # logarithm of negligible densities, relative
_SMOOTH = 1e-9  # friction in the place of zero
_FAR = 8.0  # standard deviations beyond which a density is negligible


@attrs.frozen(eq=False)
class Spread:
    """Mean ``(n,)`` and covariance ``(n, n)`` of a distribution."""

    mean: Array
    covariance: Array

    @property
    def about_zero(self) -> Array:
        """Second moments about zero ``(n, n)``."""
        return self.covariance + np.outer(self.mean, self.mean)

    def of(self, part: slice) -> Spread:
        """The marginal distribution of a part of the numbers."""
        return Spread(self.mean[part], self.covariance[part, part])

    def given(self, part: slice, known: Spread) -> Spread:
        """The distribution with a new marginal of one part; the rest follows by its correlation."""
        before = self.of(part)
        gain = np.linalg.solve(before.covariance, self.covariance[part]).T
        mean = self.mean + gain @ (known.mean - before.mean)
        return Spread(mean, self.covariance + gain @ (known.covariance - before.covariance) @ gain.T)


def between(free: Spread, lowest: float, highest: float) -> Spread:
    """Distribution of one number truncated to an interval."""
    from scipy.stats import truncnorm

    deviation, middle = float(np.sqrt(free.covariance[0, 0])), float(free.mean[0])
    lowest, highest = (lowest - middle) / deviation, (highest - middle) / deviation
    where = {"loc": middle, "scale": deviation}
    mean, variance = (float(moment(lowest, highest, **where)) for moment in (truncnorm.mean, truncnorm.var))
    return Spread(np.array([mean]), np.array([[max(variance, 0.0)]]))


def within_cone(free: Spread, at: Array, normal: Array, friction: float) -> Spread:
    """Distribution of a force's deviation ``(3,)`` from ``at``, truncated to Coulomb's cone about a unit normal."""
    truncated = _TruncatedCone.of(at + free.mean, free.covariance, normal, max(friction, _SMOOTH)).spread()
    return Spread(truncated.mean - at, truncated.covariance)


@attrs.frozen(eq=False)
class _TruncatedCone:
    """A normal density of forces truncated to Coulomb's cone: a push along the normal, and a slide across it.

    ``center`` and ``information`` are in a ``frame`` of the push and two axes across. Along these axes the slide's two
    components are independent at a given push.
    """

    center: Array
    information: Array
    frame: Array
    friction: float

    @classmethod
    def of(cls, center: Array, covariance: Array, normal: Array, friction: float) -> _TruncatedCone:
        information = np.linalg.inv(covariance)
        across = np.linalg.svd(normal[None])[2][1:].T
        across = across @ np.linalg.eigh(across.T @ information @ across)[1]
        frame = np.column_stack((normal, across))
        return cls(frame.T @ center, frame.T @ information @ frame, frame, friction)

    def spread(self) -> Spread:
        """Mean and covariance of the truncated density of the force."""
        a, over_a = _gauss(*_box(lambda a: self._slides(a[0])[0][None], np.zeros(1), np.array([self._most]), _PUSHES))
        logarithms, x, over_x, y, over_y = self._slides(a[0])
        weights = np.exp(logarithms - logarithms.max())[:, None, None] * over_a[0][:, None, None]
        weights = (weights * over_x[:, :, None] * over_y).ravel()
        weights /= weights.sum()
        forces = np.stack(np.broadcast_arrays(a[0][:, None, None], x[:, :, None], y), axis=-1).reshape(-1, 3)
        mean = weights @ forces
        covariance = (weights[:, None] * (forces - mean)).T @ (forces - mean)
        return Spread(self.frame @ mean, self.frame @ covariance @ self.frame.T)

    @property
    def _most(self) -> float:
        """A push beyond which the density is negligible: the best force is at most as far off as zero force."""
        deviation = np.sqrt(np.linalg.inv(self.information)[0, 0])
        off = np.sqrt(self.center @ self.information @ self.center)
        return float(max(self.center[0], 0.0) + deviation * (off + _FAR))

    def _slides(self, a: Array) -> tuple[Array, ...]:
        """Integrate over slides at pushes ``(k,)``: logarithms of the integrals, nodes and weights.

        Nodes and weights are those of the first axis ``(k, m)``, and of the second at each of the first ``(k, m, l)``.
        """
        along, coupled, off = np.diag(self.information), self.information[0, 1:], a - self.center[0]
        means = self.center[1:] - np.outer(off, coupled / along[1:])
        most = self.friction * a

        def second(x: Array) -> tuple[Array, Array, Array]:
            edge = np.sqrt(np.maximum(most[:, None] ** 2 - x**2, 0.0))
            return _normal(np.broadcast_to(means[:, 1, None], x.shape), along[2], edge)

        def first(x: Array) -> Array:
            return np.asarray(-0.5 * along[1] * (x - means[:, :1]) ** 2 + second(x)[0])

        x, widths = _gauss(*_box(first, -most, most, _SLIDES))
        logarithms, y, over_y = second(x)
        logarithms = logarithms - 0.5 * along[1] * (x - means[:, :1]) ** 2
        peak = logarithms.max(axis=1)
        over_x = np.exp(logarithms - np.where(np.isfinite(peak), peak, 0.0)[:, None]) * widths
        with np.errstate(divide="ignore"):
            whole = peak + np.log(over_x.sum(axis=1))
        curved = along[0] - float((coupled**2 / along[1:]).sum())
        return whole - 0.5 * curved * off**2, x, over_x / np.maximum(over_x.sum(axis=1), 1e-300)[:, None], y, over_y


def _normal(mean: Array, information: float, edge: Array) -> tuple[Array, Array, Array]:
    """Integrals of normal densities from ``-edge`` to ``edge``: logarithms, nodes, and relative weights."""
    nearest = np.clip(mean, -edge, edge)
    beyond = np.abs(mean - nearest)
    reach = np.minimum(_FAR / np.sqrt(information), -_LEAST / np.maximum(information * beyond, 1e-300))
    nodes, widths = _gauss(np.maximum(nearest - reach, -edge), np.minimum(nearest + reach, edge), _SLIDES)
    logarithms = -0.5 * information * ((nodes - mean[..., None]) ** 2 - beyond[..., None] ** 2)
    shares = np.exp(logarithms) * widths
    whole = shares.sum(axis=-1)
    with np.errstate(divide="ignore"):
        logarithm = np.log(whole) - 0.5 * information * beyond**2
    return logarithm, nodes, shares / np.maximum(whole, 1e-300)[..., None]


def _box(logarithm: Callable[[Array], Array], low: Array, high: Array, count: int) -> tuple[Array, Array, int]:
    """Intervals within ``low`` and ``high (k,)`` where densities ``(k, ...)`` count, by refining a grid."""
    rows = np.arange(len(low))
    for _ in range(_ROUNDS):
        grid = np.linspace(low, high, _GRID, axis=1)
        values = logarithm(grid)
        counts = values >= values.max(axis=1)[:, None] + _LEAST
        first = np.maximum(counts.argmax(axis=1) - 1, 0)
        last = np.minimum(_GRID - counts[:, ::-1].argmax(axis=1), _GRID - 1)
        narrowed = bool((last - first < _GRID // 2).any())
        low, high = grid[rows, first], grid[rows, last]
        if not narrowed:
            break
    return low, high, count


def _gauss(low: Array, high: Array, count: int) -> tuple[Array, Array]:
    """Gauss-Legendre nodes and weights ``(..., count)`` between edges."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    half = 0.5 * (high - low)[..., None]
    return low[..., None] + half * (1.0 + nodes), half * weights
