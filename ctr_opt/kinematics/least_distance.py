"""Small quadratic programs with linear inequalities, solved by non-negative least squares.

The shortest vector within inequalities (LDP) follows from the residual of a non-negative least-squares problem: Lawson
and Hanson, Solving Least Squares Problems, 1974, chapter 23.
"""

from __future__ import annotations

import numpy as np

from ..checks import Array

_CONTRADICTION = 1e-10  # residual, 1 / (1 + |x|^2), below which the inequalities are taken to contradict each other
_ROUNDING = 1e-16  # of steps smaller than one


def least_distance(rows: Array, most: Array) -> Array | None:
    """Find the shortest ``x`` with ``rows x <= most``; None if no ``x`` satisfies it."""
    from scipy.optimize import nnls

    system = -np.vstack((rows.T, most))
    right = np.zeros(len(system))
    right[-1] = 1.0
    residual = system @ nnls(system, right)[0] - right
    return None if -residual[-1] < _CONTRADICTION else np.asarray(-residual[:-1] / residual[-1])


def bounded_step(hessian: Array, gradient: Array, rows: Array, room: Array) -> Array:
    """Minimize ``d^T hessian d / 2 + gradient^T d`` over steps ``d`` with ``rows d <= room``, for ``room >= 0``."""
    root = np.linalg.cholesky(hessian)
    free = np.asarray(-np.linalg.solve(hessian, gradient))
    left = room - rows @ free
    if (left >= 0.0).all():
        return free
    change = least_distance(np.linalg.solve(root, rows.T).T, left)
    if change is None:
        return np.zeros_like(free)
    step = free + np.linalg.solve(root.T, change)
    left = room - rows @ step
    if left.min() < -_ROUNDING:  # rounding of a long free step, if the Hessian is nearly singular
        back = least_distance(rows, left)
        step = step if back is None else step + back
    return np.asarray(step)
