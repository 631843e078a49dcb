"""Continuation in one parameter from 0 to 1 along one branch."""

from __future__ import annotations

from collections.abc import Callable

import attrs
import numpy as np

from ..checks import Array, bounded, counted
from .newton import Newton, NewtonResult, System, newton


@attrs.frozen
class Homotopy:
    """Natural continuation with a secant predictor and step control.

    A step is rejected and halved if Newton's method does not contract fast from the predicted point. It is also
    rejected if the Jacobian changes so much that it may have been singular on the way. The path has then met a fold or
    a bifurcation, or jumped to another branch.

    Parameters
    ----------
    first_step, smallest_step
        First and smallest step of the parameter, which runs from 0 to 1.
    max_steps
        Largest number of steps tried, including failed ones.

    Raises
    ------
    DefinitionError
        A value outside its range.

    Examples
    --------
    >>> Homotopy(first_step=0.1).max_steps
    400
    """

    first_step: float = attrs.field(default=0.25, validator=bounded(above=0.0, most=1.0))
    smallest_step: float = attrs.field(default=1e-5, validator=bounded(above=0.0, most=1.0))
    max_steps: int = attrs.field(default=400, validator=counted(1))


@attrs.frozen(eq=False)
class Trace:
    """The end of a continuation: the last point, the parameter there, and the effort.

    ``folds`` counts how often the parameter changed its direction; ``reason`` says why the last step was rejected.
    """

    solution: NewtonResult
    reached: float
    steps: int
    iterations: int
    singular: bool
    folds: int = 0
    reason: str = ""

    @property
    def complete(self) -> bool:
        """Whether the parameter reached 1."""
        return self.reached == 1.0


CORRECTOR = Newton(max_iterations=7, contraction=0.5, shortest_step=1.0)
"""Newton's method from a predicted point: if it does not contract fast, the step was too long."""

NEUTRAL = 1e-6
"""Singular values of the Jacobian below this belong to a family of equilibria."""

_CHANGE = 4.0  # factor by which an eigenvalue of the Jacobian may change in a step
SINGULAR = 0.05  # smallest singular value over the largest seen on the path, at which an end counts as a fold


def trace(
    at: Callable[[float], System],
    z: Array,
    tolerance: float,
    method: Homotopy = Homotopy(),
) -> Trace:
    """Follow the solution of ``at(parameter)`` from ``z`` at 0 to 1."""
    start = newton(at(0.0), z, tolerance)
    iterations = start.iterations
    if not start.converged:
        return Trace(start, 0.0, 0, iterations, False, reason=start.reason)
    here, reached, step, steps = start, 0.0, method.first_step, 0
    before: tuple[float, Array] | None = None
    reason = ""
    widest, family = _smallest(here), family_of(here.jacobian)
    while reached < 1.0 and steps < method.max_steps and step >= method.smallest_step:
        target = min(1.0, reached + step)
        guess = here.z
        if before is not None:
            guess = here.z + (target - reached) / (reached - before[0]) * (here.z - before[1])
        corrected = newton(at(target), guess, max(tolerance, 1e-8) if target < 1.0 else tolerance, CORRECTOR)
        steps += 1
        iterations += corrected.iterations
        if not corrected.converged or not _regular_step(at, here, corrected, 0.5 * (reached + target), family):
            reason = corrected.reason or "the Jacobian may have been singular on the way"
            step = 0.5 * (target - reached)
            continue
        before = (reached, here.z)
        here, reached = corrected, target
        widest = max(widest, _smallest(corrected))
        step *= 3.0 if corrected.iterations <= 2 else 1.6 if corrected.iterations <= 3 else 0.8
    return Trace(here, reached, steps, iterations, _smallest(here) < SINGULAR * widest, reason=reason)


def regular_between(a: Array, b: Array, family: float = 0.0) -> bool:
    """Whether a Jacobian can be taken to have stayed regular on its way from ``a`` to ``b``.

    An eigenvalue of ``J_a^-1 J_b`` starts at 1 and becomes negative when an eigenvalue of ``J`` passes zero, whatever
    its multiplicity (the sign of the determinant shows only an odd number). It must stay within 60 degrees of the
    positive axis. It must also not grow or shrink much: an eigenvalue that passed zero and came back was small in
    between. Directions in which ``J_a`` has singular values up to ``family`` are left out, as they vanish along a
    family of equilibria.
    """
    if not (np.all(np.isfinite(a)) and np.all(np.isfinite(b))):
        return False
    left, sizes, right = np.linalg.svd(a)
    kept = sizes > family
    if family == 0.0 and not kept.all():
        return False
    values = np.linalg.eigvals((left.T @ b @ right.T)[np.ix_(kept, kept)] / sizes[kept, None])
    size = np.abs(values)
    return bool(np.all((values.real > 0.5 * size) & (size > 1.0 / _CHANGE) & (size < _CHANGE)))


def family_of(jacobian: Array) -> float:
    """The threshold ``family`` of :func:`regular_between` for a path from an equilibrium; 0 if it is isolated."""
    return NEUTRAL if np.linalg.svd(jacobian, compute_uv=False)[-1] < NEUTRAL else 0.0


def _regular_step(
    at: Callable[[float], System], a: NewtonResult, b: NewtonResult, middle: float, family: float
) -> bool:
    """Whether a step is regular, checked at its middle too: two zeros within it are invisible from its ends."""
    _, between = at(middle).linearize(0.5 * (a.z + b.z))
    return regular_between(a.jacobian, between, family) and regular_between(between, b.jacobian, family)


def _smallest(solution: NewtonResult) -> float:
    return float(np.linalg.svd(solution.jacobian, compute_uv=False)[-1])
