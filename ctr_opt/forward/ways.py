"""One forward solve: which methods, in which order, and what is believed of their answers."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import lru_cache
from itertools import groupby
from time import perf_counter
from typing import TypeVar

import attrs
import numpy as np

from ..checks import Array
from ..errors import DefinitionError
from ..layout.configuration import Configuration
from ..solvers.accuracy import ALONG_FAMILY, NEARBY, Estimate, estimate_error, estimate_error_of_nodes
from ..solvers.arclength import trace_around
from ..solvers.homotopy import Trace, family_of, regular_between, trace
from ..solvers.ipopt import Ipopt, IpoptPoint, IpoptSolver
from ..solvers.minimum import Minimum, minimize, minimize_in_steps
from ..solvers.newton import Newton, Solution, System, newton
from ..solvers.refinement import Refinement
from ..solvers.status import SolveStatus
from ..transcription.energy import EnergyProblem
from ..transcription.equilibrium_program import EquilibriumProblem
from ..transcription.nlp import Nlp
from ..transcription.shape import Shape
from ..transcription.shooting import Nodes, Shooting, cut
from .continuation import Imperfect, Release, Route
from .equilibrium import BaseMoments, Equilibrium, Outcome
from .settings import Settings

_NEAR = 0.1  # of the way: where paths end sooner the loads are absurd, and ways around folds too long
_T = TypeVar("_T")
_LOG = logging.getLogger(__name__)


@attrs.frozen(eq=False)
class _Reached:
    """A solution of the boundary-value problem."""

    shooting: Shooting
    solution: Solution


class _Failed(Exception):  # noqa: N818 - never leaves this module
    """A method ended without an equilibrium."""

    def __init__(
        self, status: SolveStatus, message: str, z: Array, reached: float = 0.0, exhausted: bool = False
    ) -> None:
        super().__init__(message)
        self.status, self.message, self.z, self.reached = status, message, z, reached
        self.exhausted = exhausted  # more steps of the same kind might have helped, another way hardly

    def after(self, earlier: list[_Failed]) -> _Failed:
        """The whole story: this failure behind the earlier ones, with the status of the one that came furthest."""
        every = [*earlier, self]
        furthest = max(every, key=lambda failure: failure.reached)
        return _Failed(furthest.status, "; ".join(failure.message for failure in every), furthest.z, furthest.reached)


class Run:
    """One solve of a configuration."""

    def __init__(self, settings: Settings, configuration: Configuration) -> None:
        self.settings = settings
        self.configuration = configuration
        self.tolerance = settings.residual_tolerance
        self.path: list[str] = []
        self.iterations = 0
        self.setup_time = 0.0
        self.last: Equilibrium | None = None
        self.unstable: Equilibrium | None = None
        self.warm = False

    def solve(self, initial: Equilibrium | None) -> Equilibrium:
        """The equilibrium, or the record of the failure."""
        begin = perf_counter()
        try:
            if self.settings.formulation == "energy":
                result = self._energy(initial)
            elif isinstance(self.settings.method, Ipopt):
                result = self._transcribed(self.settings.method, initial)
            else:
                shooting = self._setup(lambda: self._shooting(self.configuration))
                result = self._cold(shooting) if initial is None else self._refined(self._from(initial, shooting))
        except _Failed as failure:
            result = self._failure(failure)
        _LOG.info("%s: %s, %d iterations", result.path, result.status.description, self.iterations)
        return result.timed(self.setup_time, perf_counter() - begin - self.setup_time)

    # -- strategies ------------------------------------------------------------------------------------------------

    def _cold(self, shooting: Shooting) -> Equilibrium:
        """From nothing but the configuration."""
        zero, method = np.zeros(shooting.unknowns), self.settings.method
        if isinstance(method, Newton):
            return self._refined(self._newton(shooting, zero, method, "newton"))
        return self._any_way(shooting)

    def _any_way(self, shooting: Shooting) -> Equilibrium:
        """The answer of the first way that has one."""
        failures: list[_Failed] = []
        for ways in (self._ways, self._ways_around):
            for way in ways(shooting, failures):
                try:
                    return self._checked(way())
                except _Failed as failure:
                    failures.append(failure)
                    if failure.status is SolveStatus.INACCURATE:  # there is an equilibrium: no other way leads nearer
                        raise failure.after(failures[:-1]) from None
        raise failures[-1].after(failures[:-1])

    def _checked(self, found: Equilibrium) -> Equilibrium:
        """The answer, unless it is known to be unstable and there is another way to go.

        A path of equilibria that starts at the stable straight robot need not stay stable: steps may jump to another
        branch or over two folds, and what goes around folds changes its stability there.
        """
        negative = found.unstable_directions
        if self.settings.formulation != "automatic" or not negative:
            return found
        self.unstable = found
        told = f"unstable: {negative} direction{'s' if negative > 1 else ''}"
        message = f"{self.path[-1]}: {SolveStatus.UNSTABLE.description} ({told})"
        self.path[-1] += f" ({told})"
        z = found.last_iterate.unknowns(self.configuration.scales, self.configuration.kind.live)
        raise _Failed(SolveStatus.UNSTABLE, message, z, reached=1.0)

    def _ways(self, shooting: Shooting, _: list[_Failed]) -> list[Callable[[], Equilibrium]]:
        """The ways to a cold answer, the fastest first."""
        together = [lambda: self._refined(self._homotopy(shooting))]
        apart = [
            lambda: self._refined(self._loads_first(shooting)),
            lambda: self._refined(self._curvature_first(shooting)),
        ]
        if self.settings.formulation != "automatic":
            return together + apart
        conservative = self.configuration.conservative_part()
        if conservative is self.configuration:
            return [*together, self._by_energy, *apart]
        return [*together, *apart, lambda: self._refined(self._rest_last(shooting, self._through_energy(conservative)))]

    def _ways_around(self, shooting: Shooting, failures: list[_Failed]) -> list[Callable[[], Equilibrium]]:
        """The last ways, where all paths ended: many steps, to an equilibrium that the robot may have to snap to."""
        hopeless = max(failure.reached for failure in failures) < _NEAR or any(each.exhausted for each in failures)
        if self.settings.formulation != "automatic" or hopeless:
            return []
        return [
            lambda: self._refined(self._around_folds(shooting)),
            lambda: self._refined(self._around_bifurcations(shooting)),
        ]

    def _homotopy(self, shooting: Shooting) -> _Reached:
        zero = np.zeros(shooting.unknowns)
        return self._trace(shooting, lambda x: shooting.scaled(x, x, x), zero, "homotopy")

    def _loads_first(self, shooting: Shooting) -> _Reached:
        zero = np.zeros(shooting.unknowns)
        loaded = self._trace(shooting, lambda x: shooting.scaled(x, x, 0.0), zero, "homotopy in loads")
        z = loaded.solution.z
        return self._trace(shooting, lambda x: shooting.scaled(1.0, 1.0, x), z, "homotopy in curvature")

    def _curvature_first(self, shooting: Shooting) -> _Reached:
        zero = np.zeros(shooting.unknowns)
        curved = self._trace(shooting, lambda x: shooting.scaled(0.0, 0.0, x), zero, "homotopy in curvature")
        z, whole = curved.solution.z, self.configuration
        try:
            return self._trace(shooting, lambda x: shooting.scaled(x, x, 1.0), z, "homotopy in loads")
        except _Failed as failure:
            loads = whole.loads_on(whole.tube_ends, failure.reached)
            self._keep_last(Configuration(whole.robot, whole.actuation, loads), failure)
            raise

    def _keep_last(self, there: Configuration, failure: _Failed) -> None:
        """Keep the equilibrium at which a path of this robot ended."""
        guess = Equilibrium(there, self._base(failure.z), Outcome(SolveStatus.GUESS, "guess"))
        found = Run(self.settings, there).solve(guess)
        self.last = found if found.converged else None

    def _around_folds(self, shooting: Shooting) -> _Reached:
        zero = np.zeros(shooting.unknowns)
        return self._trace(shooting, lambda x: shooting.scaled(x, x, x), zero, "homotopy around folds", trace_around)

    def _around_bifurcations(self, shooting: Shooting) -> _Reached:
        zero = np.zeros(shooting.unknowns)
        at = Imperfect(lambda x: shooting.scaled(x, x, x), shooting.unknowns).at
        return self._trace(shooting, at, zero, "homotopy around folds of an imperfect robot", trace_around)

    def _by_energy(self) -> Equilibrium:
        """A minimum of the energy, polished by Newton's method or, where that fails, in its own discretization."""
        energy, minimum = self._minimum(self.configuration, self.configuration.mesh(), None, "energy")
        try:
            return self._refined(self._polished(energy, minimum))
        except _Failed:
            return self._discretized(self._lowest, self._shape_of_minimum(energy, minimum))

    def _through_energy(self, conservative: Configuration) -> _Reached:
        return self._polished(*self._minimum(conservative, conservative.mesh(), None, "energy"))

    def _polished(self, energy: EnergyProblem, minimum: Minimum) -> _Reached:
        """The same minimum as a solution of the boundary-value problem."""
        _, z = energy.recover(minimum.point.x, minimum.point.multipliers)
        method = NEARBY if minimum.stable else ALONG_FAMILY
        return self._newton(self._shooting(energy.configuration), z, method, "newton")

    def _rest_last(self, shooting: Shooting, conservative: _Reached) -> _Reached:
        z = np.zeros(shooting.unknowns)
        z[: len(conservative.solution.z)] = conservative.solution.z
        return self._trace(shooting, lambda x: shooting.scaled(rest=x), z, "homotopy in loads without potential")

    def _from(self, initial: Equilibrium, shooting: Shooting) -> _Reached:
        """From another equilibrium: by Newton's method and, failing that, along the route from its configuration."""
        scales, live = self.configuration.scales, self.configuration.kind.live
        try:
            jacobian = initial.shooting_jacobian
            family = 0.0 if jacobian is None else family_of(jacobian)
            z = initial.last_iterate.unknowns(scales, live)
            reached = self._newton(shooting, z, ALONG_FAMILY if family else NEARBY, "newton from initial")
            if jacobian is None:
                return reached
            comparable = jacobian.shape == reached.solution.jacobian.shape
            if comparable and regular_between(jacobian, reached.solution.jacobian, family):
                return reached
            self.path[-1] += " (perhaps another branch)" if comparable else " (loads of another kind)"
            message = "newton from initial: the Jacobian may have been singular on the way"
            first = _Failed(SolveStatus.STALLED, message, reached.solution.z)
        except _Failed as failure:
            first = failure
        route = Route(initial.configuration, self.configuration, self.settings.integrator)
        try:
            z = initial.last_iterate.unknowns(scales, route.kind.live)
            if initial.robot != self.configuration.robot or not initial.converged:
                start = self._start_of(route, z)
                z = self._trace(shooting, Release.of(start, z).at, z, "release of the residual").solution.z
            found = self._along(route, shooting, z)
            return self._newton(shooting, found.solution.z[: shooting.unknowns], NEARBY, "newton")
        except _Failed as second:
            raise second.after([first]) from None

    def _along(self, route: Route, shooting: Shooting, z: Array) -> _Reached:
        try:
            return self._trace(shooting, route.at, z, "continuation from initial")
        except _Failed as failure:
            self._keep_last(route.configuration(failure.reached), failure)
            raise

    def _start_of(self, route: Route, z: Array) -> System:
        try:
            return route.at(0.0)
        except DefinitionError as error:
            message = f"the initial configuration is none of this robot: {error}"
            raise _Failed(SolveStatus.STALLED, message, z) from None

    def _energy(self, initial: Equilibrium | None) -> Equilibrium:
        """By minimum energy, in its own discretization."""
        method, guess = self.settings.method, initial
        if guess is None and isinstance(method, Ipopt) and method.start == "homotopy":
            guess = self._by_homotopy()
        self.warm = initial is not None
        try:
            shape = None if guess is None else self._shape_of(guess)
        except _Failed:
            self.path.append("the guess stands for no finite shape")
            shape = None
        return self._discretized(self._lowest, shape)

    def _lowest(self, mesh: Array, shape: Shape | None) -> tuple[Nodes, Array]:
        """A minimum of the transcribed energy."""
        name = "energy from initial" if self.warm and not self.path else "energy"
        energy, minimum = self._minimum(self.configuration, mesh, shape, name)
        return energy.recover(minimum.point.x, minimum.point.multipliers)

    def _transcribed(self, method: Ipopt, initial: Equilibrium | None) -> Equilibrium:
        """The equilibrium formulation in its own discretization, solved by IPOPT."""
        if initial is not None:
            return self._discretized(self._balance, self._near(initial))
        return self._discretized(self._balance, None if method.start == "straight" else self._anything())

    def _anything(self) -> Shape | None:
        """Where IPOPT may start: what homotopy finds or, failing that, a minimum under the conservative loads."""
        guess = self._by_homotopy()
        if guess is not None:
            return guess.shape
        conservative = self.configuration.conservative_part()
        try:
            energy, minimum = self._minimum(conservative, conservative.mesh(), None, "energy")
        except _Failed:
            return None
        return self._shape_of_minimum(energy, minimum)

    def _shape_of_minimum(self, energy: EnergyProblem, minimum: Minimum) -> Shape:
        nodes, _ = energy.recover(minimum.point.x, minimum.point.multipliers)
        return Shape(energy.configuration, energy.mesh, nodes, self.settings.integrator)

    def _near(self, initial: Equilibrium) -> Shape:
        """The shape that shooting finds from another equilibrium or, unless the way met a fold, that one's."""
        try:
            reached = self._from(initial, self._setup(lambda: self._shooting(self.configuration)))
        except _Failed as failure:
            if failure.status is SolveStatus.FOLD:
                raise
            return self._shape_of(initial)
        return self._swept(reached.shooting, reached.solution.z)

    def _swept(self, shooting: Shooting, z: Array) -> Shape:
        nodes, _ = shooting.sweep(z)
        return Shape(shooting.configuration, shooting.mesh, nodes, self.settings.integrator)

    def _by_homotopy(self) -> Equilibrium | None:
        """What homotopy finds, or nothing; ``path`` tells."""
        try:
            shooting = self._setup(lambda: self._shooting(self.configuration))
            return self._any_way(shooting)
        except _Failed:
            return None

    def _balance(self, mesh: Array, shape: Shape | None) -> tuple[Nodes, Array]:
        """A solution of the transcribed boundary-value problem."""
        settings = self.settings
        self.path.append("ipopt")
        problem = self._setup(
            lambda: EquilibriumProblem(self.configuration, mesh, settings.transcription, settings.integrator)
        )
        solver = self._setup(lambda: _solver(problem.program.nlp, settings.ipopt))
        point = solver.solve(problem.straight() if shape is None else problem.like(shape), problem.parameters)
        self.iterations += point.iterations
        if not point.converged:
            self.path[-1] += " (failed)"
            raise self._not_optimal("ipopt", point, problem.program.nlp)
        return problem.recover(point.x)

    def _discretized(
        self, find: Callable[[Array, Shape | None], tuple[Nodes, Array]], shape: Shape | None
    ) -> Equilibrium:
        """A solution in a discretization of its own, on finer and finer meshes until it meets the tolerance."""
        mesh, refinement = self.configuration.mesh(), Refinement(self.settings.tolerance)
        while True:
            nodes, z = find(mesh, shape)
            shooting = Shooting(self.configuration, mesh, self.settings.integrator)
            estimate, solution = estimate_error_of_nodes(shooting, z, nodes)
            if estimate.error <= self.settings.tolerance:
                return self._equilibrium(_Reached(shooting, solution), nodes, estimate)
            parts = refinement.next(estimate)
            if parts is None:
                raise self._inaccurate(z, estimate)
            shape = Shape(self.configuration, mesh, nodes, self.settings.integrator)
            mesh = cut(mesh, parts)

    def _shape_of(self, initial: Equilibrium) -> Shape:
        """The shape of an equilibrium, or the one that a guess of the moments at the base stands for."""
        if initial.converged:
            return initial.shape
        shooting = self._shooting(initial.configuration)
        z = initial.last_iterate.unknowns(initial.configuration.scales, initial.configuration.kind.live)
        shape = self._swept(shooting, z)
        if not np.all(np.isfinite(shape.nodes.left)):
            raise _Failed(SolveStatus.STALLED, "the guess stands for no finite shape", z)
        return shape

    # -- steps -----------------------------------------------------------------------------------------------------

    def _newton(self, shooting: Shooting, z: Array, method: Newton, name: str) -> _Reached:
        self.path.append(name)
        solution = newton(shooting, z, self.tolerance, method)
        self.iterations += solution.iterations
        if not solution.converged:
            self.path[-1] += " (failed)"
            message = f"{name}: {solution.reason}, residual {solution.residual_norm:.2g}"
            raise _Failed(SolveStatus.NEWTON_FAILED, message, solution.z)
        return _Reached(shooting, solution)

    def _trace(
        self,
        shooting: Shooting,
        at: Callable[[float], System],
        z: Array,
        name: str,
        follow: Callable[..., Trace] = trace,
    ) -> _Reached:
        self.path.append(name)
        method = self.settings.homotopy
        found = follow(at, z, self.tolerance, method)
        self.iterations += found.iterations
        if found.folds:
            self.path[-1] += f" ({found.folds} passed)"
        if not found.complete:
            self.path[-1] += f" (ended at {found.reached:.3g})"
            status = SolveStatus.FOLD if found.singular else SolveStatus.STALLED
            message = f"{name}: {status.description}, at {found.reached:.6g} of the way, after {found.steps} steps"
            if found.reason:
                message += f" ({found.reason})"
            raise _Failed(status, message, found.solution.z, found.reached, found.steps >= method.max_steps)
        return _Reached(shooting, found.solution)

    def _minimum(
        self, configuration: Configuration, mesh: Array, shape: Shape | None, name: str
    ) -> tuple[EnergyProblem, Minimum]:
        self.path.append(name)
        settings = self.settings
        energy = self._setup(lambda: EnergyProblem(configuration, mesh, settings.transcription, settings.integrator))
        solver = self._setup(lambda: _solver(energy.program.nlp, settings.ipopt))
        guess = energy.straight() if shape is None else energy.like(shape)
        found = minimize(solver, energy, energy.program.free, guess)
        self.iterations += found.iterations
        if found.inertia is None and shape is None:
            self.path[-1] += " (failed) -> energy, loads in steps"
            found = minimize_in_steps(solver, energy, energy.program.free, guess)
            self.iterations += found.iterations
        if found.descents:
            self.path[-1] += f" ({found.descents} saddle{'s' if found.descents > 1 else ''} left)"
        if not found.found:
            self.path[-1] += " (failed)"
            raise self._no_minimum(energy, found)
        if not found.stable:
            self.path[-1] += " (neutral)"
        return energy, found

    def _no_minimum(self, energy: EnergyProblem, found: Minimum) -> _Failed:
        if found.inertia is None:
            return self._not_optimal("energy", found.point, energy.program.nlp)
        message = (
            f"energy: the second variation has the smallest eigenvalue {found.inertia.smallest:.2g} "
            f"after {found.descents} descents"
        )
        return _Failed(SolveStatus.NO_MINIMUM, message, self._nothing())

    def _not_optimal(self, name: str, point: IpoptPoint, nlp: Nlp) -> _Failed:
        residual = np.nan_to_num(np.abs(point.residual), nan=np.inf)
        worst = int(residual.argmax())
        message = (
            f"{name}: IPOPT says {point.message!r} after {point.iterations} iterations; "
            f"largest defect {residual[worst]:.2g} in {nlp.describe_constraint(worst)}"
        )
        return _Failed(SolveStatus.OPTIMIZER_FAILED, message, self._nothing())

    def _nothing(self) -> Array:
        return np.zeros(2 + self.configuration.tube_count)

    # -- results ---------------------------------------------------------------------------------------------------

    def _refined(self, reached: _Reached) -> Equilibrium:
        """Cut steps in two until the estimated error meets the tolerance."""
        refinement = Refinement(self.settings.tolerance)
        while True:
            nodes, _ = reached.shooting.sweep(reached.solution.z)
            estimate = estimate_error(reached.shooting, reached.solution, nodes, self.tolerance)
            if estimate.error <= self.settings.tolerance:
                return self._equilibrium(reached, nodes, estimate)
            parts = refinement.next(estimate)
            if parts is None:
                break
            finer = estimate.finer if np.all(parts == 2) else reached.shooting.refined(parts)
            solution = newton(finer, estimate.z, self.tolerance, NEARBY)
            self.iterations += solution.iterations
            if not solution.converged:
                break
            reached = _Reached(finer, solution)
        raise self._inaccurate(reached.solution.z, estimate)

    def _equilibrium(self, reached: _Reached, nodes: Nodes, estimate: Estimate) -> Equilibrium:
        outcome = Outcome(
            SolveStatus.CONVERGED,
            self._told_path(),
            iterations=self.iterations,
            residual_norm=reached.solution.residual_norm,
            discretization_error=estimate.error * self.configuration.scales.length,
            jacobian=reached.solution.jacobian,
        )
        shape = Shape(self.configuration, reached.shooting.mesh, nodes, self.settings.integrator)
        return Equilibrium(self.configuration, self._base(reached.solution.z), outcome, shape)

    def _failure(self, failure: _Failed) -> Equilibrium:
        path = self._told_path()
        sought = "stable equilibrium" if failure.status is SolveStatus.UNSTABLE else "equilibrium"
        message = f"no {sought} found ({path}). {failure.message}. What to do: {failure.status.advice}"
        outcome = Outcome(failure.status, path, message, failure.reached, self.iterations)
        return Equilibrium(self.configuration, self._base(failure.z), outcome, last=self.unstable or self.last)

    def _told_path(self) -> str:
        steps = [(name, len(list(same))) for name, same in groupby(self.path)]
        return " -> ".join(name if count == 1 else f"{name} ({count} meshes)" for name, count in steps)

    def _inaccurate(self, z: Array, estimate: Estimate) -> _Failed:
        message = (
            f"the estimated error {estimate.error:.2g} of the length stayed above "
            f"the tolerance {self.settings.tolerance:g}"
        )
        return _Failed(SolveStatus.INACCURATE, message, z)

    def _base(self, z: Array) -> BaseMoments:
        return BaseMoments.of(z, self.configuration.scales, self.configuration.tube_count)

    def _shooting(self, configuration: Configuration) -> Shooting:
        return Shooting(configuration, configuration.mesh(), self.settings.integrator)

    def _setup(self, build: Callable[[], _T]) -> _T:
        begin = perf_counter()
        built = build()
        self.setup_time += perf_counter() - begin
        return built


@lru_cache(maxsize=24)
def _solver(nlp: Nlp, method: Ipopt) -> IpoptSolver:
    return IpoptSolver(nlp, method)
