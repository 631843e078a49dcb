"""Solution of calibrations by either method."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..checks import choice
from ..errors import DefinitionError, EstimationError
from ..estimation.sensors import names_of
from ..forward.equilibrium import Equilibrium
from ..robot.names import parsed
from .estimation import Estimation, Progress
from .fit import Fit
from .reduced import FitPoint, solve_reduced
from .simultaneous import solve_simultaneous

METHODS: dict[str, Callable[..., FitPoint]] = {"simultaneous": solve_simultaneous, "reduced": solve_reduced}


_MOST_FRAMES = 8  # how often poses are compared in the frames of other tubes, as estimates move their ends


def check_sensors(estimation: Estimation) -> None:
    """Raise ``DefinitionError`` for the pose of a sensor without measurements."""
    measured = names_of([one for experiment in estimation.experiments for one in experiment.observables])
    for entry in estimation.unknowns.entries:
        match parsed(entry.acts_on[0]):
            case ("sensors", name, _) if name not in measured:
                known = ", ".join(map(repr, measured)) or "none"
                raise DefinitionError(
                    f"{entry.name!r}: no measurement has a sensor {name!r}; measured sensors: {known}"
                )


def solve(estimation: Estimation, method: str, progress: Progress | None) -> Fit:
    """Implement :meth:`CalibrationProblem.solve <ctr_opt.CalibrationProblem.solve>`."""
    way = METHODS[choice(method, "method", tuple(METHODS))]
    equilibria = _prepared(estimation, progress)
    answer = way(estimation, equilibria, progress)
    if not answer.converged and way is solve_simultaneous:  # for example if a direction is undetermined
        second = solve_reduced(estimation, equilibria, progress)
        if second.converged:
            answer, method = second, "simultaneous (not converged), then reduced"
    ways = method
    for _ in range(_MOST_FRAMES):
        framed = estimation.framed_at(answer.x)
        if framed is estimation:
            break
        estimation, method = framed, f"{ways}, then reduced with poses of other tubes, as the estimates move their ends"
        equilibria = estimation.equilibria_of(answer.x, "the estimates", progress)
        estimation.prepare(equilibria)
        answer = solve_reduced(estimation, equilibria, progress, start=answer.x)
    else:
        raise EstimationError(_undecided(estimation, answer))
    if not answer.converged:
        raise EstimationError(_failure(estimation, answer, method))
    return Fit(estimation, answer, method)


def nominal(estimation: Estimation) -> Fit:
    """Implement :meth:`CalibrationProblem.nominal <ctr_opt.CalibrationProblem.nominal>`."""
    equilibria, initial = _prepared(estimation), estimation.unknowns.initial
    return Fit(estimation, FitPoint(initial, estimation.states(initial, equilibria), True, "nominal", 0), "nominal")


def _prepared(estimation: Estimation, progress: Progress | None = None) -> list[Equilibrium]:
    """The equilibria at the initial values; builds the models."""
    equilibria = estimation.equilibria_of(estimation.unknowns.initial, "the initial parameters", progress)
    estimation.prepare(equilibria)
    return equilibria


def _undecided(estimation: Estimation, outcome: FitPoint) -> str:
    """Which poses are of one tube with some estimates, and of another with those that follow."""
    before = (layout.observables for layout in estimation.layouts)
    after = (layout.observables for layout in estimation.framed_at(outcome.x).layouts)
    numbers = [k for k, (old, new) in enumerate(zip(before, after, strict=True)) if old != new]
    return (
        f"experiments {', '.join(map(str, numbers))}: the estimates do not settle which tube is innermost where poses "
        "were measured; name it, as in PoseMeasurement(Distal(0), ..., tube=0)"
    )


def _failure(estimation: Estimation, outcome: FitPoint, method: str) -> str:
    """Message of a failed solve: what was tried, how far it came, what to do."""
    lower, upper = estimation.unknowns.bounds
    at_bound = [
        label
        for label, x, a, b in zip(estimation.unknowns.labels, outcome.x, lower, upper, strict=True)
        if np.isclose(x, a, rtol=1e-6) or np.isclose(x, b, rtol=1e-6)
    ]
    hint = f"; at their bounds: {', '.join(at_bound)}" if at_bound else ""
    values = ", ".join(f"{a} = {x:.6g}" for a, x in zip(estimation.unknowns.labels, outcome.x, strict=True))
    return (
        f"the {method} estimation did not converge after {outcome.iterations} iterations: {outcome.message}; "
        f"last values: {values}{hint}. "
        f"Try priors, better initial values, or fewer parameters"
    )
