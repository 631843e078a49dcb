"""Propagation of the noise of points to standard errors of the curvature of the smooth curve through them."""

from __future__ import annotations

import attrs
import numpy as np

from ..checks import Array
from ..robot.curves import bishop_curvature
from .smoothing import Smoother

_FINER = 4  # steps between two samples, over which the frame is carried
_STEP = 1e-5  # of differences by the coefficients, of the curve's length: curvatures of 1/length change by 1e-4


@attrs.frozen(eq=False)
class Propagation:
    """Noise of points, and sampling of the smooth curves through them.

    Covariances of the points are ``spreads (k, 3, 3)``, m^2, with the variance ``unit`` of unit weight. The
    ``samples`` places are uniform in the parameter; ``normal`` is the direction of x at the base.
    """

    spreads: Array
    unit: float
    samples: int
    normal: Array

    def curvature(self, smoother: Smoother) -> tuple[Array, Array, Array]:
        """Compute arc lengths, curvatures and their standard errors at a fixed arc length."""
        from scipy.interpolate import CubicSpline

        coefficients = smoother.coefficients
        s, curvature = self._sampled(smoother, coefficients)
        step, size = _STEP * s[-1], coefficients.size
        shifts = step * np.eye(size).reshape(size, *coefficients.shape)
        up, down = (self._sampled(smoother, coefficients + sign * shifts) for sign in (1.0, -1.0))
        slope = CubicSpline(s, curvature)(s, 1)
        jacobian = (up[1] - down[1] - slope * (up[0] - down[0])[..., None]) / (2.0 * step)
        variance = np.einsum("asc,ab,bsc->sc", jacobian, self._covariance(smoother), jacobian, optimize=True)
        return s, curvature, np.sqrt(np.maximum(variance, 0.0))

    def _sampled(self, smoother: Smoother, coefficients: Array) -> tuple[Array, Array]:
        """Arc lengths ``(..., samples)`` and curvatures ``(..., samples, 2)`` for coefficients ``(..., m, 3)``."""
        t = np.linspace(0.0, 1.0, _FINER * (self.samples - 1) + 1)
        points, first, second = (smoother.curve(t, n, coefficients) for n in range(3))
        s, curvature = bishop_curvature(t, points, first, second, self.normal)
        return s[..., ::_FINER], curvature[..., ::_FINER, :]

    def _covariance(self, smoother: Smoother) -> Array:
        """Covariance of the coefficients ``(3 m, 3 m)``: noise across the curve, and bias by the penalty."""
        tangent = smoother.tangents(smoother.data.parameters)
        across = np.eye(3) - tangent[:, :, None] * tangent[:, None, :]
        spread = np.einsum("ai,bi,ijk->ajbk", smoother.solver, smoother.solver, across @ self.spreads @ across)
        spread = spread + self.unit * np.einsum("ab,jk->ajbk", smoother.shrinkage, np.eye(3))
        return np.asarray(spread.reshape(2 * (3 * smoother.basis.size,)))
