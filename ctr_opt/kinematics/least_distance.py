"""Small quadratic programs with linear inequalities: the steps of an active-set method, by non-negative least squares.

Lawson and Hanson, Solving Least Squares Problems, 1974, chapter 23: the shortest vector within inequalities (LDP) is
what is left of a non-negative least-squares problem.
"""

from __future__ import annotations

import numpy as np

from ..checks import Array

_CONTRADICTION = 1e-10  # what is left where inequalities contradict each other: points farther than 1e10 are none
_ROUNDING = 1e-16  # of steps of a size below one


def least_distance(rows: Array, most: Array) -> Array | None:
    """The shortest ``x`` with ``rows x <= most``; None where there is none."""
    from scipy.optimize import nnls

    system = -np.vstack((rows.T, most))
    wanted = np.zeros(len(system))
    wanted[-1] = 1.0
    left = system @ nnls(system, wanted)[0] - wanted
    return None if -left[-1] < _CONTRADICTION else np.asarray(-left[:-1] / left[-1])


def bounded_step(hessian: Array, gradient: Array, rows: Array, room: Array) -> Array:
    """The step ``d`` of least ``d^T hessian d / 2 + gradient^T d`` with ``rows d <= room``, where ``room >= 0``."""
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
    if left.min() < -_ROUNDING:  # of a free step that was long, where the Hessian is nearly singular
        back = least_distance(rows, left)
        step = step if back is None else step + back
    return np.asarray(step)
