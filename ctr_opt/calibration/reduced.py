"""The reduced method: SciPy's trust region solves for the parameters, with equilibria computed at each step.

Each block of the misfit is stretched so that half its square equals its loss exactly. Estimated places follow the
parameters as the equilibria do: the slopes are projected off the places' columns (L. Kaufman, BIT 15, 1975), which is
exact for the gradient.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import attrs
import numpy as np

from ..checks import Array
from ..errors import DefinitionError, SolveError
from ..estimation.blocks import Blocks
from ..estimation.places import across
from ..forward.equilibrium import Equilibrium
from .estimation import Estimation, Progress

_FAILED = 1e6  # stretched residual without an equilibrium: the step is shortened


@attrs.frozen(eq=False)
class FitPoint:
    """The end of a solve: values, states, convergence and message."""

    x: Array
    states: list[Array]
    converged: bool
    message: str
    iterations: int


def stretched(misfit: Array, slopes: Array, blocks: Blocks) -> tuple[Array, Array]:
    """Residuals whose half square is the loss, and their slopes: ``f r`` for each block, with ``f^2 = 2 rho / s``."""
    rho, first, _ = blocks.losses(misfit)
    squared = np.add.reduceat(misfit**2, blocks.starts)
    some = np.where(squared < 1e-24, 1.0, squared)
    factor = np.sqrt(np.where(squared < 1e-24, 2.0 * first, 2.0 * rho / some))
    change = np.where(squared < 1e-24, 0.0, (first / some - rho / some**2) / factor)  # of the factor by s
    along = np.add.reduceat(misfit[:, None] * slopes, blocks.starts)
    factor, bent = (np.repeat(part, blocks.sizes, axis=0) for part in (factor, 2.0 * change[:, None] * along))
    return factor * misfit, factor[:, None] * slopes + misfit[:, None] * bent


class _Reduced:
    """Residuals and Jacobian by the free scaled parameters; keeps equilibria and places as starts."""

    def __init__(
        self, estimation: Estimation, equilibria: list[Equilibrium], x: Array, free: Any, progress: Progress | None
    ) -> None:
        self.estimation = estimation
        self.equilibria = equilibria
        self.states = estimation.states(x, equilibria)
        self.progress = progress
        self.evaluations = 0
        self._x, self._free = x, free
        self._at: Array | None = None
        self._both: tuple[Array, Array] | None = None

    def all(self, scaled: Array) -> Array:
        """All parameters, SI, from the free scaled ones."""
        x = self._x.copy()
        x[self._free] = scaled * self.estimation.unknowns.scale[self._free]
        return x

    def residuals(self, scaled: Array) -> Array:
        """Stretched residuals, followed by those of the priors."""
        return self._evaluate(scaled)[0]

    def jacobian(self, scaled: Array) -> Array:
        """Derivatives of the residuals by the free scaled parameters."""
        return self._evaluate(scaled)[1]

    def _evaluate(self, scaled: Array) -> tuple[Array, Array]:
        if self._at is not None and self._both is not None and np.array_equal(self._at, scaled):
            return self._both
        estimation, unknowns, x = self.estimation, self.estimation.unknowns, self.all(scaled)
        self.evaluations += 1
        try:
            self.equilibria = estimation.equilibria(x, self.equilibria)
        except (SolveError, DefinitionError):  # no equilibrium, or no such robot
            count = sum(experiment.numbers for experiment in estimation.experiments) + len(x)
            return np.full(count, _FAILED), np.zeros((count, len(scaled)))
        parts, slopes = [], []
        self.states = estimation.settled(x, _with_moments(self.states, self.equilibria))
        for layout, here in zip(estimation.layouts, estimation.linearize(x, self.states), strict=True):
            along = layout.blocks.along(here.misfit_s, here.places)
            value, jacobian = stretched(here.settled, np.hstack((here.reduced, along)), layout.blocks)
            rows, count = np.zeros((len(value), len(x))), len(layout.acting)
            rows[:, layout.acting] = across(jacobian[:, :count], jacobian[:, count:])
            parts.append(value)
            slopes.append(rows)
        mean, sigma = unknowns.prior
        parts.append((x - mean) / sigma)
        slopes.append(np.diag(1.0 / sigma))
        jacobian = (np.vstack(slopes) * unknowns.scale)[:, self._free]
        self._at, self._both = scaled.copy(), (np.concatenate(parts), jacobian)
        if self.progress is not None:
            self.progress("steps", self.evaluations, 0)
        return self._both


def _with_moments(states: Sequence[Array], equilibria: Sequence[Equilibrium]) -> list[Array]:
    """The states with the base moments of other equilibria."""
    moments = [shape.unknowns for shape in equilibria]
    return [np.concatenate((z, state[len(z) :])) for z, state in zip(moments, states, strict=True)]


def solve_reduced(
    estimation: Estimation,
    equilibria: list[Equilibrium],
    progress: Progress | None = None,
    *,
    start: Array | None = None,
    fixed: Sequence[int] = (),
) -> FitPoint:
    """Minimize the loss over the parameters by SciPy's ``least_squares``, with the ``fixed`` ones held."""
    from scipy.optimize import least_squares

    unknowns = estimation.unknowns
    x = unknowns.initial if start is None else start
    free = np.array([k for k in range(len(x)) if k not in fixed], dtype=int)
    scale = unknowns.scale[free]
    problem = _Reduced(estimation, equilibria, x, free, progress)
    bounds = tuple(bound[free] / scale for bound in unknowns.bounds)
    options: dict[str, Any] = {"ftol": 1e-12, "xtol": 1e-12, "gtol": 1e-12, "max_nfev": 200}
    options["x_scale"] = "jac"  # other scales give many small steps near bounds
    result = least_squares(problem.residuals, x[free] / scale, problem.jacobian, bounds, **options)
    best, count = problem.all(result.x), int(result.njev or 0)
    try:
        final = estimation.equilibria(best, problem.equilibria)
    except SolveError as error:
        return FitPoint(best, problem.states, False, f"no equilibrium in {error}", count)
    states = estimation.settled(best, _with_moments(problem.states, final))
    for state, here in zip(states, estimation.linearize(best, states), strict=True):
        state[: len(here.step)] += here.step
    return FitPoint(best, states, bool(result.status > 0), str(result.message), count)
