"""Error estimates of discretized shapes, by comparison with half the step length, and refinement of steps."""

from __future__ import annotations

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..transcription.closure import close, newton_correction
from ..transcription.shooting import NodeStates, Shooting
from .newton import Newton, NewtonResult, newton

_SAFETY = 2.0  # the error is at most twice the difference to half the step, for methods of order one or more
_SHARE = 0.5  # of the average contribution: steps that contribute less are not cut
_MUCH = 100.0  # times its share: a step that contributes more is cut into four
_ROUNDING = 1e-12  # of the length: no smaller error is claimed
_REFINEMENTS = 7  # times all steps may be halved to reach the tolerance
_LOCAL_REFINEMENTS = 30  # times some steps may be: kinks of loads need ever shorter steps
_PROGRESS = 0.9  # of the error: with less progress, something other than the discretization limits it
_IDLE = 4  # times in succession without progress when only some steps were cut, as kinks may lie badly
_MOST_STEPS = 3000  # of a mesh


NEARBY = Newton(max_iterations=15, shortest_step=1.0)
"""Newton's method without damping: it converges nearby or fails."""

ALONG_FAMILY = Newton(max_iterations=30, negligible=1e-3)
"""Newton's method onto a family of equilibria, keeping the place along it."""


@attrs.frozen(eq=False)
class Estimate:
    """Estimated largest position error of ``nodes`` over the length, with the finer problem and its solution."""

    error: float
    nodes: NodeStates
    finer: Shooting
    z: Array

    def parts(self, tolerance: float) -> NDArray[np.intp]:
        """The number of parts for each step; steps that contribute more than their share of ``tolerance`` are cut."""
        steps = self.nodes.left.shape[1]
        local = np.abs(two_halves(self.finer, self.nodes) - self.nodes.left).max(axis=0)
        if not (np.isfinite(self.error) and np.all(np.isfinite(local))):
            return np.full(steps, 2)
        allowed = _SHARE * min(1.0, tolerance / self.error) * local.sum() / steps
        parts = np.ones(steps, np.intp)
        parts[local > allowed] = 2
        if np.any(parts == 1):  # a few steps contribute most: at a kink, where the order is low
            parts[local > _MUCH * allowed] = 4
        return parts


class Refinement:
    """Decides how to cut the steps next, and when to give up."""

    def __init__(self, tolerance: float) -> None:
        self._tolerance = tolerance
        self._best = np.inf
        self._whole = self._local = self._idle = 0

    def next(self, estimate: Estimate) -> NDArray[np.intp] | None:
        """The number of parts for each step; None to give up."""
        parts = estimate.parts(self._tolerance)
        whole = bool(np.all(parts > 1))
        self._whole += whole
        self._local += not whole
        self._idle = 0 if estimate.error <= _PROGRESS * self._best else self._idle + 1
        self._best = min(self._best, estimate.error)
        stuck = self._idle > (0 if whole else _IDLE)
        idle = parts.sum() == len(parts) or parts.sum() > _MOST_STEPS
        if stuck or idle or self._whole >= _REFINEMENTS or self._local >= _LOCAL_REFINEMENTS:
            return None
        return parts


def estimate_error(shooting: Shooting, solution: NewtonResult, nodes: NodeStates, tolerance: float) -> Estimate:
    """Estimate the error of ``nodes``, on the mesh of ``shooting``, against a finer solution near ``solution``.

    The finer solution takes one chord step, two sweeps and no Jacobian. Newton's method follows only if that is not
    enough.
    """
    finer = shooting.refined()
    _, residual = finer.sweep(solution.z)
    z = solution.z + newton_correction(solution.jacobian, residual)
    fine_nodes, rest = finer.sweep(z)
    if not np.all(np.isfinite(rest)):
        return Estimate(np.inf, nodes, finer, solution.z)
    if np.abs(rest).max() > max(0.01 * np.abs(residual).max(), tolerance):
        exact = newton(finer, z, tolerance, NEARBY)
        if not exact.converged:
            return Estimate(np.inf, nodes, finer, z)
        z = exact.z
        fine_nodes, _ = finer.sweep(z)
    difference = np.linalg.norm(nodes.left[:3] - fine_nodes.left[:3, 1::2], axis=0).max()
    return Estimate(float(_SAFETY * difference + _ROUNDING), nodes, finer, z)


def estimate_error_of_nodes(shooting: Shooting, z: Array, nodes: NodeStates) -> tuple[Estimate, NewtonResult]:
    """Estimate the error of nodes from another discretization, without shooting from the entry to the tip.

    The difference to the finer solution is the correction that closes the gaps left by half the step length. Also
    returns the unknowns ``z`` as a solution, with the residual and Jacobian there.
    """
    finer = shooting.refined()
    closure = close(shooting, z, nodes, two_halves(finer, nodes))
    carried = closure.states[:, 1:] - closure.gaps  # the corrections at the steps' beginnings, seen at their ends
    difference = max(np.linalg.norm(moved[:3], axis=0).max() for moved in (closure.states, carried))
    error = float(_SAFETY * difference + _ROUNDING) if np.isfinite(difference) else np.inf
    residual = nodes.tip[shooting.functions.tip_rows]
    solution = NewtonResult(z, residual, closure.jacobian, 0, True)
    return Estimate(error, nodes, finer, z + closure.unknowns), solution


def two_halves(finer: Shooting, nodes: NodeStates) -> Array:
    """The states at the ends of all steps, each integrated in two halves from its node."""
    return finer.advance(finer.advance(nodes.right, 0), 1)
