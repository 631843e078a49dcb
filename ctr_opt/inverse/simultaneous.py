"""The simultaneous way: every experiment's state is unknown too, and its equilibrium is a constraint.

IPOPT minimizes the loss of the misfits and the priors, with the Hessian of Gauss and Newton.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..equilibrium import Equilibrium
from ..errors import DefinitionError, EstimationError
from ..robot.checks import Array
from ..solvers.programs import Evaluated, solve_program
from .estimation import Estimation, Progress
from .reduced import Found

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

Structure: TypeAlias = "tuple[csc_matrix, NDArray[np.intp]]"
"""A sparse matrix of ones, and to which of its nonzeros each of some entries adds."""

_ROUGH = 1.0  # where other losses begin
_DAMPING = 1e-3
"""Of the Hessian in the scaled parameters, and of nothing else: where the data say nothing, IPOPT stays where it is."""


class _Program:
    """The program in scaled unknowns: parameters first, then the experiments' states one behind the other.

    Its constraints are the equations of the experiments, then what keeps points in order: differences that are not
    negative.
    """

    def __init__(self, estimation: Estimation, x: Array, states: Sequence[Array]) -> None:
        self.estimation = estimation
        self.units = estimation.units
        self.parameters = len(x)
        ends = np.cumsum([self.parameters, *(len(each) for each in states)])
        self.parts = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        self.size = int(ends[-1])
        #  where each group's states stand, (experiments, numbers), and its equations
        self._places = [
            np.array([np.arange(self.parts[k].start, self.parts[k].stop) for k in group.members])
            for group in estimation.models
        ]
        ends = np.cumsum([0, *(len(group.members) * len(group.unit) for group in estimation.models)])
        self._rows = [
            np.arange(a, b).reshape(len(group.members), -1)
            for group, (a, b) in zip(estimation.models, pairwise(ends), strict=True)
        ]
        self.equations = int(ends[-1])

    def split(self, v: Array) -> tuple[Array, list[Array]]:
        """Parameters and states."""
        x = v[: self.parameters] * self.estimation.unknowns.scale
        return x, [v[part] * unit for part, unit in zip(self.parts, self.units, strict=True)]

    def join(self, x: Array, states: Sequence[Array]) -> Array:
        """The scaled unknowns."""
        scaled = [each / unit for each, unit in zip(states, self.units, strict=True)]
        return np.concatenate((x / self.estimation.unknowns.scale, *scaled))

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Of the scaled unknowns: places lie between entry point and tip."""
        lower, upper = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        for group, places in zip(self.estimation.models, self._places, strict=True):
            lower[places[:, len(group.unit) :]], upper[places[:, len(group.unit) :]] = 0.0, 1.0
        for side, bound in zip((lower, upper), self.estimation.unknowns.bounds, strict=True):
            side[: self.parameters] = bound / self.estimation.unknowns.scale
        return lower, upper

    @cached_property
    def most(self) -> Array:
        """Of the constraints, whose least is zero."""
        return np.concatenate((np.zeros(self.equations), np.full(len(self._ordered), np.inf)))

    # -- structure -------------------------------------------------------------------------------------------------

    @cached_property
    def _ordered(self) -> NDArray[np.intp]:
        """Pairs of unknowns of which the second may not be less than the first, ``(pairs, 2)``."""
        found = [np.zeros((0, 2), dtype=np.intp)]
        for layout, part in zip(self.estimation.layouts, self.parts, strict=True):
            for start, end, ordered in layout.orders:
                own = np.arange(start, end if ordered else start) + part.stop - layout.places
                found.append(np.stack((own[:-1], own[1:]), axis=1))
        return np.concatenate(found)

    @cached_property
    def _jacobian(self) -> Structure:
        rows, columns = [], []
        for group, places, equations in zip(self.estimation.models, self._places, self._rows, strict=True):
            both = np.hstack((group.own, places[:, : len(group.unit)]))
            shape = (*equations.shape, both.shape[1])
            rows.append(np.broadcast_to(equations[:, :, None], shape).ravel())
            columns.append(np.broadcast_to(both[:, None, :], shape).ravel())
        rows.append(self.equations + np.repeat(np.arange(len(self._ordered)), 2))
        columns.append(self._ordered.ravel())
        return _compressed(rows, columns, (len(self.most), self.size))

    @cached_property
    def _hessian(self) -> Structure:
        rows, columns = [np.arange(self.parameters)], [np.arange(self.parameters)]
        for group, places in zip(self.estimation.models, self._places, strict=True):
            both = np.hstack((group.own, places))
            upper = _upper(both.shape[1], places.shape[1] - len(group.unit))
            rows.append(both[:, upper[0]].ravel())
            columns.append(both[:, upper[1]].ravel())
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
        x, states = self.split(v)
        mean, sigma = estimation.unknowns.prior
        objective = estimation.prior_cost(x)
        gradient = np.zeros(self.size)
        gradient[: self.parameters] = scale * (x - mean) / sigma**2
        constraints = np.zeros(len(self.most))
        constraints[self.equations :] = v[self._ordered[:, 1]] - v[self._ordered[:, 0]]
        slopes, curvatures = [], [(scale / sigma) ** 2 + _DAMPING]
        try:
            linearized = estimation.linearize_groups(x, states)
        except (DefinitionError, EstimationError):  # no such robot
            return None
        for group, places, equations, each in zip(estimation.models, self._places, self._rows, linearized, strict=True):
            own = scale[each.own][:, None, :]
            constraints[equations] = each.residual / group.unit
            both = np.concatenate((each.residual_x * own, each.residual_z * group.unit), axis=2)
            slopes.append((both / group.unit[:, None]).ravel())
            rows = np.concatenate((each.misfit_x * own, each.misfit_z * group.unit, each.misfit_s), axis=2)
            layout = estimation.layouts[group.members[0]]
            losses, pulls, curvature = estimation.expanded(layout, each.misfit, rows, positive=True)
            objective += float(losses.sum())
            np.add.at(gradient, np.hstack((each.own, places)), pulls.sum(axis=1))
            upper = _upper(rows.shape[2], each.places.shape[1])
            curvatures.append(curvature[:, upper[0], upper[1]].ravel())
        slopes.append(np.tile([-1.0, 1.0], len(self._ordered)))
        if not (np.isfinite(objective) and np.isfinite(constraints).all()):
            return None
        return Evaluated(
            objective,
            gradient,
            constraints,
            _summed(self._jacobian, np.concatenate(slopes)),
            _summed(self._hessian, np.concatenate(curvatures)),
        )


def _upper(size: int, places: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of an experiment's Hessian, whose last unknowns are places, none of which acts on another."""
    row, column = np.triu_indices(size)
    those = (row < size - places) | (row == column)
    return row[those], column[those]


def _compressed(rows: list[Any], columns: list[Any], shape: tuple[int, int]) -> Structure:
    """The structure, and to which of its nonzeros each of the entries adds."""
    from scipy.sparse import csc_matrix

    row, column = np.concatenate(rows).astype(np.intp), np.concatenate(columns).astype(np.intp)
    keys, where = np.unique(column * shape[0] + row, return_inverse=True)
    pointers = np.searchsorted(keys, np.arange(shape[1] + 1) * shape[0])
    return csc_matrix((np.ones(len(keys)), keys % shape[0], pointers), shape), where


def _summed(structure: Structure, values: Array) -> Array:
    return np.asarray(np.bincount(structure[1], weights=values, minlength=structure[0].nnz), dtype=np.float64)


def solve_simultaneous(
    estimation: Estimation, equilibria: Sequence[Equilibrium], progress: Progress | None = None
) -> Found:
    """Least loss over parameters and states by IPOPT."""
    unknowns, states = estimation.unknowns, estimation.first_states(equilibria)
    program = _Program(estimation, unknowns.initial, states)
    watch = None if progress is None else (lambda step: progress("steps", step, 0))
    start = program.join(unknowns.initial, states)
    iterations = 0
    if estimation.loss != "squared":  # far from the answer squares are kinder than losses that outliers move little
        rough = _Program(estimation.by_squares(), unknowns.initial, states)
        nearer = solve_program(rough, start, program.bounds, most=program.most, tolerance=_ROUGH, progress=watch)
        iterations = nearer.iterations
        if nearer.converged:
            start = nearer.x
    point = solve_program(program, start, program.bounds, most=program.most, progress=watch)
    x, found = program.split(np.clip(point.x, *program.bounds))  # IPOPT goes beyond by 1e-8
    if point.converged:
        found = estimation.settled(x, found)
    return Found(x, found, point.converged, point.message, iterations + point.iterations)
