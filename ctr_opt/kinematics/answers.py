"""Which of several searches is the answer, and what is said of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..checks import Array
from ..errors import SolveError
from .result import InverseKinematicsResult, InverseKinematicsStatus
from .search import Ending, Point, Search

CRITERIA: dict[str, Callable[[Point, float], float]] = {
    "nearest": lambda _, distance: distance,
    "distance": lambda _, distance: distance,
    "torsion": lambda point, _: float(np.abs(point.equilibrium.last_iterate.torsional).max()),
    "stability": lambda point, _: -(point.equilibrium.stability or 0.0),
}
"""What is small of the answer that is chosen."""


def best(
    search: Search, found: Sequence[tuple[Point, Ending]], criterion: str, reference: Array
) -> tuple[Point, Ending]:
    """Of the answers the best, or where there are none what is nearest to the target."""
    stable = [(point, ending) for point, ending in found if search.stable(point)]
    answers = [point for point, ending in stable if ending is Ending.REACHED]
    if not stable:
        raise SolveError("no stable equilibrium was found under these loads, neither at home nor at any other start")
    if not answers:
        return min(stable, key=lambda each: each[0].cost)
    if criterion in ("nearest", "distance"):
        answers = [search.settle(point, reference) for point in answers]
    measure = CRITERIA[criterion]
    return min(answers, key=lambda point: measure(point, search.distance(point, reference))), Ending.REACHED


def answered(
    search: Search, point: Point, ending: Ending, reference: Array, *, starts: int, solve_time: float
) -> InverseKinematicsResult:
    """A point as the answer to its target."""
    position, angle = search.target.errors(point.equilibrium)
    reached, limits = ending is Ending.REACHED, search.allowed.active(point.joints)
    return InverseKinematicsResult(
        actuation=point.equilibrium.actuation,
        equilibrium=point.equilibrium,
        position_error=position,
        angle_error=angle,
        status=InverseKinematicsStatus.CONVERGED if reached else InverseKinematicsStatus.UNREACHABLE,
        message="" if reached else _why(search, ending, (position, angle), starts, limits),
        limits=limits,
        distance=search.distance(point, reference),
        starts=starts,
        solve_time=solve_time,
    )


def _why(search: Search, ending: Ending, errors: tuple[float, float], starts: int, limits: tuple[str, ...]) -> str:
    turned = f" and {np.rad2deg(errors[1]):.3g} deg" if search.target.turns else ""
    met = f"; at its limits: {', '.join(limits)}" if limits else ""
    return (
        f"the nearest stable shape found from {starts} start{'s' if starts > 1 else ''} leaves the tip "
        f"{1e3 * errors[0]:.3g} mm{turned} from the target: {ending.value}{met}"
    )
