"""The steps of a solve by IPOPT: minima of the energy, transcribed equilibria, and their refinement."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..layout.configuration import Configuration
from ..solvers.accuracy import ALONG_FAMILY, NEARBY, estimate_error_of_nodes
from ..solvers.ipopt import Ipopt, IpoptPoint, IpoptSolver
from ..solvers.minimum import Minimum, minimize, minimize_in_steps
from ..solvers.status import SolveStatus
from ..transcription.energy import EnergyProblem
from ..transcription.equilibrium_program import EquilibriumProblem
from ..transcription.nlp import Nlp
from ..transcription.shape import Shape
from ..transcription.shooting import NodeStates, Shooting, cut
from .attempt import Attempt, Failed
from .compiled import Record
from .run import Measured, Reached, Run

Find: TypeAlias = Callable[[Run, Array, Shape | None], tuple[NodeStates, Array]]
"""Finds a solution on a mesh (node states and unknowns) from the straight robot or from another shape."""


def minimum(
    run: Run, configuration: Configuration, mesh: Array, shape: Shape | None, way: str = "energy"
) -> tuple[EnergyProblem, Minimum]:
    """Minimize the energy; if that fails from the straight robot, increase the loads in steps."""
    attempt, settings = run.attempt(way), run.settings
    energy = run.setup(lambda: EnergyProblem(configuration, mesh, settings.transcription, settings.integrator))
    solver = run.setup(lambda: _solver(energy.program.nlp, settings.ipopt))
    guess = energy.guess(shape)
    stationary = minimize(solver, energy, guess)
    attempt.iterations = stationary.iterations
    if stationary.inertia is None and shape is None:
        attempt.saddles, attempt.outcome = 0, "failed"
        attempt = run.attempt("energy, loads in steps")
        stationary = minimize_in_steps(solver, energy, guess)
        attempt.iterations = stationary.iterations
    attempt.saddles = stationary.descents
    if not stationary.is_minimum:
        attempt.outcome = "failed"
        raise _no_minimum(run, attempt, energy, stationary)
    if not stationary.stable:
        attempt.outcome = "neutral"
    return energy, stationary


def polished(run: Run, energy: EnergyProblem, stationary: Minimum) -> Reached:
    """Turn a minimum of the energy into a solution of the boundary-value problem, by Newton's method."""
    _, z = energy.recover(stationary.point.x, stationary.point.multipliers)
    return run.newton(run.shooting_of(energy.configuration), z, NEARBY if stationary.stable else ALONG_FAMILY, "newton")


def lowest(run: Run, mesh: Array, shape: Shape | None) -> tuple[NodeStates, Array]:
    """Find a minimum of the transcribed energy."""
    first = run.initial is not None and not run.attempts
    energy, stationary = minimum(run, run.configuration, mesh, shape, "energy from initial" if first else "energy")
    return energy.recover(stationary.point.x, stationary.point.multipliers)


def balance(run: Run, mesh: Array, shape: Shape | None) -> tuple[NodeStates, Array]:
    """Find a solution of the transcribed boundary-value problem."""
    attempt, settings = run.attempt("ipopt"), run.settings
    problem = run.setup(
        lambda: EquilibriumProblem(run.configuration, mesh, settings.transcription, settings.integrator)
    )
    solver = run.setup(lambda: _solver(problem.program.nlp, settings.ipopt))
    point = solver.solve(problem.guess(shape), problem.parameters)
    attempt.iterations = point.iterations
    if not point.converged:
        attempt.outcome = "failed"
        raise _not_optimal(run, attempt, point, problem.program.nlp)
    return problem.recover(point.x)


def discretized(run: Run, find: Find, shape: Shape | None) -> Measured:
    """Solve in the transcription's own discretization, on finer meshes until the tolerance is met."""
    integrator = run.settings.integrator

    def measured(mesh: Array, shape: Shape | None) -> Measured:
        nodes, z = find(run, mesh, shape)
        shooting = Shooting(run.configuration, mesh, integrator)
        estimate, solution = estimate_error_of_nodes(shooting, z, nodes)
        return Measured(shooting, solution, nodes, estimate)

    def finer(coarse: Measured, parts: NDArray[np.intp]) -> Measured:
        mesh = coarse.shooting.mesh
        return measured(cut(mesh, parts), Shape(run.configuration, mesh, coarse.nodes, integrator))

    return run.accurate(measured(run.configuration.mesh(), shape), finer)


# -- shapes to start from ----------------------------------------------------------------------------------------------


def shape_of_minimum(run: Run, energy: EnergyProblem, stationary: Minimum) -> Shape:
    """The shape of a minimum of the energy."""
    nodes, _ = energy.recover(stationary.point.x, stationary.point.multipliers)
    return Shape(energy.configuration, energy.mesh, nodes, run.settings.integrator)


def shape_of(run: Run, initial: Record) -> Shape:
    """The shape of an equilibrium, or the shape that follows from a guess of the moments at the base."""
    if initial.shape is not None:
        return initial.shape
    z = initial.base.unknowns(initial.configuration.scales, initial.configuration.kind.live)
    shape = swept(run, run.shooting_of(initial.configuration), z)
    if not np.all(np.isfinite(shape.nodes.left)):
        raise Failed(SolveStatus.STALLED, "the guess does not lead to a finite shape", z)
    return shape


def swept(run: Run, shooting: Shooting, z: Array) -> Shape:
    """The shape that follows from the unknowns at the base."""
    nodes, _ = shooting.sweep(z)
    return Shape(shooting.configuration, shooting.mesh, nodes, run.settings.integrator)


# -- failures ----------------------------------------------------------------------------------------------------------


def _no_minimum(run: Run, attempt: Attempt, energy: EnergyProblem, stationary: Minimum) -> Failed:
    if stationary.inertia is None:
        return _not_optimal(run, attempt, stationary.point, energy.program.nlp)
    smallest = stationary.inertia.smallest
    message = f"the second variation has the smallest eigenvalue {smallest:.2g} after {stationary.descents} descents"
    return Failed(SolveStatus.NO_MINIMUM, f"{attempt.way}: {message}", _nothing(run))


def _not_optimal(run: Run, attempt: Attempt, point: IpoptPoint, nlp: Nlp) -> Failed:
    residual = np.nan_to_num(np.abs(point.residual), nan=np.inf)
    worst = int(residual.argmax())
    message = (
        f"{attempt.way}: IPOPT reports {point.message!r} after {point.iterations} iterations; "
        f"largest defect {residual[worst]:.2g} in {nlp.describe_constraint(worst)}"
    )
    return Failed(SolveStatus.OPTIMIZER_FAILED, message, _nothing(run))


def _nothing(run: Run) -> Array:
    return np.zeros(2 + run.configuration.tube_count)


@lru_cache(maxsize=24)
def _solver(nlp: Nlp, method: Ipopt) -> IpoptSolver:
    return IpoptSolver(nlp, method)
