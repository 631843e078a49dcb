"""From the noise of points to the standard errors of the curvature of the smooth curve through them."""

from __future__ import annotations

import attrs
import numpy as np

from ..checks import Array
from .bishop import bishop_curvature
from .smoothing import Smoother

_FINER = 4  # steps between two samples, in which the frame is carried
_STEP = 1e-5  # of differences by the coefficients, of the curve's length: curvatures of 1/length change by 1e-4


def tangents(smoother: Smoother, coefficients: Array, t: Array) -> Array:
    """Unit tangents ``(k, 3)`` at parameters ``(k,)``."""
    first = smoother.curve(coefficients, t, 1)
    return np.asarray(first / np.linalg.norm(first, axis=-1, keepdims=True))


@attrs.frozen(eq=False)
class Noise:
    """Points, their covariances ``(k, 3, 3)`` and the variance of unit weight."""

    points: Array
    spreads: Array
    unit: float

    def of_coefficients(self, smoother: Smoother) -> Array:
        """Covariance ``(3 m, 3 m)``: noise across the curve, and what a penalty leaves unknown."""
        tangent = tangents(smoother, smoother.coefficients(self.points), smoother.parameters)
        across = np.eye(3) - tangent[:, :, None] * tangent[:, None, :]
        spread = np.einsum("ai,bi,ijk->ajbk", smoother.solver, smoother.solver, across @ self.spreads @ across)
        spread = spread + self.unit * np.einsum("ab,jk->ajbk", smoother.shrinkage, np.eye(3))
        return np.asarray(spread.reshape(2 * (3 * smoother.basis.size,)))


@attrs.frozen(eq=False)
class Curves:
    """Curves by a smoother's coefficients, at ``samples`` places uniform in the parameter."""

    smoother: Smoother
    samples: int
    normal: Array

    def position(self, points: Array) -> Array:
        """The smooth curve of points."""
        t = np.linspace(0.0, 1.0, self.samples)
        return self.smoother.curve(self.smoother.coefficients(points), t)

    def of(self, coefficients: Array) -> tuple[Array, Array]:
        """Arc lengths ``(..., samples)`` and curvatures ``(..., samples, 2)`` for coefficients ``(..., m, 3)``."""
        t = np.linspace(0.0, 1.0, _FINER * (self.samples - 1) + 1)
        points, first, second = (self.smoother.curve(coefficients, t, n) for n in range(3))
        s, curvature = bishop_curvature(t, points, first, second, self.normal)
        return s[..., ::_FINER], curvature[..., ::_FINER, :]

    def known(self, noise: Noise) -> tuple[Array, Array, Array]:
        """Arc length, curvature and its standard errors, at the same arc length."""
        from scipy.interpolate import CubicSpline

        coefficients = self.smoother.coefficients(noise.points)
        s, curvature = self.of(coefficients)
        step, size = _STEP * s[-1], coefficients.size
        shifts = step * np.eye(size).reshape(size, *coefficients.shape)
        up, down = self.of(coefficients + shifts), self.of(coefficients - shifts)
        slope = CubicSpline(s, curvature)(s, 1)
        jacobian = (up[1] - down[1] - slope * (up[0] - down[0])[..., None]) / (2.0 * step)
        variance = np.einsum("asc,ab,bsc->sc", jacobian, noise.of_coefficients(self.smoother), jacobian, optimize=True)
        return s, curvature, np.sqrt(np.maximum(variance, 0.0))
