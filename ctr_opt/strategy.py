"""One forward solve: which methods, in which order, and what is believed of their answers."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import cache
from time import perf_counter
from typing import TypeAlias, TypeVar

import attrs
import numpy as np

from .continuation import Imperfect, Release, Route
from .equilibrium import BaseMoments, Equilibrium, Outcome
from .errors import DefinitionError
from .mechanics.sections import Configuration
from .robot.checks import Array
from .solvers.accuracy import ALONG_FAMILY, NEARBY, Estimate, estimate_error
from .solvers.arclength import trace_around
from .solvers.homotopy import Homotopy, Trace, family_of, regular_between, trace
from .solvers.ipopt import Ipopt, IpoptSolver
from .solvers.minimum import Minimum, minimize
from .solvers.newton import Newton, Solution, System, newton
from .solvers.status import SolveStatus
from .transcription.collocation import Collocation, EnergyProblem, energy_transcription
from .transcription.shape import Shape
from .transcription.shooting import Nodes, Shooting

Method: TypeAlias = Newton | Homotopy | Ipopt
METHODS: dict[str, tuple[type[Newton] | type[Homotopy] | type[Ipopt], ...]] = {
    "automatic": (Homotopy,),
    "equilibrium": (Homotopy, Newton),
    "energy": (Ipopt,),
}
METHOD_NAMES: dict[str, type[Newton] | type[Homotopy] | type[Ipopt]] = {
    "homotopy": Homotopy,
    "newton": Newton,
    "ipopt": Ipopt,
}
_REFINEMENTS = 7  # times the steps may be halved to reach the tolerance
_PROGRESS = 0.9  # of the error: a refinement that gains less meets a limit that is not the discretization's
_SAME = 1e-2  # relative distance within which Newton's method has only polished the minimum it started from
_NEAR = 0.1  # of the way: where paths end sooner the loads are absurd, and ways around folds too long
_T = TypeVar("_T")
_LOG = logging.getLogger(__name__)


@attrs.frozen
class Settings:
    """What a :class:`~ctr_opt.ForwardProblem` was told."""

    formulation: str
    method: Method
    tolerance: float
    integrator: str
    transcription: Collocation

    @property
    def residual_tolerance(self) -> float:
        """Of the scaled boundary residual: far below what the position tolerance needs."""
        return min(1e-9, max(1e-12, 1e-4 * self.tolerance))


@attrs.frozen(eq=False)
class _Reached:
    """A solution of the boundary-value problem, and whether it is known to be a minimum."""

    shooting: Shooting
    solution: Solution
    stable: bool = False


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

    def solve(self, initial: Equilibrium | None) -> Equilibrium:
        """The equilibrium, or the record of the failure."""
        begin = perf_counter()
        try:
            if self.settings.formulation == "energy":
                result = self._energy(initial)
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
        failures: list[_Failed] = []
        for way in self._ways(shooting):
            try:
                return way()
            except _Failed as failure:
                failures.append(failure)
        for follow in self._ways_around(failures):
            try:
                return self._refined(follow(shooting))
            except _Failed as failure:
                failures.append(failure)
        raise failures[-1].after(failures[:-1])

    def _ways(self, shooting: Shooting) -> list[Callable[[], Equilibrium]]:
        """The ways to a cold answer, the fastest first."""
        together = [lambda: self._refined(self._homotopy(shooting))]
        apart = [
            lambda: self._refined(self._loads_first(shooting)),
            lambda: self._refined(self._curvature_first(shooting)),
        ]
        if self.settings.formulation != "automatic":
            return together + apart
        forces = _forces_only(self.configuration)
        if forces is self.configuration:
            return [*together, self._by_energy, *apart]
        return [*together, *apart, lambda: self._refined(self._moments_last(shooting, self._through_energy(forces)))]

    def _ways_around(self, failures: list[_Failed]) -> list[Callable[[Shooting], _Reached]]:
        """The last ways, where all paths ended: many steps, to an equilibrium that the robot may have to snap to."""
        ended = max(failures, key=lambda failure: failure.reached)
        hopeless = ended.reached < _NEAR or any(
            failure.exhausted or failure.status is SolveStatus.INACCURATE for failure in failures
        )
        if self.settings.formulation != "automatic" or hopeless:
            return []
        return [self._around_folds, self._around_bifurcations]

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
        z = curved.solution.z
        return self._trace(shooting, lambda x: shooting.scaled(x, x, 1.0), z, "homotopy in loads")

    def _around_folds(self, shooting: Shooting) -> _Reached:
        zero = np.zeros(shooting.unknowns)
        return self._trace(shooting, lambda x: shooting.scaled(x, x, x), zero, "homotopy around folds", trace_around)

    def _around_bifurcations(self, shooting: Shooting) -> _Reached:
        zero = np.zeros(shooting.unknowns)
        at = Imperfect(lambda x: shooting.scaled(x, x, x), zero).at
        return self._trace(shooting, at, zero, "homotopy around folds of an imperfect robot", trace_around)

    def _by_energy(self) -> Equilibrium:
        """A minimum of the energy, polished by Newton's method or, where that fails, in its own discretization."""
        found = self._minimum(self.configuration, None, "energy")
        try:
            return self._refined(self._polished(*found))
        except _Failed:
            return self._energy(None)

    def _through_energy(self, forces: Configuration) -> _Reached:
        return self._polished(*self._minimum(forces, None, "energy"))

    def _polished(self, energy: EnergyProblem, minimum: Minimum) -> _Reached:
        """The same minimum as a solution of the boundary-value problem."""
        _, z = energy.recover(minimum.point.x, minimum.point.multipliers)
        method = NEARBY if minimum.stable else ALONG_FAMILY
        reached = self._newton(self._shooting(energy.configuration), z, method, "newton")
        moved = np.linalg.norm(reached.solution.z - z)
        return attrs.evolve(reached, stable=bool(minimum.stable and moved <= _SAME * (1.0 + np.linalg.norm(z))))

    def _moments_last(self, shooting: Shooting, forced: _Reached) -> _Reached:
        z = forced.solution.z
        return self._trace(shooting, lambda x: shooting.scaled(moment=x), z, "homotopy in moments")

    def _from(self, initial: Equilibrium, shooting: Shooting) -> _Reached:
        """From another equilibrium: by Newton's method and, failing that, along the route from its configuration."""
        moments, unit = initial.last_iterate.vector, self.configuration.scales.moment
        try:
            jacobian = initial.jacobian
            family = 0.0 if jacobian is None else family_of(jacobian)
            reached = self._newton(shooting, moments / unit, ALONG_FAMILY if family else NEARBY, "newton from initial")
            if jacobian is None or regular_between(jacobian, reached.solution.jacobian, family):
                return reached
            self.path[-1] += " (perhaps another branch)"
            message = "newton from initial: the Jacobian may have been singular on the way"
            first = _Failed(SolveStatus.STALLED, message, reached.solution.z)
        except _Failed as failure:
            first = failure
        route = Route(initial.configuration, self.configuration, self.settings.integrator)
        try:
            z = moments / unit
            if initial.robot != self.configuration.robot or not initial.converged:
                start = self._start_of(route, z)
                z = self._trace(shooting, Release.of(start, z).at, z, "release of the residual").solution.z
            found = self._along(route, shooting, z)
            return self._newton(shooting, found.solution.z, NEARBY, "newton")
        except _Failed as second:
            raise second.after([first]) from None

    def _along(self, route: Route, shooting: Shooting, z: Array) -> _Reached:
        try:
            return self._trace(shooting, route.at, z, "continuation from initial")
        except _Failed as failure:
            there, guess = route.configuration(failure.reached), Outcome(SolveStatus.GUESS, "guess")
            found = Run(self.settings, there).solve(Equilibrium(there, self._base(failure.z), guess))
            self.last = found if found.converged else None
            raise

    def _start_of(self, route: Route, z: Array) -> System:
        try:
            return route.at(0.0)
        except DefinitionError as error:
            message = f"the initial configuration is none of this robot: {error}"
            raise _Failed(SolveStatus.STALLED, message, z) from None

    def _energy(self, initial: Equilibrium | None) -> Equilibrium:
        """By minimum energy, in its own discretization."""
        shape = None if initial is None else self._shape_of(initial)
        last = np.inf
        for k in range(_REFINEMENTS):
            name = "energy" if initial is None or k else "energy from initial"
            energy, minimum = self._minimum(self.configuration, shape, name, 2**k)
            nodes, z = energy.recover(minimum.point.x, minimum.point.multipliers)
            shooting = Shooting(self.configuration, energy.mesh, self.settings.integrator)
            solution = Solution(z, *shooting.linearize(z), 0, True)
            estimate = estimate_error(shooting, solution, nodes, self.tolerance)
            if estimate.error <= self.settings.tolerance:
                return self._equilibrium(_Reached(shooting, solution, minimum.stable), nodes, estimate)
            if estimate.error > _PROGRESS * last:
                break
            last = estimate.error
            shape = Shape(self.configuration, energy.mesh, nodes, self.settings.integrator)
        raise self._inaccurate(z, estimate)

    def _shape_of(self, initial: Equilibrium) -> Shape:
        """The shape of an equilibrium, or the one that a guess of the moments at the base stands for."""
        if initial.converged:
            return initial.shape
        shooting = self._shooting(initial.configuration)
        z = initial.last_iterate.vector / initial.configuration.scales.moment
        nodes, _ = shooting.sweep(z)
        if not np.all(np.isfinite(nodes.left)):
            raise _Failed(SolveStatus.STALLED, "the guess stands for no finite shape", z)
        return Shape(initial.configuration, shooting.mesh, nodes, self.settings.integrator)

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
        method = self.settings.method if isinstance(self.settings.method, Homotopy) else Homotopy()
        found = follow(at, z, self.tolerance, method)
        self.iterations += found.iterations
        if found.folds:
            self.path[-1] += f" ({found.folds} passed)"
        if not found.complete:
            self.path[-1] += f" (ended at {found.reached:.3g})"
            status = SolveStatus.FOLD if found.singular else SolveStatus.STALLED
            message = f"{name}: {status.description}, at {found.reached:.6g} of the way, after {found.steps} steps"
            raise _Failed(status, message, found.solution.z, found.reached, found.steps >= method.max_steps)
        return _Reached(shooting, found.solution)

    def _minimum(
        self, configuration: Configuration, shape: Shape | None, name: str, refinement: int = 1
    ) -> tuple[EnergyProblem, Minimum]:
        self.path.append(name)
        settings = self.settings
        method = settings.method if isinstance(settings.method, Ipopt) else Ipopt()

        def build() -> tuple[EnergyProblem, IpoptSolver]:
            mesh, degree = configuration.mesh(refinement), settings.transcription.degree
            energy = EnergyProblem(configuration, mesh, settings.transcription)
            return energy, _solver(configuration.tube_count, degree, energy.transcription.steps, method)

        energy, solver = self._setup(build)
        guess = energy.straight() if shape is None else energy.like(shape)
        found = minimize(solver, energy, energy.transcription.free, guess)
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
        zero = np.zeros(2 + self.configuration.tube_count)
        if found.inertia is not None:
            message = (
                f"energy: the second variation has the smallest eigenvalue {found.inertia.smallest:.2g} "
                f"after {found.descents} descents"
            )
            return _Failed(SolveStatus.NO_MINIMUM, message, zero)
        residual = np.nan_to_num(np.abs(found.point.residual), nan=np.inf)
        worst = int(residual.argmax())
        message = (
            f"energy: IPOPT says {found.point.message!r} after {found.point.iterations} iterations; "
            f"largest defect {residual[worst]:.2g} in {energy.transcription.nlp.describe_constraint(worst)}"
        )
        return _Failed(SolveStatus.OPTIMIZER_FAILED, message, zero)

    # -- results ---------------------------------------------------------------------------------------------------

    def _refined(self, reached: _Reached) -> Equilibrium:
        """Halve the steps until the estimated error meets the tolerance."""
        last = np.inf
        for _ in range(_REFINEMENTS):
            nodes, _ = reached.shooting.sweep(reached.solution.z)
            estimate = estimate_error(reached.shooting, reached.solution, nodes, self.tolerance)
            if estimate.error <= self.settings.tolerance:
                return self._equilibrium(reached, nodes, estimate)
            solution = newton(estimate.finer, estimate.z, self.tolerance, NEARBY)
            self.iterations += solution.iterations
            if not solution.converged or estimate.error > _PROGRESS * last:
                break
            last = estimate.error
            reached = _Reached(estimate.finer, solution, reached.stable)
        raise self._inaccurate(reached.solution.z, estimate)

    def _equilibrium(self, reached: _Reached, nodes: Nodes, estimate: Estimate) -> Equilibrium:
        outcome = Outcome(
            SolveStatus.CONVERGED,
            " -> ".join(self.path),
            iterations=self.iterations,
            residual_norm=reached.solution.residual_norm,
            discretization_error=estimate.error * self.configuration.scales.length,
            stability_checked=reached.stable,
            jacobian=reached.solution.jacobian,
        )
        shape = Shape(self.configuration, reached.shooting.mesh, nodes, self.settings.integrator)
        return Equilibrium(self.configuration, self._base(reached.solution.z), outcome, shape)

    def _failure(self, failure: _Failed) -> Equilibrium:
        path = " -> ".join(self.path)
        message = f"no equilibrium found ({path}). {failure.message}. What to do: {failure.status.advice}"
        outcome = Outcome(failure.status, path, message, failure.reached, self.iterations)
        return Equilibrium(self.configuration, self._base(failure.z), outcome, last=self.last)

    def _inaccurate(self, z: Array, estimate: Estimate) -> _Failed:
        message = (
            f"the estimated error {estimate.error:.2g} of the length stayed above "
            f"the tolerance {self.settings.tolerance:g}"
        )
        return _Failed(SolveStatus.INACCURATE, message, z)

    def _base(self, z: Array) -> BaseMoments:
        moments = z * self.configuration.scales.moment
        moments.setflags(write=False)
        return BaseMoments(moments[:2], moments[2:])

    def _shooting(self, configuration: Configuration) -> Shooting:
        return Shooting(configuration, configuration.mesh(), self.settings.integrator)

    def _setup(self, build: Callable[[], _T]) -> _T:
        begin = perf_counter()
        built = build()
        self.setup_time += perf_counter() - begin
        return built


@cache
def _solver(tubes: int, degree: int, steps: int, method: Ipopt) -> IpoptSolver:
    return IpoptSolver(energy_transcription(tubes, degree, steps).nlp, method)


def refuse_moments(configuration: Configuration) -> None:
    """Moments have no potential: the energy formulation takes forces only."""
    for k, load in enumerate(configuration.loads):
        if load.has_moment:
            raise DefinitionError(
                f"loads[{k}] applies a moment, which has no potential: formulation = 'energy' takes forces only; "
                "use formulation = 'automatic' or 'equilibrium'"
            )


def _forces_only(configuration: Configuration) -> Configuration:
    """The configuration without its moments; itself if there are none."""
    if not any(load.has_moment for load in configuration.loads):
        return configuration
    loads = [load.forces_only() for load in configuration.loads]
    return Configuration(configuration.robot, configuration.actuation, loads)
