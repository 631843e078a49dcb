"""Factorizations of small dense symbolic matrices, without pivoting or eigenvalues, so that C code can do them.

The matrices are near the identity, or have a positive definite symmetric part.
"""

from __future__ import annotations

from typing import Any

import attrs
import casadi as ca

_PIVOT = 1e-8  # smaller pivots are moved to this size: then rounding and the change of the matrix are equally small
_NOTHING = 1e-12  # of a diagonal entry's size: a smaller remainder is rounding
_LOST = 1e-6  # of a diagonal entry's size: a more negative remainder is not rounding


@attrs.frozen(eq=False)
class Ldl:
    """The factorization ``L D L^T`` of a symmetric matrix, with pivots kept away from zero."""

    lower: Any
    pivots: list[Any]

    @classmethod
    def of(cls, matrix: Any) -> Ldl:
        """Factor a matrix."""
        lower, pivots = ca.SX.eye(matrix.shape[0]), []
        for j in range(matrix.shape[0]):
            pivot = matrix[j, j]
            pivots.append(ca.if_else(ca.fabs(pivot) < _PIVOT, ca.if_else(pivot < 0, -_PIVOT, _PIVOT), pivot))
            lower[j + 1 :, j] = matrix[j + 1 :, j] / pivots[j]
            matrix = matrix - pivots[j] * ca.mtimes(lower[:, j], lower[:, j].T)
        return cls(lower, pivots)

    @property
    def negative(self) -> Any:
        """Number of negative eigenvalues (Sylvester); all of them if one is NaN."""
        return sum((ca.if_else(pivot > 0, 0, 1) for pivot in self.pivots), ca.SX(0))

    def solve(self, right: Any) -> Any:
        """The solution ``(L D L^T)^-1 right``."""
        rows = [right[i, :] for i in range(right.shape[0])]
        for i in range(len(rows)):
            for k in range(i):
                rows[i] = rows[i] - self.lower[i, k] * rows[k]
        rows = [row / pivot for row, pivot in zip(rows, self.pivots, strict=True)]
        for i in reversed(range(len(rows))):
            for k in range(i + 1, len(rows)):
                rows[i] = rows[i] - self.lower[k, i] * rows[k]
        return ca.vertcat(*rows)


def solved(matrix: Any, right: Any) -> Any:
    """The solution ``matrix^-1 right`` by Gaussian elimination."""
    n = matrix.shape[0]
    both = [ca.horzcat(matrix[i, :], right[i, :]) for i in range(n)]
    for j in range(n):
        for i in range(j + 1, n):
            both[i] = both[i] - both[i][j] / both[j][j] * both[j]
    rows = [row[n:] for row in both]
    for i in reversed(range(n)):
        for k in range(i + 1, n):
            rows[i] = rows[i] - both[i][k] * rows[k]
        rows[i] = rows[i] / both[i][i]
    return ca.vertcat(*rows)


def root_of(matrix: Any, size: Any) -> tuple[Any, Any]:
    """A root ``G`` of a semidefinite ``G G^T = matrix``, and the number of pivots that contradict semidefiniteness."""
    root, lost = ca.SX(*matrix.shape), ca.SX(0)
    for j in range(matrix.shape[0]):
        pivot = matrix[j, j]
        lost += ca.if_else(pivot < -_LOST * size[j], 1, 0)
        kept = pivot > _NOTHING * size[j]
        root[j:, j] = ca.if_else(kept, matrix[j:, j] / ca.sqrt(ca.if_else(kept, pivot, 1)), 0)
        matrix = matrix - ca.mtimes(root[:, j], root[:, j].T)
    return root, lost


def quarters(matrix: Any) -> tuple[Any, Any, Any, Any]:
    """The blocks ``a, b, c, d`` of ``[[a, b], [c, d]]``."""
    n = matrix.shape[0] // 2
    return matrix[:n, :n], matrix[:n, n:], matrix[n:, :n], matrix[n:, n:]


def symplectic_defect(matrix: Any) -> Any:
    """Largest entry of ``M^T J M - J``, which is zero for symplectic matrices."""
    a, b, c, d = quarters(matrix)
    lost = [a.T @ c - c.T @ a, b.T @ d - d.T @ b, a.T @ d - c.T @ b - ca.SX.eye(a.shape[0])]
    return ca.norm_inf(ca.vertcat(*(ca.vec(block) for block in lost)))
