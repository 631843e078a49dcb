"""The simultaneous way: every experiment's base moments are unknowns beside the parameters, its equilibrium a constraint.

IPOPT minimizes the loss of the misfits and the priors, with the Hessian of Gauss and Newton.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from scipy.sparse import csc_matrix

from ..equilibrium import Equilibrium
from ..robot.checks import Array
from ..solvers.programs import Evaluated, solve_program
from .estimation import Estimation, Linearized, Progress
from .reduced import Found

_DAMPING = 1e-3
"""Of the Hessian in the scaled parameters, and of nothing else: where the data say nothing, IPOPT stays where it is."""


class _Program:
    """The program in scaled unknowns: parameters first, then the experiments' base moments one behind the other."""

    def __init__(self, estimation: Estimation, x: Array, moments: Sequence[Array]) -> None:
        self.estimation = estimation
        self.units = estimation.units
        self._x = x
        self.parameters = len(x)
        ends = np.cumsum([self.parameters, *(len(each) for each in moments)])
        self.parts = [slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:], strict=True)]
        self.size = int(ends[-1])
        self._own = [each.own for each in estimation.linearize(x, moments)]

    def split(self, v: Array) -> tuple[Array, list[Array]]:
        """Parameters and base moments, SI."""
        x = v[: self.parameters] * self.estimation.unknowns.scale
        return x, [v[part] * unit for part, unit in zip(self.parts, self.units, strict=True)]

    def join(self, x: Array, moments: Sequence[Array]) -> Array:
        """The scaled unknowns."""
        scaled = [each / unit for each, unit in zip(moments, self.units, strict=True)]
        return np.concatenate((x / self.estimation.unknowns.scale, *scaled))

    # -- structure -------------------------------------------------------------------------------------------------

    @cached_property
    def _jacobian(self) -> tuple[csc_matrix, Array]:
        rows, columns = [], []
        for own, part in zip(self._own, self.parts, strict=True):
            row = np.arange(part.start, part.stop) - self.parameters
            column = np.concatenate((own, np.arange(part.start, part.stop)))
            rows.append(np.repeat(row, len(column)))
            columns.append(np.tile(column, len(row)))
        return _compressed(rows, columns, (self.size - self.parameters, self.size))

    @cached_property
    def _hessian(self) -> tuple[csc_matrix, Array]:
        rows, columns = [np.arange(self.parameters)], [np.arange(self.parameters)]
        for own, part in zip(self._own, self.parts, strict=True):
            both = np.concatenate((own, np.arange(part.start, part.stop)))
            upper = np.triu_indices(len(both))
            rows.append(both[upper[0]])
            columns.append(both[upper[1]])
        return _compressed(rows, columns, (self.size, self.size))

    @property
    def jacobian_structure(self) -> csc_matrix:
        """Each experiment's equations by the parameters acting on it and by its base moments."""
        return self._jacobian[0]

    @property
    def hessian_structure(self) -> csc_matrix:
        """The same for the Hessian: an arrow."""
        return self._hessian[0]

    # -- values ----------------------------------------------------------------------------------------------------

    def evaluate(self, v: Array) -> Evaluated | None:
        """Objective, constraints and their derivatives."""
        estimation, scale = self.estimation, self.estimation.unknowns.scale
        x, moments = self.split(v)
        linearized = estimation.linearize(x, moments)
        mean, sigma = estimation.unknowns.prior
        objective = estimation.prior_cost(x)
        gradient = np.zeros(self.size)
        gradient[: self.parameters] = scale * (x - mean) / sigma**2
        constraints, slopes, curvatures = [], [], [(scale / sigma) ** 2 + _DAMPING]
        for k, each in enumerate(linearized):
            unit, part = self.units[k], self.parts[k]
            own = scale[each.own]
            constraints.append(each.residual / unit)
            slopes.append(np.hstack((each.residual_x * own, each.residual_z * unit)) / unit[:, None])
            rows = np.hstack((each.misfit_x * own, each.misfit_z * unit))
            cost, pull, curvature = self._block_parts(k, each, rows)
            objective += cost
            np.add.at(gradient, each.own, pull[: len(own)])
            gradient[part] += pull[len(own) :]
            curvatures.append(curvature[np.triu_indices(len(curvature))])
        found = np.concatenate(constraints)
        if not (np.isfinite(objective) and np.isfinite(found).all()):
            return None
        return Evaluated(
            objective,
            gradient,
            found,
            _summed(self._jacobian, np.concatenate([each.ravel() for each in slopes])),
            _summed(self._hessian, np.concatenate(curvatures)),
        )

    def _block_parts(self, k: int, each: Linearized, rows: Array) -> tuple[float, Array, Array]:
        """Loss, gradient and Gauss-Newton Hessian of an experiment, whose misfit has these slopes."""
        rho, first, second = self.estimation.block_losses(k, each.misfit)
        blocks = self.estimation.layouts[k].blocks
        sizes = [size for _, size, _ in blocks]
        weights = np.repeat(2.0 * first, sizes)
        pull = rows.T @ (weights * each.misfit)
        curvature = rows.T @ (weights[:, None] * rows)
        for (start, size, _), slope, bend in zip(blocks, first, second, strict=True):
            if bend == 0.0:
                continue
            r = each.misfit[start : start + size]
            along = r @ rows[start : start + size]
            s = float(r @ r)
            least = -2.0 * slope / s if s > 0.0 else 0.0  # the curvature along the residual stays positive
            curvature += max(4.0 * bend, least) * np.outer(along, along)
        return float(rho.sum()), pull, curvature


def _compressed(rows: list[Array], columns: list[Array], shape: tuple[int, int]) -> tuple[csc_matrix, Array]:
    """The structure, and to which of its nonzeros each of the entries adds."""
    row, column = np.concatenate(rows).astype(np.intp), np.concatenate(columns).astype(np.intp)
    keys, where = np.unique(column * shape[0] + row, return_inverse=True)
    pointers = np.searchsorted(keys, np.arange(shape[1] + 1) * shape[0])
    return csc_matrix((np.ones(len(keys)), keys % shape[0], pointers), shape), where


def _summed(structure: tuple[csc_matrix, Array], values: Array) -> Array:
    return np.bincount(structure[1], weights=values, minlength=structure[0].nnz)


def solve_simultaneous(
    estimation: Estimation, equilibria: Sequence[Equilibrium], progress: Progress | None = None
) -> Found:
    """Least loss over parameters and base moments by IPOPT."""
    unknowns = estimation.unknowns
    moments = [each.unknowns for each in equilibria]
    program = _Program(estimation, unknowns.initial, moments)
    lower, upper = np.full(program.size, -np.inf), np.full(program.size, np.inf)
    for side, bound in ((lower, unknowns.bounds[0]), (upper, unknowns.bounds[1])):
        side[: program.parameters] = bound / unknowns.scale
    watch = None if progress is None else (lambda step: progress("steps", step, 0))
    point = solve_program(program, program.join(unknowns.initial, moments), (lower, upper), progress=watch)
    x, found = program.split(point.x)
    return Found(x, found, point.converged, point.message, point.iterations, point.iterations)
