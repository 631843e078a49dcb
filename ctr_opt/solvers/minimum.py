"""Minimization that leaves saddles: IPOPT, the inertia of the reduced Hessian, and a descent direction."""

from __future__ import annotations

from typing import TYPE_CHECKING

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..transcription.energy import EnergyProblem
from .ipopt import IpoptPoint, IpoptSolver

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

_MARGIN = 1e-7  # smallest eigenvalue, relative to the elastic part, of a stable minimum
_DESCENTS = 6  # saddles left before giving up; each descent lowers the energy
_FIRST_LOAD, _SMALLEST_LOAD = 1.0 / 16.0, 1.0 / 512.0  # steps, as fractions of the whole loads
_STEPS = (0.3, 1.0, 3.0)  # tried along a descent direction, in units of the elastic metric


@attrs.frozen(eq=False)
class Inertia:
    """The smallest generalized eigenvalue of (second variation, elastic metric), and its direction.

    ``smallest`` is dimensionless, at most about 1, zero at a fold, and negative at a saddle; ``direction`` is a step
    in all variables that keeps the linearized constraints, of unit size in the metric.
    """

    smallest: float
    negative: int
    direction: Array


def reduced_inertia(
    hessian: csc_matrix, jacobian: csc_matrix, free: NDArray[np.intp], metric: Array, margin: float
) -> Inertia:
    """The inertia of ``hessian`` on the null space of ``jacobian``.

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


@attrs.frozen(eq=False)
class Minimum:
    """A stationary point, its inertia, and the number of saddles left on the way."""

    point: IpoptPoint
    inertia: Inertia | None
    descents: int
    iterations: int

    @property
    def is_minimum(self) -> bool:
        """Whether no negative direction is left; one may be neutral, along a family of equilibria."""
        return self.inertia is not None and self.inertia.negative == 0

    @property
    def stable(self) -> bool:
        """Whether the second variation is positive."""
        return self.inertia is not None and self.inertia.smallest > _MARGIN


def minimize(solver: IpoptSolver, energy: EnergyProblem, guess: Array) -> Minimum:
    """Find a minimum of the energy near ``guess``, or the stationary point where the descent ended."""
    parameters, free = energy.parameters, energy.program.free
    point = solver.solve(guess, parameters)
    iterations = point.iterations
    for descents in range(_DESCENTS + 1):
        if not point.converged:
            return Minimum(point, None, descents, iterations)
        inertia = reduced_inertia(*solver.derivatives(point, parameters), free, energy.metric(), _MARGIN)
        if inertia.negative == 0 or descents == _DESCENTS:
            break
        lower, used = _descend(solver, parameters, point, inertia)
        iterations += used
        if lower is None:
            break
        point = lower
    return Minimum(point, inertia, descents, iterations)


def minimize_in_steps(solver: IpoptSolver, energy: EnergyProblem, guess: Array) -> Minimum:
    """Minimize under growing loads, each minimum the guess for the next; returns the last failure otherwise."""
    reached, step, iterations = 0.0, _FIRST_LOAD, 0
    while True:
        target = min(1.0, reached + step)
        stationary = minimize(solver, energy.scaled(target, target), guess)
        iterations += stationary.iterations
        if stationary.is_minimum:
            guess, reached, step = stationary.point.x, target, 2.0 * step
        else:
            step *= 0.5
        if reached == 1.0 or step < _SMALLEST_LOAD:
            return attrs.evolve(stationary, iterations=iterations)


def _descend(
    solver: IpoptSolver, parameters: Array, saddle: IpoptPoint, inertia: Inertia
) -> tuple[IpoptPoint | None, int]:
    """The lowest point reached by steps both ways along the negative direction, and the iterations used."""
    iterations = 0
    for step in _STEPS:
        points = [solver.solve(saddle.x + sign * step * inertia.direction, parameters) for sign in (1.0, -1.0)]
        iterations += sum(point.iterations for point in points)
        slack = 1e-10 * (1.0 + abs(saddle.objective))
        lower = [point for point in points if point.converged and point.objective < saddle.objective - slack]
        if lower:
            best = min(point.objective for point in lower)
            return next(point for point in lower if point.objective <= best + slack), iterations
    return None, iterations
