"""One solve: the shooting steps of which the ways consist, and a record of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from time import perf_counter
from typing import TypeVar

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..layout.configuration import Configuration
from ..solvers.accuracy import NEARBY, Estimate, Refinement, estimate_error
from ..solvers.homotopy import Trace, trace
from ..solvers.newton import Newton, NewtonResult, System, newton
from ..solvers.status import SolveStatus
from ..transcription.shape import Shape
from ..transcription.shooting import NodeStates, Shooting
from .attempt import Attempt, Failed
from .compiled import Record
from .equilibrium import Equilibrium
from .record import BaseMoments, Outcome, SolvedRecord
from .settings import Settings

_T = TypeVar("_T")


@attrs.frozen(eq=False)
class Reached:
    """A solution of the boundary-value problem."""

    shooting: Shooting
    solution: NewtonResult


@attrs.frozen(eq=False)
class Measured(Reached):
    """A solution with an error estimate."""

    nodes: NodeStates
    estimate: Estimate


class Run:
    """One solve of a configuration, from another equilibrium, a guess, or a cold start.

    ``last`` is the equilibrium at which a path ended; ``unstable`` is the last equilibrium that was rejected.
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
        """The shooting problem of another configuration, for example without some loads."""
        return Shooting(configuration, configuration.mesh(), self.settings.integrator)

    def setup(self, build: Callable[[], _T]) -> _T:
        """Call ``build`` and count its time as set-up."""
        begin = perf_counter()
        built = build()
        self.setup_time += perf_counter() - begin
        return built

    def attempt(self, way: str) -> Attempt:
        """Begin and record a new attempt."""
        self.attempts.append(Attempt(way))
        return self.attempts[-1]

    # -- steps -----------------------------------------------------------------------------------------------------

    def newton(self, shooting: Shooting, z: Array, method: Newton, way: str) -> Reached:
        """Run Newton's method from ``z``; raises ``Failed``."""
        attempt = self.attempt(way)
        solution = newton(shooting, z, self.settings.residual_tolerance, method)
        attempt.iterations = solution.iterations
        if not solution.converged:
            attempt.outcome = "failed"
            message = f"{way}: {solution.reason}, residual {solution.residual_norm:.2g}"
            raise Failed(SolveStatus.NEWTON_FAILED, message, solution.z)
        return Reached(shooting, solution)

    def trace(self, at: Callable[[float], System], z: Array, way: str, follow: Callable[..., Trace] = trace) -> Reached:
        """Follow a path of systems from ``z`` to its end; raises ``Failed``."""
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

    def refined(self, reached: Reached) -> Measured:
        """Refine a solution: cut its steps until the estimated error meets the tolerance."""
        if isinstance(reached, Measured):
            return reached
        tolerance = self.settings.residual_tolerance

        def measured(shooting: Shooting, solution: NewtonResult) -> Measured:
            nodes, _ = shooting.sweep(solution.z)
            return Measured(shooting, solution, nodes, estimate_error(shooting, solution, nodes, tolerance))

        def finer(coarse: Measured, parts: NDArray[np.intp]) -> Measured | None:
            halved = bool(np.all(parts == 2))
            shooting = coarse.estimate.finer if halved else coarse.shooting.refined(parts)
            solution = newton(shooting, coarse.estimate.z, tolerance, NEARBY)
            self.attempts[-1].iterations += solution.iterations
            return measured(shooting, solution) if solution.converged else None

        return self.accurate(measured(reached.shooting, reached.solution), finer)

    def accurate(self, first: Measured, finer: Callable[[Measured, NDArray[np.intp]], Measured | None]) -> Measured:
        """Refine by ``finer``, which solves with cut steps or gives up, until the tolerance is met."""
        refinement, best = Refinement(self.settings.tolerance), first
        while not best.estimate.error <= self.settings.tolerance:
            parts = refinement.next(best.estimate)
            better = None if parts is None else finer(best, parts)
            if better is None:
                message = (
                    f"the estimated error {best.estimate.error:.2g} of the length stayed above "
                    f"the tolerance {self.settings.tolerance:g}"
                )
                raise Failed(SolveStatus.INACCURATE, message, best.solution.z, reached=1.0)
            best = better
        return best

    # -- results ---------------------------------------------------------------------------------------------------

    def base(self, z: Array) -> BaseMoments:
        """The unknowns as moments and force at the base."""
        return BaseMoments.of(z, self.configuration.scales, self.configuration.tube_count)

    def record(self, reached: Measured) -> SolvedRecord:
        """The record of an accurate solution."""
        solution = reached.solution
        outcome = Outcome(
            SolveStatus.CONVERGED,
            tuple(self.attempts),
            residual_norm=solution.residual_norm,
            discretization_error=reached.estimate.error * self.configuration.scales.length,
            jacobian=solution.jacobian,
        )
        shape = Shape(self.configuration, reached.shooting.mesh, reached.nodes, self.settings.integrator)
        return SolvedRecord(self.configuration, self.base(solution.z), outcome, shape)

    def failure(self, failure: Failed) -> SolvedRecord:
        """The record of a failure."""
        outcome = Outcome(failure.status, tuple(self.attempts), reached=failure.reached)
        wanted = "stable equilibrium" if failure.status is SolveStatus.UNSTABLE else "equilibrium"
        message = f"no {wanted} found ({outcome.path}). {failure.message}. What to do: {failure.status.advice}"
        outcome = attrs.evolve(outcome, message=message)
        return SolvedRecord(self.configuration, self.base(failure.z), outcome)
