"""One solve: the steps by shooting that the ways consist of, and what is remembered of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from time import perf_counter
from typing import TypeVar

import attrs
import numpy as np

from ..checks import Array
from ..layout.configuration import Configuration
from ..solvers.accuracy import NEARBY, Estimate, Refinement, estimate_error
from ..solvers.homotopy import Trace, trace
from ..solvers.newton import Newton, Solution, System, newton
from ..solvers.status import SolveStatus
from ..transcription.shape import Shape
from ..transcription.shooting import Nodes, Shooting
from .attempt import Attempt, Failed
from .compiled import Record
from .equilibrium import Equilibrium
from .record import BaseMoments, Outcome, SolvedRecord
from .settings import Settings

_T = TypeVar("_T")


@attrs.frozen(eq=False)
class Reached:
    """A solution of the boundary-value problem; an accurate one holds its nodes and the estimate of their error."""

    shooting: Shooting
    solution: Solution
    nodes: Nodes | None = None
    estimate: Estimate | None = None


class Run:
    """One solve of a configuration, from another equilibrium (or a guess) or from nothing.

    ``last``: the equilibrium at which a path ended; ``unstable``: the last one that was not accepted.
    """

    def __init__(self, settings: Settings, configuration: Configuration, initial: Record | None = None) -> None:
        self.settings = settings
        self.configuration = configuration
        self.initial = initial
        self.attempts: list[Attempt] = []
        self.setup_time = 0.0
        self.last: Equilibrium | None = None
        self.unstable: Equilibrium | None = None

    @cached_property
    def shooting(self) -> Shooting:
        """The shooting problem on the coarsest mesh."""
        return self.setup(lambda: self.shooting_of(self.configuration))

    def shooting_of(self, configuration: Configuration) -> Shooting:
        """The same of another configuration, like the one without some loads."""
        return Shooting(configuration, configuration.mesh(), self.settings.integrator)

    def setup(self, build: Callable[[], _T]) -> _T:
        """What ``build`` returns; its time counts as set-up."""
        begin = perf_counter()
        built = build()
        self.setup_time += perf_counter() - begin
        return built

    def attempt(self, way: str) -> Attempt:
        """A new attempt."""
        self.attempts.append(Attempt(way))
        return self.attempts[-1]

    # -- steps -----------------------------------------------------------------------------------------------------

    def newton(self, shooting: Shooting, z: Array, method: Newton, way: str) -> Reached:
        """Newton's method from ``z``."""
        attempt = self.attempt(way)
        solution = newton(shooting, z, self.settings.residual_tolerance, method)
        attempt.iterations = solution.iterations
        if not solution.converged:
            attempt.outcome = "failed"
            message = f"{way}: {solution.reason}, residual {solution.residual_norm:.2g}"
            raise Failed(SolveStatus.NEWTON_FAILED, message, solution.z)
        return Reached(shooting, solution)

    def trace(self, at: Callable[[float], System], z: Array, way: str, follow: Callable[..., Trace] = trace) -> Reached:
        """The end of a path of systems that begins at ``z``."""
        attempt, method = self.attempt(way), self.settings.homotopy
        path = follow(at, z, self.settings.residual_tolerance, method)
        attempt.iterations, attempt.reached, attempt.folds = path.iterations, path.reached, path.folds
        if not path.complete:
            status = SolveStatus.FOLD if path.singular else SolveStatus.STALLED
            message = f"{way}: {status.description}, at {path.reached:.6g} of the way, after {path.steps} steps"
            if path.reason:
                message += f" ({path.reason})"
            exhausted = follow is trace and path.steps >= method.max_steps
            raise Failed(status, message, path.solution.z, path.reached, exhausted)
        return Reached(self.shooting, path.solution)

    def refined(self, reached: Reached) -> Reached:
        """The same solution, its steps cut until the estimated error meets the tolerance."""
        refinement, tolerance = Refinement(self.settings.tolerance), self.settings.residual_tolerance
        while reached.estimate is None:
            shooting, solution = reached.shooting, reached.solution
            nodes, _ = shooting.sweep(solution.z)
            estimate = estimate_error(shooting, solution, nodes, tolerance)
            if estimate.error <= self.settings.tolerance:
                return Reached(shooting, solution, nodes, estimate)
            parts = refinement.next(estimate)
            if parts is None:
                raise self.inaccurate(solution.z, estimate)
            finer = estimate.finer if np.all(parts == 2) else shooting.refined(parts)
            finer_solution = newton(finer, estimate.z, tolerance, NEARBY)
            self.attempts[-1].iterations += finer_solution.iterations
            if not finer_solution.converged:
                raise self.inaccurate(solution.z, estimate)
            reached = Reached(finer, finer_solution)
        return reached

    def inaccurate(self, z: Array, estimate: Estimate) -> Failed:
        """The failure of a discretization."""
        message = (
            f"the estimated error {estimate.error:.2g} of the length stayed above "
            f"the tolerance {self.settings.tolerance:g}"
        )
        return Failed(SolveStatus.INACCURATE, message, z, reached=1.0)

    # -- results ---------------------------------------------------------------------------------------------------

    def base(self, z: Array) -> BaseMoments:
        """Unknowns as moments and force at the base."""
        return BaseMoments.of(z, self.configuration.scales, self.configuration.tube_count)

    def record(self, reached: Reached) -> SolvedRecord:
        """An accurate solution as the result."""
        solution, nodes, estimate = reached.solution, reached.nodes, reached.estimate
        assert nodes is not None
        assert estimate is not None
        outcome = Outcome(
            SolveStatus.CONVERGED,
            tuple(self.attempts),
            residual_norm=solution.residual_norm,
            discretization_error=estimate.error * self.configuration.scales.length,
            jacobian=solution.jacobian,
        )
        shape = Shape(self.configuration, reached.shooting.mesh, nodes, self.settings.integrator)
        return SolvedRecord(self.configuration, self.base(solution.z), outcome, shape)

    def failure(self, failure: Failed) -> SolvedRecord:
        """A failure as the result."""
        outcome = Outcome(failure.status, tuple(self.attempts), reached=failure.reached)
        wanted = "stable equilibrium" if failure.status is SolveStatus.UNSTABLE else "equilibrium"
        message = f"no {wanted} found ({outcome.path}). {failure.message}. What to do: {failure.status.advice}"
        outcome = attrs.evolve(outcome, message=message)
        return SolvedRecord(self.configuration, self.base(failure.z), outcome)
