"""The simultaneous method: base moments of all experiments are unknowns too, and equilibria are constraints.

IPOPT minimizes the loss of misfits and priors with the Gauss-Newton Hessian. Estimated places are optimized again at
every evaluation.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..errors import DefinitionError, EstimationError
from ..forward.equilibrium import Equilibrium
from ..solvers.programs import Evaluated, solve_program
from .estimation import Estimation, Progress
from .reduced import FitPoint

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

Structure: TypeAlias = "tuple[csc_matrix, NDArray[np.intp]]"
"""A sparse matrix of ones, and the nonzero to which each entry adds."""

_ROUGH = 1.0  # tolerance of the squared solve from which robust losses start
_DAMPING = 1e-3
"""Damping of the Hessian in the scaled parameters: IPOPT then does not move along undetermined directions."""


class _Program:
    """The nonlinear program in scaled unknowns: parameters first, then the base moments of each experiment."""

    def __init__(self, estimation: Estimation, x: Array, states: Sequence[Array]) -> None:
        self.estimation = estimation
        self.units = estimation.units
        self.states = states
        self.parameters = len(x)
        ends = np.cumsum([self.parameters, *(len(one) for one in self.units)])
        self.parts = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        self.size = int(ends[-1])
        #  where each group's base moments stand, (experiments, moments)
        self._places = [
            np.array([np.arange(self.parts[k].start, self.parts[k].stop) for k in group.members])
            for group in estimation.models
        ]

    def split(self, v: Array) -> tuple[Array, list[Array]]:
        """Parameters, and states with unchanged places."""
        x = v[: self.parameters] * self.estimation.unknowns.scale
        old = zip(self.states, self.parts, self.units, strict=True)
        return x, [np.concatenate((v[part] * unit, state[len(unit) :])) for state, part, unit in old]

    def join(self, x: Array, states: Sequence[Array]) -> Array:
        """The scaled unknowns from parameters and states."""
        scaled = [state[: len(unit)] / unit for state, unit in zip(states, self.units, strict=True)]
        return np.concatenate((x / self.estimation.unknowns.scale, *scaled))

    # -- structure -------------------------------------------------------------------------------------------------

    @cached_property
    def _jacobian(self) -> Structure:
        rows, columns = [], []
        for group, places in zip(self.estimation.models, self._places, strict=True):
            both = np.hstack((group.acting, places))
            shape = (*places.shape, both.shape[1])
            rows.append(np.broadcast_to(places[:, :, None] - self.parameters, shape).ravel())
            columns.append(np.broadcast_to(both[:, None, :], shape).ravel())
        return _compressed(rows, columns, (self.size - self.parameters, self.size))

    @cached_property
    def _hessian(self) -> Structure:
        rows, columns = [np.arange(self.parameters)], [np.arange(self.parameters)]
        for group, places in zip(self.estimation.models, self._places, strict=True):
            both = np.hstack((group.acting, places))
            upper = np.triu_indices(both.shape[1])
            rows.append(both[:, upper[0]].ravel())
            columns.append(both[:, upper[1]].ravel())
        return _compressed(rows, columns, (self.size, self.size))

    @property
    def jacobian_structure(self) -> csc_matrix:
        """Structure of the Jacobian: each experiment's equations by its acting parameters and base moments."""
        return self._jacobian[0]

    @property
    def hessian_structure(self) -> csc_matrix:
        """Structure of the Hessian, an arrow."""
        return self._hessian[0]

    # -- values ----------------------------------------------------------------------------------------------------

    def evaluate(self, v: Array) -> Evaluated | None:
        """Objective, constraints and their derivatives; None if they cannot be evaluated."""
        estimation, scale = self.estimation, self.estimation.unknowns.scale
        x, states = self.split(v)
        mean, sigma = estimation.unknowns.prior
        objective = estimation.prior_cost(x)
        gradient = np.zeros(self.size)
        gradient[: self.parameters] = scale * (x - mean) / sigma**2
        constraints = np.zeros(self.size - self.parameters)
        slopes, curvatures = [], [(scale / sigma) ** 2 + _DAMPING]
        try:
            self.states = estimation.settled(x, states, solved=False)
            linearized = estimation.linearize_groups(x, self.states)
        except (DefinitionError, EstimationError):  # no such robot
            return None
        for group, places, here in zip(estimation.models, self._places, linearized, strict=True):
            by_x, blocks = scale[group.acting][:, None, :], estimation.layouts[group.members[0]].blocks
            constraints[places - self.parameters] = here.residual / group.unit
            both = np.concatenate((here.residual_x * by_x, here.residual_z * group.unit), axis=2)
            slopes.append((both / group.unit[:, None]).ravel())
            rows = np.concatenate((here.misfit_x * by_x, here.misfit_z * group.unit), axis=2)
            along = blocks.along(here.misfit_s, here.places)
            losses, pulls, curvature = blocks.expanded(here.misfit, rows, along, positive=True)
            objective += float(losses.sum())
            np.add.at(gradient, np.hstack((group.acting, places)), pulls.sum(axis=1))
            upper = np.triu_indices(both.shape[2])
            curvatures.append(curvature[:, upper[0], upper[1]].ravel())
        if not (np.isfinite(objective) and np.isfinite(constraints).all()):
            return None
        return Evaluated(
            objective,
            gradient,
            constraints,
            _summed(self._jacobian, np.concatenate(slopes)),
            _summed(self._hessian, np.concatenate(curvatures)),
        )


def _compressed(rows: list[Any], columns: list[Any], shape: tuple[int, int]) -> Structure:
    """The structure of entries at ``rows`` and ``columns``; entries at the same place are added."""
    from scipy.sparse import csc_matrix

    row, column = np.concatenate(rows).astype(np.intp), np.concatenate(columns).astype(np.intp)
    keys, where = np.unique(column * shape[0] + row, return_inverse=True)
    pointers = np.searchsorted(keys, np.arange(shape[1] + 1) * shape[0])
    return csc_matrix((np.ones(len(keys)), keys % shape[0], pointers), shape), where


def _summed(structure: Structure, values: Array) -> Array:
    return np.asarray(np.bincount(structure[1], weights=values, minlength=structure[0].nnz), dtype=np.float64)


def solve_simultaneous(
    estimation: Estimation, equilibria: Sequence[Equilibrium], progress: Progress | None = None
) -> FitPoint:
    """Minimize the loss over parameters and base moments by IPOPT."""
    unknowns, states = estimation.unknowns, estimation.first_states(equilibria)
    program = _Program(estimation, unknowns.initial, states)
    lower, upper = np.full(program.size, -np.inf), np.full(program.size, np.inf)
    for side, bound in ((lower, unknowns.bounds[0]), (upper, unknowns.bounds[1])):
        side[: program.parameters] = bound / unknowns.scale
    watch = None if progress is None else (lambda step: progress("steps", step, 0))
    start = program.join(unknowns.initial, states)
    iterations = 0
    if estimation.loss != "squared":  # far from the answer the squared loss converges better than robust ones
        rough = _Program(estimation.by_squares(), unknowns.initial, states)
        nearer = solve_program(rough, start, (lower, upper), tolerance=_ROUGH, progress=watch)
        iterations = nearer.iterations
        if nearer.converged:
            start, program.states = nearer.x, rough.states
    point = solve_program(program, start, (lower, upper), progress=watch)
    x, reached = program.split(point.x)
    x = np.clip(x, *unknowns.bounds)  # IPOPT goes beyond by 1e-8
    if point.converged:
        reached = estimation.settled(x, reached)
    return FitPoint(x, reached, point.converged, point.message, iterations + point.iterations)
