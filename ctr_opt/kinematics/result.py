"""What inverse kinematics answers: an actuation, its shape, and how near it is to the target; a path of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..errors import SolveError
from ..forward.equilibrium import Equilibrium
from ..robot.actuation import Actuation
from ..solvers.status import Advised
from .search import Ending, Point, TipSearch

CRITERIA: dict[str, Callable[[Point, float], float]] = {
    "nearest": lambda _, distance: distance,
    "distance": lambda _, distance: distance,
    "torsion": lambda point, _: float(np.abs(point.equilibrium.last_iterate.torsional).max()),
    "stability": lambda point, _: -(point.equilibrium.stability or 0.0),
}
"""What is least for the answer that is chosen, by a point and its distance from where the search began."""


class InverseKinematicsStatus(Advised):
    """How it ended.

    >>> InverseKinematicsStatus.CONVERGED.advice
    'nothing to do'
    """

    CONVERGED = ("converged", "nothing to do")
    UNREACHABLE = (
        "unreachable from here",
        "wider limits, more `starts`, another `initial`, or a position instead of a pose may help",
    )
    BROKEN = (
        "the path breaks off",
        "go around that place, begin elsewhere with `initial`, or allow longer steps",
    )


@attrs.frozen(eq=False, kw_only=True, repr=False)
class InverseKinematicsResult:
    """The answer to one target; where it is unreachable, the nearest that was found.

    Attributes
    ----------
    actuation, equilibrium
        What to do, and the robot's shape then: never one that is known to be unstable.
    position_error, angle_error
        Distance of the tip from the target, m, and angle of its axis or frame, rad, zero where none was asked for.
    status, message
        How it ended; why the target is not reached.
    limits
        The limits that are met.
    distance
        From where the search began (``initial`` or home): norm of the joints' changes by their weights.
    starts
        From how many shapes searches began: where it is more than one, the answer may be one to which the robot cannot
        go from ``initial`` without snapping.
    solve_time
        Seconds.
    """

    actuation: Actuation
    equilibrium: Equilibrium
    position_error: float
    angle_error: float
    status: InverseKinematicsStatus
    message: str
    limits: tuple[str, ...]
    distance: float
    starts: int
    solve_time: float

    @classmethod
    def of(
        cls, search: TipSearch, point: Point, reference: Array, *, starts: int, solve_time: float
    ) -> InverseKinematicsResult:
        """The end of a search as its answer; ``reference`` are the joints where it began."""
        (position, angle), message = point.errors, ""
        if point.ending is not Ending.REACHED:
            turned = f" and {np.rad2deg(angle):.3g} deg" if search.target.turns else ""
            message = (
                f"the nearest stable shape found from {starts} start{'s' if starts > 1 else ''} leaves the tip "
                f"{1e3 * position:.3g} mm{turned} from the target: {point.ending.value}{search.limits_at(point)}"
            )
        return cls(
            actuation=point.equilibrium.actuation,
            equilibrium=point.equilibrium,
            position_error=position,
            angle_error=angle,
            status=InverseKinematicsStatus.UNREACHABLE if message else InverseKinematicsStatus.CONVERGED,
            message=message,
            limits=search.allowed.active(point.joints),
            distance=search.distance(point, reference),
            starts=starts,
            solve_time=solve_time,
        )

    @property
    def converged(self) -> bool:
        """Whether the target is reached, to the tolerances, by a shape that is not known to be unstable."""
        return self.status is InverseKinematicsStatus.CONVERGED

    @property
    def stable(self) -> bool | None:
        """Whether the shape is stable; None under loads for which that is not defined."""
        return self.equilibrium.is_stable

    def report(self) -> str:
        """What was found, in words."""
        angles = ", ".join(f"{x:.2f}" for x in np.rad2deg(self.actuation.rotations))
        places = ", ".join(f"{1e3 * x:.3f}" for x in self.actuation.translations)
        lines = [
            f"inverse kinematics: {self.status.description}",
            f"  rotations       {angles} deg",
            f"  translations    {places} mm",
            f"  off the target  {self.position_error:.2e} m, {self.angle_error:.2e} rad",
            f"  stable          {'not defined' if self.stable is None else 'yes' if self.stable else 'no'}",
            f"  at limits       {'; '.join(self.limits) or 'none'}",
            f"  effort          {self.starts} start{'s' if self.starts > 1 else ''}, {1e3 * self.solve_time:.1f} ms",
        ]
        return "\n".join(lines if self.converged else [*lines, f"  {self.message}", f"  {self.status.advice}"])

    def __str__(self) -> str:
        return self.report()

    def __repr__(self) -> str:
        return f"<InverseKinematicsResult: {self.status.description}, {self.position_error:.2g} m off the target>"


@attrs.frozen(eq=False, kw_only=True, repr=False)
class InverseKinematicsPath:
    """Actuations along a path, each next to the one before; where it breaks off, those up to there.

    Attributes
    ----------
    actuations
        ``(k, 2 tubes)``: rotations, rad, then translations, m.
    equilibria
        The shapes, none of them known to be unstable.
    position_errors, angle_errors
        ``(k,)``, m and rad: distances from the targets, or from the places between that were put in.
    waypoints
        Which of the ``k`` are the targets given.
    status, message
        How it ended; where and why it breaks off.
    """

    actuations: Array
    equilibria: tuple[Equilibrium, ...]
    position_errors: Array
    angle_errors: Array
    waypoints: NDArray[np.intp]
    status: InverseKinematicsStatus
    message: str = ""

    @property
    def converged(self) -> bool:
        """Whether it leads to the last target."""
        return self.status is InverseKinematicsStatus.CONVERGED

    @property
    def tip_positions(self) -> Array:
        """``(k, 3)``, m."""
        return np.array([shape.tip_position for shape in self.equilibria]).reshape(-1, 3)

    def __len__(self) -> int:
        return len(self.equilibria)

    def __repr__(self) -> str:
        return f"<InverseKinematicsPath: {self.status.description}, {len(self)} points, {len(self.waypoints)} targets>"


def best(search: TipSearch, ends: Sequence[Point], criterion: str, reference: Array) -> Point:
    """The best answer among the ends of searches; if there is none, the stable shape nearest to the target."""
    stable = [point for point in ends if point.stable]
    if not stable:
        raise SolveError("no stable equilibrium was found under these loads, neither at home nor at any other start")
    answers = [point for point in stable if point.answers]
    if not answers:
        return min(stable, key=lambda point: point.cost)
    if criterion in ("nearest", "distance"):
        answers = [search.settle(point, reference) for point in answers]
    return min(answers, key=lambda point: CRITERIA[criterion](point, search.distance(point, reference)))
