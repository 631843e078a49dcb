"""Explicit Runge-Kutta methods as values; the tableaus are SciPy's (Dormand and Prince; Hairer, Norsett and Wanner)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import attrs
import numpy as np

from ..checks import Array
from ..mechanics.so3 import SymT


@attrs.frozen(eq=False)
class RungeKutta:
    """A method ``x+ = x + h sum_j weights_j k_j``, ``k_j = f(x + h sum_i matrix_ji k_i)`` at fractions ``nodes_j``.

    ``fifth, third``: weights of DOP853's two estimates of its local error; zeros for others.
    """

    name: str
    order: int
    matrix: Array
    weights: Array
    nodes: Array
    fifth: Array
    third: Array

    def step(self, derivative: Callable[[SymT, int], SymT], x: SymT, length: SymT) -> SymT:
        """Take one step; ``derivative(x, j)`` is the right-hand side with the data of stage ``j``."""
        slopes: list[SymT] = []
        for j, row in enumerate(self.matrix):
            inner = x
            for slope, coefficient in zip(slopes, row, strict=False):
                if coefficient != 0.0:
                    inner = inner + length * float(coefficient) * slope
            slopes.append(derivative(inner, j))
        result = x
        for slope, weight in zip(slopes, self.weights, strict=True):
            if weight != 0.0:
                result = result + length * float(weight) * slope
        return result


INTEGRATORS = ("RK4", "RK5", "RK8")


@cache
def runge_kutta(name: str = "RK8") -> RungeKutta:
    """The method ``"RK4"`` (classical), ``"RK5"`` (Dormand-Prince) or ``"RK8"`` (formula of DOP853)."""
    if name == "RK4":
        matrix = np.array([[0, 0, 0, 0], [0.5, 0, 0, 0], [0, 0.5, 0, 0], [0, 0, 1, 0]], dtype=float)
        none = np.zeros(4)
        return RungeKutta(name, 4, matrix, np.array([1, 2, 2, 1]) / 6, np.array([0, 0.5, 0.5, 1]), none, none)
    from scipy.integrate import DOP853, RK45

    if name == "RK5":
        none = np.zeros(6)
        return RungeKutta(name, 5, np.asarray(RK45.A), np.asarray(RK45.B), np.asarray(RK45.C), none, none)
    a, b, c, e5, e3 = (np.asarray(part) for part in (DOP853.A, DOP853.B, DOP853.C, DOP853.E5[:-1], DOP853.E3[:-1]))
    return RungeKutta(name, 8, a, b, c, e5, e3)
