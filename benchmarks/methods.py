"""Timed methods: each kind of work by the SciPy reference and by the package in each of its modes.

A mode prepares calls, one per neighbour that solves go to. The calls of all modes are timed in turns. The time of a
kind of work is the median over the neighbours. Errors of the tip are relative to solves at a tolerance of 1e-11.
"""

from collections.abc import Callable
from copy import copy
from typing import Any

import attrs
import numpy as np

import ctr_opt as ctr
from ctr_opt.transcription.shooting import Shooting

from . import reference
from .work import Work, plain

INTEGRATION = "one integration"
LINEARIZATION = "residual + Jacobian"
WARM = "warm solve"
DERIVATIVES = "warm solve, derivatives"
MANY = "solve_many, per solve"
COLD = "cold solve"
PYTHON = "Python of a warm solve"
REPEATS = 20  # integrations in a call of compiled code
_COLD_STARTS = 5


@attrs.frozen
class Prepared:
    """Calls to time, the largest error of the tip that they make, mm (NaN where there is no tip), solves in a call."""

    calls: list[Callable[[], Any]]
    error: float = np.nan
    solves: int = 1


@attrs.frozen
class Mode:
    """A solver and the kinds of work that it can do."""

    name: str
    prepare: dict[str, Callable[[Work], Prepared]]


def worst(tips, exact):
    """Largest distance, mm."""
    return 1e3 * max(float(np.linalg.norm(a - b)) for a, b in zip(tips, exact, strict=True))


def cold_starts(work):
    """Actuations that cold solves are asked for, and their tips."""
    return [work.actuation, *work.targets][:_COLD_STARTS], [work.start.tip_position, *work.tips][:_COLD_STARTS]


def solves(action, targets, exact):
    """Calls of an action, which returns a solution, for each target."""
    tips = [action(target).tip_position for target in targets]
    return Prepared([lambda t=target: action(t) for target in targets], worst(tips, exact))


# -- SciPy -------------------------------------------------------------------------------------------------------------


def scipy(name, rates, reuse):
    """The reference solver with one of its right-hand sides, Jacobians used again or not."""

    def solve(work, actuation, start=None):
        tubes, load = work.reference
        return reference.solve(tubes, plain(actuation), load, start, rates, reuse=reuse)

    def shot_by_scipy(work):
        tubes, load = work.reference
        return reference.Shooting(tubes, plain(work.actuation), load, rates), solve(work, work.actuation).unknowns

    def integration(work):
        shooting, z = shot_by_scipy(work)
        shooting.residual(z)
        return Prepared([lambda: shooting.residual(z)], worst([shooting.tip], [work.start.tip_position]))

    def linearization(work):
        shooting, z = shot_by_scipy(work)
        return Prepared([lambda: shooting.differences(z, shooting.residual(z))])

    def warm(work):
        start = solve(work, work.actuation)
        return solves(lambda target: solve(work, target, start), work.targets, work.tips)

    def cold(work):
        return solves(lambda target: solve(work, target), *cold_starts(work))

    return Mode(name, {INTEGRATION: integration, LINEARIZATION: linearization, WARM: warm, COLD: cold})


# -- the package -------------------------------------------------------------------------------------------------------


def called(function, *arguments):
    """A call of a CasADi function through its buffer, and what it fills, column by column."""
    buffer, trigger = function.buffer()
    inputs = [np.array(argument, float).ravel(order="F") for argument in arguments]
    outputs = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
    for i, values in enumerate(inputs):
        buffer.set_arg(i, memoryview(values))
    for i, values in enumerate(outputs):
        buffer.set_res(i, memoryview(values))

    def call(_keep=(buffer, inputs, outputs)):
        trigger()

    return call, outputs


def shot(start):
    """The shooting problem that an equilibrium solves, and its unknowns there."""
    shooting = Shooting(start.configuration, start.shape.mesh, start.shape.integrator)
    return shooting, start.last_iterate.unknowns(start.configuration.scales, start.configuration.kind.live)


def sweep(shooting, z):
    """One integration through the whole robot; the states behind its steps come second."""
    return called(shooting.functions.sweep(len(shooting.mesh)), z, shooting.entry, shooting.columns)


def linearized(shooting, z):
    """Residual and Jacobian."""
    return called(shooting.functions.linearized(len(shooting.mesh)), z, shooting.entry, shooting.columns)


def native(problem, start, repeats, derivative=False):
    """Integrations by compiled code, so many in a call, on the mesh rule of its solves; what it fills comes second."""
    compiled = problem.solver.compiled_for(start.loads)
    rows, inputs = compiled._inputs(start.actuation, start.loads)
    tip = np.zeros(compiled.native.sizes.states)
    case = (compiled._address, rows.address, inputs, start.record.start, repeats, derivative, tip.ctypes.data)

    def call(_keep=(rows, start, tip)):
        compiled.native.integrate(*case)

    return call, tip


def package(name, compiled):
    """The package, by compiled code or in CasADi's virtual machine."""

    def started(work):
        problem = ctr.ForwardProblem(work.robot, compiled=compiled)
        return problem, problem.solve(work.actuation, work.loads)

    def integration(work):
        problem, start = started(work)
        if compiled:
            action, tip = native(problem, start, REPEATS)
            action()
            return Prepared([action], worst([start.length * tip[:3]], [work.start.tip_position]), REPEATS)
        shooting, z = shot(start)
        action, functions = sweep(shooting, z)
        action()
        tip = start.length * functions[1].reshape(len(shooting.mesh), -1)[-1, :3]
        return Prepared([action], worst([tip], [work.start.tip_position]))

    def linearization(work):
        problem, start = started(work)
        if compiled:
            return Prepared([native(problem, start, REPEATS, derivative=True)[0]], solves=REPEATS)
        return Prepared([linearized(*shot(start))[0]])

    def python(work):
        """Warm solves whose compiled part returns at once."""
        problem, start = started(work)
        fast = problem.solver.compiled_for(work.loads)
        fast.native = copy(fast.native)
        fast.native.warm = lambda *_: 0
        return Prepared([lambda t=target: problem.solve(t, work.loads, initial=start) for target in work.targets])

    def warm(work):
        problem, start = started(work)
        return solves(lambda t: problem.solve(t, work.loads, initial=start), work.targets, work.tips)

    def derivatives(work):
        problem, start = started(work)

        def action(target):
            shape = problem.solve(target, work.loads, initial=start)
            shape.jacobian(), shape.compliance()
            assert not work.conservative or shape.unstable_directions == 0
            return shape

        return solves(action, work.targets, work.tips)

    def cold(work):
        problem, _ = started(work)

        def action(target):
            shape = problem.solve(target, work.loads)
            assert not work.conservative or shape.is_stable
            return shape

        return solves(action, *cold_starts(work))

    def many(work):
        problem, start = started(work)

        def action():
            return problem.solve_many(work.targets, work.loads, initial=start, chained=False)

        return Prepared([action], worst(action().tip_position, work.tips), len(work.targets))

    measures = {
        INTEGRATION: integration,
        LINEARIZATION: linearization,
        WARM: warm,
        DERIVATIVES: derivatives,
        MANY: many,
        COLD: cold,
    }
    return Mode(name, measures | {PYTHON: python} if compiled else measures)
