"""Loss functions of the squared norm of a block of whitened residuals (a point, a pose)."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import attrs
import numpy as np

from ..checks import Array
from .chi_square import quantile, tail

LOSSES = {
    "squared": "weighted least squares",
    "distance": "sum of distances",
    "huber": "Huber's loss",
    "cauchy": "Cauchy's loss",
}
"""The losses, and what they are called in reports."""

SMOOTHING = 1e-2  # standard deviations: the distance is sqrt(r^2 + SMOOTHING^2) - SMOOTHING, as it has a corner at zero
_HUBER, _CAUCHY = 1.345, 2.385  # 95 % efficient for normal errors of one dimension


@attrs.frozen(eq=False, slots=False)
class Loss:
    """One of ``LOSSES`` for blocks with ``size`` numbers: one size for all blocks, or one for each.

    ``rho(s)`` of the squared norm s: squared ``s / 2``; distance ``sqrt(s + d^2) - d``. The thresholds of Huber and
    Cauchy leave the same share of good blocks untouched as in one dimension.
    """

    name: str
    size: Any

    @cached_property
    def threshold(self) -> Any:
        """Residual norm above which a block is down-weighted, standard deviations; infinite for squared."""
        if self.name == "huber":
            return np.sqrt(quantile(1.0 - tail(_HUBER**2, 1), self.size))
        if self.name == "cauchy":
            return _CAUCHY * np.sqrt(quantile(0.5, self.size) / quantile(0.5, 1))
        return SMOOTHING if self.name == "distance" else np.inf

    def evaluate(self, squared: Any) -> tuple[Array, Array, Array]:
        """The loss ``rho`` and its first and second derivatives by the squared norms."""
        s = np.asarray(squared, dtype=np.float64)
        if self.name == "squared":
            return 0.5 * s, np.full_like(s, 0.5), np.zeros_like(s)
        d = self.threshold
        if self.name == "distance":
            root = np.sqrt(s + d**2)
            return s / (root + d), 0.5 / root, -0.25 / root**3
        if self.name == "cauchy":
            grown = 1.0 + s / d**2
            return 0.5 * d**2 * np.log1p(s / d**2), 0.5 / grown, -0.5 / (d * grown) ** 2
        norm = np.sqrt(np.maximum(s, d**2))
        far = s > d**2
        return (
            np.where(far, d * norm - 0.5 * d**2, 0.5 * s),
            np.where(far, 0.5 * d / norm, 0.5),
            np.where(far, -0.25 * d / norm**3, 0.0),
        )
