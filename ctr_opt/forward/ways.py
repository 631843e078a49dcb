"""The ways to an equilibrium, as data: what each way does and when it is tried, in the order of trying.

A way either reaches a solution of the boundary-value problem or fails with a reason; :func:`first_of` takes the first
that succeeds. A path of equilibria that begins at the stable straight robot need not stay stable. Steps may jump to
another branch or over two folds, and a path around folds changes its stability there. So a cold start's answer is
rejected if it is known to be unstable, and the next way is tried.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Any, TypeAlias, TypeVar

import attrs
import numpy as np

from ..checks import Array
from ..errors import DefinitionError
from ..layout.configuration import Configuration
from ..solvers.accuracy import ALONG_FAMILY, NEARBY
from ..solvers.arclength import trace_around
from ..solvers.homotopy import Trace, family_of, regular_between, trace
from ..solvers.ipopt import Ipopt
from ..solvers.newton import Newton, System
from ..solvers.status import SolveStatus
from ..transcription.shape import Shape
from .attempt import Failed
from .compiled import Record
from .continuation import Route, imperfect, released
from .equilibrium import Equilibrium
from .optimized import balance, discretized, lowest, minimum, polished, shape_of, shape_of_minimum, swept
from .record import SolvedRecord
from .run import Reached, Run
from .settings import Settings

_WHOLE, _UNLOADED, _STRAIGHT = (1.0, 1.0, 1.0), (0.0, 0.0, 1.0), (1.0, 1.0, 0.0)
_NEAR = 0.1  # of the way: if all paths end sooner, the loads are absurd and ways around folds too long
_T = TypeVar("_T")
_LOG = logging.getLogger(__name__)


@attrs.frozen
class Way:
    """A named way: ``go`` reaches a solution or raises ``Failed``; ``when`` decides by the failures so far."""

    name: str
    go: Callable[[Run], Reached]
    when: Callable[[Run, list[Failed]], bool] = lambda *_: True


def solve_configuration(settings: Settings, configuration: Configuration, initial: Record | None) -> Equilibrium:
    """Try all ways; returns the equilibrium or the record of the failure."""
    begin, run = perf_counter(), Run(settings, configuration, initial)
    last = None
    try:
        record = first_of(_ways(run), run, _accepted)
    except Failed as failure:
        record, last = run.failure(failure), run.unstable or run.last
    _LOG.info("%s: %s, %d iterations", record.outcome.path, record.status.description, record.outcome.iterations)
    seconds = perf_counter() - begin - run.setup_time
    outcome = attrs.evolve(record.outcome, setup_time=run.setup_time, solve_time=seconds)
    return Equilibrium(attrs.evolve(record, outcome=outcome), last)


def _ways(run: Run) -> Sequence[Way]:
    """The ways for the formulation and method of a run."""
    method = run.settings.method
    if run.settings.formulation == "energy":
        return ENERGY
    if isinstance(method, Ipopt):
        return TRANSCRIBED
    if run.initial is not None:
        return FROM_INITIAL
    return NEWTON if isinstance(method, Newton) else COLD


def first_of(ways: Sequence[Way], run: Run, finish: Callable[[Run, Reached], _T]) -> _T:
    """The finished answer of the first way that succeeds; raises ``Failed`` with all reasons."""
    failures: list[Failed] = []
    for way in ways:
        if not way.when(run, failures):
            continue
        _LOG.debug("trying %s", way.name)
        try:
            return finish(run, way.go(run))
        except Failed as failure:
            failures.append(failure)
            if failure.status is SolveStatus.INACCURATE:  # there is an equilibrium: no other way gets nearer
                break
    raise Failed.joined(failures)


def _accepted(run: Run, reached: Reached) -> SolvedRecord:
    """The accurate record of a solution; rejects a solution known to be unstable if other ways remain."""
    record = run.record(run.refined(reached))
    if run.settings.formulation != "automatic" or run.initial is not None:
        return record
    counted = record.second_variation
    if counted is None or not counted.negative:
        return record
    run.unstable, attempt = Equilibrium(record), run.attempts[-1]
    message = f"{attempt}: {SolveStatus.UNSTABLE.description}"
    attempt.outcome = f"unstable: {counted.negative} direction{'s' if counted.negative > 1 else ''}"
    z = record.base.unknowns(run.configuration.scales, run.configuration.kind.live)
    raise Failed(SolveStatus.UNSTABLE, f"{message} ({attempt.outcome})", z, reached=1.0)


# -- cold starts, by shooting ------------------------------------------------------------------------------------------


Factors: TypeAlias = tuple[float, float, float]
"""Factors of the loads with a potential, of the other loads, and of the precurvature."""


def _grown(
    run: Run, z: Array, begin: Factors, end: Factors, way: str, follow: Callable[..., Trace] = trace, flaw: bool = False
) -> Reached:
    """Follow the path along which the factors grow, for a perfect robot or one with a fading flaw."""

    def at(x: float) -> System:
        return run.shooting.scaled(*(a + x * (b - a) for a, b in zip(begin, end, strict=True)))

    return run.trace(imperfect(at, len(z)) if flaw else at, z, way, follow)


def _homotopy(*legs: tuple[str, Factors], **options: Any) -> Callable[[Run], Reached]:
    """Successive paths from the straight, unloaded robot, each given by its name and the factors at its end."""

    def go(run: Run) -> Reached:
        z, begin = np.zeros(run.shooting.unknowns), (0.0, 0.0, 0.0)
        for name, end in legs:
            try:
                reached = _grown(run, z, begin, end, name, **options)
            except Failed as failure:
                if begin == _UNLOADED:
                    whole = run.configuration
                    loads = whole.loads_on(whole.tube_ends, failure.reached)
                    _keep_last(run, Configuration(whole.robot, whole.actuation, loads), failure)
                raise
            z, begin = reached.solution.z, end
        return reached

    return go


def _by_newton(run: Run) -> Reached:
    method = run.settings.method
    assert isinstance(method, Newton)
    return run.newton(run.shooting, np.zeros(run.shooting.unknowns), method, "newton")


# -- cold starts, through a minimum of the energy ----------------------------------------------------------------------


def _by_energy(run: Run) -> Reached:
    """Minimize the energy, then polish by Newton's method or, if that fails, in the same discretization."""
    energy, stationary = minimum(run, run.configuration, run.configuration.mesh(), None)
    try:
        return run.refined(polished(run, energy, stationary))
    except Failed:
        return discretized(run, lowest, shape_of_minimum(run, energy, stationary))


def _other_loads_last(run: Run) -> Reached:
    """Minimize the energy under the loads with a potential, then add the other loads."""
    conservative = run.configuration.conservative_part()
    start = polished(run, *minimum(run, conservative, conservative.mesh(), None)).solution.z
    z = np.zeros(run.shooting.unknowns)
    z[: len(start)] = start
    return _grown(run, z, (1.0, 0.0, 1.0), _WHOLE, "homotopy in loads without potential")


# -- from another equilibrium ------------------------------------------------------------------------------------------


def _newton_from_initial(run: Run) -> Reached:
    """Run Newton's method from another equilibrium or a guess; fails if it may have changed the branch."""
    initial, configuration = run.initial, run.configuration
    assert initial is not None
    jacobian = initial.outcome.jacobian
    family = 0.0 if jacobian is None else family_of(jacobian)
    z = initial.base.unknowns(configuration.scales, configuration.kind.live)
    reached = run.newton(run.shooting, z, ALONG_FAMILY if family else NEARBY, "newton from initial")
    if jacobian is None:
        return reached
    comparable = jacobian.shape == reached.solution.jacobian.shape
    if comparable and regular_between(jacobian, reached.solution.jacobian, family):
        return reached
    run.attempts[-1].outcome = "perhaps another branch" if comparable else "loads of another kind"
    message = "newton from initial: the Jacobian may have been singular on the way"
    raise Failed(SolveStatus.STALLED, message, reached.solution.z)


def _continued(run: Run) -> Reached:
    """Follow the route from the configuration of the other equilibrium to this one."""
    initial, configuration = run.initial, run.configuration
    assert initial is not None
    route = Route(initial.configuration, configuration, run.settings.integrator)
    z = initial.base.unknowns(configuration.scales, route.kind.live)
    if initial.robot != configuration.robot or initial.shape is None:
        try:
            release = released(route.at(0.0), z)
        except DefinitionError as error:
            message = f"the initial configuration does not fit this robot: {error}"
            raise Failed(SolveStatus.STALLED, message, z) from None
        z = run.trace(release, z, "release of the residual").solution.z
    try:
        z = run.trace(route.at, z, "continuation from initial").solution.z
    except Failed as failure:
        _keep_last(run, route.configuration(failure.reached), failure)
        raise
    return run.newton(run.shooting, z[: run.shooting.unknowns], NEARBY, "newton")


def _keep_last(run: Run, there: Configuration, failure: Failed) -> None:
    """Keep the equilibrium at which a path of this robot ended."""
    last = solve_configuration(run.settings, there, SolvedRecord.guess(there, run.base(failure.z)))
    run.last = last if last.converged else None


# -- by IPOPT ----------------------------------------------------------------------------------------------------------


def _minimum_energy(run: Run) -> Reached:
    """Minimize the transcribed energy from another shape, the homotopy's answer, or the straight robot."""
    guess: Record | None = run.initial
    if guess is None and run.settings.ipopt.start == "homotopy":
        guess = _by_homotopy(run)
    try:
        shape = None if guess is None else shape_of(run, guess)
    except Failed as failure:
        run.attempt(failure.message)
        shape = None
    return discretized(run, lowest, shape)


def _transcribed(run: Run) -> Reached:
    """Solve the transcribed Cosserat equations."""
    if run.initial is not None:
        return discretized(run, balance, _near(run, run.initial))
    return discretized(run, balance, None if run.settings.ipopt.start == "straight" else _anything(run))


def _near(run: Run, initial: Record) -> Shape:
    """The shape that shooting finds from ``initial``, or the shape of ``initial`` unless shooting met a fold."""
    try:
        reached = first_of(FROM_INITIAL, run, lambda _, reached: reached)
    except Failed as failure:
        if failure.status is SolveStatus.FOLD:
            raise
        return shape_of(run, initial)
    return swept(run, reached.shooting, reached.solution.z)


def _anything(run: Run) -> Shape | None:
    """A start for IPOPT: the homotopy's answer or, failing that, a minimum under the loads with a potential."""
    guess = _by_homotopy(run)
    if guess is not None:
        return guess.shape
    conservative = run.configuration.conservative_part()
    try:
        return shape_of_minimum(run, *minimum(run, conservative, conservative.mesh(), None))
    except Failed:
        return None


def _by_homotopy(run: Run) -> SolvedRecord | None:
    try:
        return first_of(COLD, run, _accepted)
    except Failed:
        return None


# -- the ways, in their order ------------------------------------------------------------------------------------------


def _with_potential(run: Run, _: list[Failed]) -> bool:
    return run.settings.formulation == "automatic" and not run.configuration.without_potential


def _without_potential(run: Run, _: list[Failed]) -> bool:
    return run.settings.formulation == "automatic" and bool(run.configuration.without_potential)


def _far_along(run: Run, failures: list[Failed]) -> bool:
    """Whether a path got far and has steps left; more steps may lead to an equilibrium that the robot snaps to."""
    hopeless = max(failure.reached for failure in failures) < _NEAR or any(failure.exhausted for failure in failures)
    return run.settings.formulation == "automatic" and not hopeless


def _within_half_a_turn(run: Run, _: list[Failed]) -> bool:
    """Whether tubes turn at most half a turn; whole turns leave the Jacobian as it is and hide a change of branch."""
    initial = run.initial
    assert initial is not None
    turned = run.configuration.actuation.rotations - initial.actuation.rotations
    return initial.shape is None or bool(np.ptp(turned) <= np.pi)


COLD = (
    Way("homotopy", _homotopy(("homotopy", _WHOLE))),
    Way("minimum energy", _by_energy, _with_potential),
    Way("loads, then curvature", _homotopy(("homotopy in loads", _STRAIGHT), ("homotopy in curvature", _WHOLE))),
    Way("curvature, then loads", _homotopy(("homotopy in curvature", _UNLOADED), ("homotopy in loads", _WHOLE))),
    Way("minimum energy, then loads without potential", _other_loads_last, _without_potential),
    Way("around folds", _homotopy(("homotopy around folds", _WHOLE), follow=trace_around), _far_along),
    Way(
        "around folds of an imperfect robot",
        _homotopy(("homotopy around folds of an imperfect robot", _WHOLE), follow=trace_around, flaw=True),
        _far_along,
    ),
)
NEWTON = (Way("newton", _by_newton),)
FROM_INITIAL = (
    Way("newton from initial", _newton_from_initial, _within_half_a_turn),
    Way("continuation from initial", _continued),
)
ENERGY = (Way("minimum energy", _minimum_energy),)
TRANSCRIBED = (Way("transcription", _transcribed),)
