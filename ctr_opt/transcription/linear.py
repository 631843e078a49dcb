"""The linear algebra of a Newton step."""

from __future__ import annotations

import numpy as np

from ..checks import Array

NEGLIGIBLE = 1e-8
"""Singular values below are directions in which nothing is determined; a straight, unloaded robot's are about 1."""


def newton_correction(jacobian: Array, residual: Array, negligible: float = NEGLIGIBLE) -> Array:
    """The shortest ``dz`` with ``jacobian dz = -residual``.

    Where a family of equilibria exists (a buckled straight rod may lie in any plane) the Jacobian is singular along
    it, and the shortest correction leaves the family alone.
    """
    left, values, right = np.linalg.svd(jacobian)
    kept = values > max(negligible, float(np.finfo(float).eps) * values[0])
    inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    return np.asarray(-right.T @ (inverse * (left.T @ residual)))
