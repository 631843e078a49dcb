"""Is a stationary point a minimum? The reduced Hessian against the elastic part alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix


@attrs.frozen(eq=False)
class Inertia:
    """Smallest generalized eigenvalue of (second variation, elastic metric) and the direction that belongs to it.

    ``smallest`` is dimensionless, at most about 1, zero at a fold, and negative at a saddle; ``direction`` is a step
    in all variables that keeps the linearized constraints, of unit size in the metric.
    """

    smallest: float
    negative: int
    direction: Array


def reduced_inertia(
    hessian: csc_matrix, jacobian: csc_matrix, free: NDArray[np.intp], metric: Array, margin: float
) -> Inertia:
    """Inertia of ``hessian`` on the null space of ``jacobian``.

    ``free`` are the variables that determine all others through the constraints, ``metric`` their positive weights.
    Eigenvalues below ``-margin`` count as negative.
    """
    from scipy.linalg import eigh
    from scipy.sparse.linalg import splu

    size = hessian.shape[0]
    bound = np.setdiff1d(np.arange(size), free)
    basis = np.zeros((size, len(free)))
    basis[free, np.arange(len(free))] = 1.0 / np.sqrt(metric)
    right = jacobian[:, free].toarray() / np.sqrt(metric)
    basis[bound] = -splu(jacobian[:, bound]).solve(right)
    reduced = basis.T @ (hessian @ basis)
    values, vectors = eigh(0.5 * (reduced + reduced.T), subset_by_index=(0, min(5, len(free) - 1)))
    direction = basis @ vectors[:, 0]
    direction *= np.sign(direction[np.argmax(np.abs(direction))])
    return Inertia(float(values[0]), int((values < -margin).sum()), direction)
