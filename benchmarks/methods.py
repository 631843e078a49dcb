"""What is timed: each kind of work, by the SciPy reference and by the package in each of its modes.

A measurement is the median, over the neighbours that a solve goes to, of the fastest call, with the largest error of
the tip. Errors are taken against solves at a tolerance of 1e-11.
"""

from collections.abc import Callable

import attrs
import numpy as np

import ctr_opt as ctr
from ctr_opt.transcription.shooting import Shooting

from . import reference
from .timing import Effort, fastest, median
from .work import Work, plain

INTEGRATION = "one integration"
LINEARIZATION = "residual + Jacobian"
WARM = "warm solve"
DERIVATIVES = "warm solve, derivatives"
MANY = "solve_many, per solve"
COLD = "cold solve"
_COLD_STARTS = 5


@attrs.frozen
class Measured:
    """Seconds, and the largest error of the tip, mm; NaN where there is no tip."""

    seconds: float
    error: float = np.nan


@attrs.frozen
class Mode:
    """A solver and what it can be asked to do."""

    name: str
    measures: dict[str, Callable[[Work, Effort], Measured]]


def worst(tips, exact):
    """Largest distance, mm."""
    return 1e3 * max(float(np.linalg.norm(a - b)) for a, b in zip(tips, exact, strict=True))


def cold_starts(work):
    """Actuations that cold solves are asked for, and their tips."""
    return [work.actuation, *work.targets][:_COLD_STARTS], [work.start.tip_position, *work.tips][:_COLD_STARTS]


# -- SciPy -------------------------------------------------------------------------------------------------------------


def scipy(name, rates):
    """The reference solver with one of its right-hand sides."""

    def solve(work, actuation, start=None):
        tubes, load = work.reference
        return reference.solve(tubes, plain(actuation), load, start, rates)

    def prepared(work):
        tubes, load = work.reference
        return reference.Shooting(tubes, plain(work.actuation), load, rates), solve(work, work.actuation).unknowns

    def integration(work, effort):
        shooting, z = prepared(work)
        seconds = fastest(lambda: shooting.residual(z), effort)
        return Measured(seconds, worst([shooting.tip], [work.start.tip_position]))

    def linearization(work, effort):
        shooting, z = prepared(work)
        return Measured(fastest(lambda: shooting.differences(z, shooting.residual(z)), effort))

    def warm(work, effort):
        start = solve(work, work.actuation)
        tips = [solve(work, target, start).tip for target in work.targets]
        actions = [lambda t=target: solve(work, t, start) for target in work.targets]
        return Measured(median(actions, effort), worst(tips, work.tips))

    def cold(work, effort):
        targets, exact = cold_starts(work)
        tips = [solve(work, target).tip for target in targets]
        return Measured(median([lambda t=target: solve(work, t) for target in targets], effort), worst(tips, exact))

    return Mode(name, {INTEGRATION: integration, LINEARIZATION: linearization, WARM: warm, COLD: cold})


# -- the package -------------------------------------------------------------------------------------------------------


def called(function, *arguments):
    """A call of a CasADi function through its buffer, and what it fills, column by column."""
    buffer, trigger = function.buffer()
    given = [np.array(argument, float).ravel(order="F") for argument in arguments]
    found = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
    for i, values in enumerate(given):
        buffer.set_arg(i, memoryview(values))
    for i, values in enumerate(found):
        buffer.set_res(i, memoryview(values))

    def call(_keep=(buffer, given, found)):
        trigger()

    return call, found


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


def package(name, **options):
    """The package with options of ``ForwardProblem``."""

    def started(work):
        problem = ctr.ForwardProblem(work.robot, **options)
        return problem, problem.solve(work.actuation, work.loads)

    def integration(work, effort):
        _, start = started(work)
        shooting, z = shot(start)
        action, found = sweep(shooting, z)
        seconds = fastest(action, effort)
        tip = start.length * found[1].reshape(len(shooting.mesh), -1)[-1, :3]
        return Measured(seconds, worst([tip], [work.start.tip_position]))

    def linearization(work, effort):
        action, _ = linearized(*shot(started(work)[1]))
        return Measured(fastest(action, effort))

    def timed(effort, action, targets, exact):
        tips = [action(target).tip_position for target in targets]
        return Measured(median([lambda t=target: action(t) for target in targets], effort), worst(tips, exact))

    def warm(work, effort):
        problem, start = started(work)
        return timed(effort, lambda t: problem.solve(t, work.loads, initial=start), work.targets, work.tips)

    def derivatives(work, effort):
        problem, start = started(work)

        def action(target):
            shape = problem.solve(target, work.loads, initial=start)
            shape.jacobian(), shape.compliance()
            assert not work.conservative or shape.unstable_directions == 0
            return shape

        return timed(effort, action, work.targets, work.tips)

    def cold(work, effort):
        problem, _ = started(work)

        def action(target):
            shape = problem.solve(target, work.loads)
            if hasattr(ctr.Equilibrium, "is_stable"):
                assert not work.conservative or shape.is_stable
            return shape

        return timed(effort, action, *cold_starts(work))

    def many(work, effort):
        problem, _ = started(work)
        shapes = problem.solve_many(work.targets, work.loads)
        seconds = fastest(lambda: problem.solve_many(work.targets, work.loads), effort) / len(work.targets)
        return Measured(seconds, worst([shape.tip_position for shape in shapes], work.tips))

    measures = {INTEGRATION: integration, LINEARIZATION: linearization, WARM: warm, COLD: cold}
    if hasattr(ctr.Equilibrium, "unstable_directions"):
        measures[DERIVATIVES] = derivatives
    if hasattr(ctr.ForwardProblem, "solve_many"):
        measures[MANY] = many
    return Mode(name, measures)
