"""Continuation in the arc length of the solution curve: the parameter may turn back at folds and come forward again."""

from __future__ import annotations

from collections.abc import Callable

import attrs
import numpy as np

from ..checks import Array
from .homotopy import CORRECTOR, Homotopy, Trace, regular_between
from .newton import Solution, System, newton

_DIFFERENCE = 1e-6  # of the parameter, for the derivative by it: good enough for directions
_STRAIGHT = 0.9  # cosine of the angle by which the curve may turn in a step
_LONGEST = 1.0  # step, in the norm of the dimensionless unknowns and the parameter


@attrs.frozen(eq=False)
class _Plane:
    """The points ``(z, parameter)`` of the curve in the plane through ``origin``, normal to ``tangent``."""

    at: Callable[[float], System]
    origin: Array
    tangent: Array

    def linearize(self, y: Array) -> tuple[Array, Array]:
        """The residual and its Jacobian, each with the plane's row at the end; regular at folds."""
        z, parameter = y[:-1], float(y[-1])
        residual, jacobian = self.at(parameter).linearize(z)
        beside, _ = self.at(parameter + _DIFFERENCE).linearize(z)
        matrix = np.vstack((np.column_stack((jacobian, (beside - residual) / _DIFFERENCE)), self.tangent))
        return np.append(residual, self.tangent @ (y - self.origin)), matrix


def trace_around(at: Callable[[float], System], z: Array, tolerance: float, method: Homotopy) -> Trace:
    """Follow the curve of solutions of ``at(parameter)`` from ``z`` at 0 until the parameter is 1.

    A step is halved when the corrector does not contract fast, the curve turns much, or the Jacobian of the curve may
    have been singular on the way: at a bifurcation the curve is no curve, and the path ends.
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
        found = newton(plane, plane.origin, max(tolerance, 1e-8), CORRECTOR)
        iterations += found.iterations
        turned = _followed(plane, y, matrix, found)
        if turned is None:
            step *= 0.5
            continue
        if found.z[-1] >= 1.0:
            end = _landing(plane, y, found, tolerance)
            iterations += end.iterations
            if end.converged:
                return Trace(end, 1.0, steps, iterations, False, folds)
            step *= 0.5
            continue
        folds += int(turned[-1] * tangent[-1] < 0.0)
        y, tangent, matrix = found.z, turned, found.jacobian
        here = attrs.evolve(found, z=y[:-1], residual=found.residual[:-1], jacobian=found.jacobian[:-1, :-1])
        if y[-1] < 0.0:
            break
        step = min(_LONGEST, step * (2.0 if found.iterations <= 3 else 1.0 if found.iterations <= 4 else 0.7))
    return Trace(here, max(0.0, float(y[-1])), steps, iterations, step < method.smallest_step, folds)


def _direction(matrix: Array) -> Array:
    """The unit tangent of the curve, forward by the last row of the plane's matrix."""
    size = len(matrix)
    ahead = np.linalg.lstsq(matrix, np.eye(size)[-1], rcond=None)[0]
    return np.asarray(ahead / np.linalg.norm(ahead))


def _followed(plane: _Plane, before: Array, matrix: Array, found: Solution) -> Array | None:
    """The tangent at ``found``; None if the way there from ``before`` may have met a singular point or turned much."""
    if not found.converged:
        return None
    first = np.vstack((matrix[:-1], plane.tangent))
    _, middle = plane.linearize(0.5 * (before + found.z))
    if not (regular_between(first, middle) and regular_between(middle, found.jacobian)):
        return None
    tangent = _direction(found.jacobian)
    return tangent if tangent @ plane.tangent > _STRAIGHT else None


def _landing(plane: _Plane, before: Array, found: Solution, tolerance: float) -> Solution:
    """The solution where the curve passes the parameter 1, between ``before`` and ``found``."""
    part = (1.0 - before[-1]) / (found.z[-1] - before[-1])
    chord = before + part * (found.z - before)
    end = newton(plane.at(1.0), chord[:-1], tolerance, CORRECTOR)
    moved, step = np.linalg.norm(end.z - chord[:-1]), np.linalg.norm(found.z - before)
    _, there = plane.linearize(np.append(end.z, 1.0))
    near = bool(moved <= 0.5 * step) and regular_between(found.jacobian, there)
    return attrs.evolve(end, converged=end.converged and near)
