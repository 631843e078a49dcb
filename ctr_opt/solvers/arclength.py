"""Continuation in the arc length of the solution curve: the parameter may turn back at folds and come forward again."""

from __future__ import annotations

from collections.abc import Callable

import attrs
import numpy as np

from ..checks import Array
from .homotopy import CORRECTOR, Homotopy, Trace, regular_between
from .newton import NewtonResult, System, newton

_DIFFERENCE = 1e-6  # step of the parameter for the derivative by it: good enough for directions
_STRAIGHT = 0.9  # cosine of the largest angle by which the curve may turn in a step
_LONGEST = 1.0  # longest step, in the norm of the dimensionless unknowns and the parameter


@attrs.frozen(eq=False)
class _Plane:
    """The points ``(z, parameter)`` of the curve in the plane through ``origin``, normal to ``tangent``."""

    at: Callable[[float], System]
    origin: Array
    tangent: Array

    def linearize(self, y: Array) -> tuple[Array, Array]:
        """The residual and its Jacobian, each with the plane's row at the end; the Jacobian is regular at folds."""
        z, parameter = y[:-1], float(y[-1])
        residual, jacobian = self.at(parameter).linearize(z)
        beside, _ = self.at(parameter + _DIFFERENCE).linearize(z)
        matrix = np.vstack((np.column_stack((jacobian, (beside - residual) / _DIFFERENCE)), self.tangent))
        return np.append(residual, self.tangent @ (y - self.origin)), matrix


def trace_around(at: Callable[[float], System], z: Array, tolerance: float, method: Homotopy) -> Trace:
    """Follow the curve of solutions of ``at(parameter)`` from ``z`` at 0 until the parameter is 1.

    A step is halved if the corrector does not contract fast, the curve turns much, or the Jacobian of the curve may
    have been singular on the way. At a bifurcation there is no single curve, and the path ends.
    """
    start = newton(at(0.0), z, tolerance)
    steps, iterations, step, folds = 0, start.iterations, method.first_step, 0
    if not start.converged:
        return Trace(start, 0.0, 0, iterations, False)
    y = np.append(start.z, 0.0)
    matrix = _Plane(at, y, np.eye(len(y))[-1]).linearize(y)[1]
    tangent, here = _direction(matrix), start
    while steps < method.max_steps and step >= method.smallest_step:
        steps += 1
        plane = _Plane(at, y + step * tangent, tangent)
        corrected = newton(plane, plane.origin, max(tolerance, 1e-8), CORRECTOR)
        iterations += corrected.iterations
        turned = _followed(plane, y, matrix, corrected)
        if turned is None:
            step *= 0.5
            continue
        if corrected.z[-1] >= 1.0:
            end = _landing(plane, y, corrected, tolerance)
            iterations += end.iterations
            if end.converged:
                return Trace(end, 1.0, steps, iterations, False, folds)
            step *= 0.5
            continue
        folds += int(turned[-1] * tangent[-1] < 0.0)
        y, tangent, matrix = corrected.z, turned, corrected.jacobian
        here = attrs.evolve(
            corrected, z=y[:-1], residual=corrected.residual[:-1], jacobian=corrected.jacobian[:-1, :-1]
        )
        if y[-1] < 0.0:
            break
        step = min(_LONGEST, step * (2.0 if corrected.iterations <= 3 else 1.0 if corrected.iterations <= 4 else 0.7))
    return Trace(here, max(0.0, float(y[-1])), steps, iterations, step < method.smallest_step, folds)


def _direction(matrix: Array) -> Array:
    """The unit tangent of the curve; the last row of the plane's matrix points forward."""
    size = len(matrix)
    ahead = np.linalg.lstsq(matrix, np.eye(size)[-1], rcond=None)[0]
    return np.asarray(ahead / np.linalg.norm(ahead))


def _followed(plane: _Plane, before: Array, matrix: Array, end: NewtonResult) -> Array | None:
    """The tangent at ``end``; None if the way from ``before`` may have met a singular point or turned much."""
    if not end.converged:
        return None
    first = np.vstack((matrix[:-1], plane.tangent))
    _, middle = plane.linearize(0.5 * (before + end.z))
    if not (regular_between(first, middle) and regular_between(middle, end.jacobian)):
        return None
    tangent = _direction(end.jacobian)
    return tangent if tangent @ plane.tangent > _STRAIGHT else None


def _landing(plane: _Plane, before: Array, beyond: NewtonResult, tolerance: float) -> NewtonResult:
    """The solution where the curve passes the parameter 1, between ``before`` and ``beyond``."""
    part = (1.0 - before[-1]) / (beyond.z[-1] - before[-1])
    chord = before + part * (beyond.z - before)
    end = newton(plane.at(1.0), chord[:-1], tolerance, CORRECTOR)
    moved, step = np.linalg.norm(end.z - chord[:-1]), np.linalg.norm(beyond.z - before)
    _, there = plane.linearize(np.append(end.z, 1.0))
    near = bool(moved <= 0.5 * step) and regular_between(beyond.jacobian, there)
    return attrs.evolve(end, converged=end.converged and near)
