"""The reduced way: equilibria are solved for at each step, only the parameters are unknowns of SciPy's trust region.

Each block of the misfit is stretched so that half its square is its loss, exactly. Places of points that are estimated
follow the parameters as the equilibria do: of the slopes there is left what they cannot explain (L. Kaufman, BIT 15,
1975), which is exact for the gradient.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import attrs
import numpy as np

from ..checks import Array
from ..errors import DefinitionError, SolveError
from ..estimation.places import across
from ..forward.equilibrium import Equilibrium
from .estimation import Estimation, Progress

_FAILED = 1e6  # stretched residual where some equilibrium is not found: the step is made shorter


@attrs.frozen(eq=False)
class Found:
    """Where a solve ended: values, states, how it ended."""

    x: Array
    states: list[Array]
    converged: bool
    message: str
    iterations: int


def stretched(misfit: Array, slopes: Array, starts: Any, losses: tuple[Array, Array, Array]) -> tuple[Array, Array]:
    """Residuals whose half square is the loss, and their slopes."""
    value, jacobian = misfit.copy(), slopes.copy()
    rho, first, _ = losses
    for (start, size, _), cost, slope in zip(starts, rho, first, strict=True):
        part = slice(start, start + size)
        r = misfit[part]
        s = float(r @ r)
        if s < 1e-24:
            factor, change = np.sqrt(2.0 * slope), 0.0
        else:
            factor = np.sqrt(2.0 * cost / s)
            change = (slope / s - cost / s**2) / factor  # of the factor by s
        value[part] = factor * r
        jacobian[part] = factor * slopes[part] + 2.0 * change * np.outer(r, r @ slopes[part])
    return value, jacobian


class _Reduced:
    """Residuals and Jacobian of the scaled parameters that are free; keeps equilibria and places to start from."""

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
        """All parameters, SI."""
        x = self._x.copy()
        x[self._free] = scaled * self.estimation.unknowns.scale[self._free]
        return x

    def residuals(self, scaled: Array) -> Array:
        """The stretched residuals, priors behind."""
        return self._evaluate(scaled)[0]

    def jacobian(self, scaled: Array) -> Array:
        """Their derivatives by the scaled parameters."""
        return self._evaluate(scaled)[1]

    def _evaluate(self, scaled: Array) -> tuple[Array, Array]:
        if self._at is not None and self._both is not None and np.array_equal(self._at, scaled):
            return self._both
        estimation, unknowns, x = self.estimation, self.estimation.unknowns, self.all(scaled)
        self.evaluations += 1
        try:
            self.equilibria = estimation.equilibria(x, self.equilibria)
        except (SolveError, DefinitionError):  # no equilibrium, or no such robot
            count = sum(each.numbers for each in estimation.experiments) + len(x)
            return np.full(count, _FAILED), np.zeros((count, len(scaled)))
        parts, slopes = [], []
        self.states = estimation.settled(x, _with_moments(self.states, self.equilibria))
        for k, each in enumerate(estimation.linearize(x, self.states)):
            layout, misfit, count = estimation.layouts[k], each.settled(), len(each.own)
            both = np.hstack((each.reduced(), layout.along(each)))
            value, jacobian = stretched(misfit, both, layout.blocks, estimation.block_losses(k, misfit))
            rows = np.zeros((len(value), len(x)))
            rows[:, each.own] = across(jacobian[:, :count], jacobian[:, count:])
            parts.append(value)
            slopes.append(rows)
        mean, sigma = unknowns.prior
        parts.append((x - mean) / sigma)
        slopes.append(np.diag(1.0 / sigma))
        every = (np.vstack(slopes) * unknowns.scale)[:, self._free]
        self._at, self._both = scaled.copy(), (np.concatenate(parts), every)
        if self.progress is not None:
            self.progress("steps", self.evaluations, 0)
        return self._both


def _with_moments(states: Sequence[Array], equilibria: Sequence[Equilibrium]) -> list[Array]:
    """The states with the base moments of other equilibria."""
    moments = [found.unknowns for found in equilibria]
    return [np.concatenate((z, state[len(z) :])) for z, state in zip(moments, states, strict=True)]


def solve_reduced(
    estimation: Estimation,
    equilibria: list[Equilibrium],
    progress: Progress | None = None,
    *,
    start: Array | None = None,
    fixed: Sequence[int] = (),
) -> Found:
    """Least loss over the parameters by SciPy's ``least_squares``, from a start, with some of them held."""
    from scipy.optimize import least_squares

    unknowns = estimation.unknowns
    x = unknowns.initial if start is None else start
    free = np.array([k for k in range(len(x)) if k not in fixed], dtype=int)
    scale = unknowns.scale[free]
    problem = _Reduced(estimation, equilibria, x, free, progress)
    bounds = tuple(each[free] / scale for each in unknowns.bounds)
    options: dict[str, Any] = {"ftol": 1e-12, "xtol": 1e-12, "gtol": 1e-12, "max_nfev": 200}
    options["x_scale"] = "jac"  # bounds close by would make for many small steps
    result = least_squares(problem.residuals, x[free] / scale, problem.jacobian, bounds, **options)
    found, count = problem.all(result.x), int(result.njev or 0)
    try:
        final = estimation.equilibria(found, problem.equilibria)
    except SolveError as error:
        return Found(found, problem.states, False, f"no equilibrium in {error}", count)
    states = estimation.settled(found, _with_moments(problem.states, final))
    for state, each in zip(states, estimation.linearize(found, states), strict=True):
        state[: len(each.residual)] += each.step()
    return Found(found, states, bool(result.status > 0), str(result.message), count)
