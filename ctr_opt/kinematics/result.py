"""Results of inverse kinematics: an actuation with its shape and its errors, or a path of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array, freezing
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
"""Cost of an answer for each criterion, from its point and its distance from the start of the search."""


class InverseKinematicsStatus(Advised):
    """How a search or a path of inverse kinematics ended.

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
        "avoid that place, begin elsewhere with `initial`, or allow longer steps",
    )


@attrs.frozen(eq=False, kw_only=True, repr=False)
class InverseKinematicsResult:
    """The answer to one target; for an unreachable target, the nearest stable shape that was found.

    Attributes
    ----------
    actuation, equilibrium
        The actuation and the robot's shape there. The shape is never known to be unstable.
    position_error, angle_error
        Distance of the tip from the target, m, and angle of its axis or frame, rad. The angle is zero if the target has
        no direction.
    status, message
        How the search ended, and why the target is not reached.
    limits
        Names of the active limits.
    distance
        Weighted norm of the joints' changes since the start of the search (``initial`` or home).
    starts
        Number of shapes from which searches began. If it is more than one, the robot may be unable to move from
        ``initial`` to the answer without snapping.
    solve_time
        Time of the solve, s.
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
        """Make the result of a search from its last point.

        Parameters
        ----------
        search, point
            The search and its last point.
        reference
            Joints where the search began, ``(2 tubes,)``.
        starts, solve_time
            As the attributes.
        """
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
        """Whether the target is reached within the tolerances; the shape is then not known to be unstable."""
        return self.status is InverseKinematicsStatus.CONVERGED

    @property
    def stable(self) -> bool | None:
        """Whether the shape is stable; None under loads for which stability is not defined."""
        return self.equilibrium.is_stable

    def report(self) -> str:
        """Describe the answer as text."""
        angles = ", ".join(f"{x:.2f}" for x in np.rad2deg(self.actuation.rotations))
        places = ", ".join(f"{1e3 * x:.3f}" for x in self.actuation.translations)
        lines = [
            f"inverse kinematics: {self.status.description}",
            f"  rotations       {angles} deg",
            f"  translations    {places} mm",
            f"  tip error       {self.position_error:.2e} m, {self.angle_error:.2e} rad",
            f"  stable          {'not defined' if self.stable is None else 'yes' if self.stable else 'no'}",
            f"  at limits       {'; '.join(self.limits) or 'none'}",
            f"  effort          {self.starts} start{'s' if self.starts > 1 else ''}, {1e3 * self.solve_time:.1f} ms",
        ]
        return "\n".join(lines if self.converged else [*lines, f"  {self.message}", f"  {self.status.advice}"])

    def __str__(self) -> str:
        return self.report()

    def __repr__(self) -> str:
        return f"<InverseKinematicsResult: {self.status.description}, {self.position_error:.2g} m from the target>"


@attrs.frozen(eq=False, kw_only=True, repr=False)
class InverseKinematicsPath:
    """Actuations along a path of targets; if the path breaks off, those up to there.

    Attributes
    ----------
    actuations
        ``(k, 2 tubes)``: rotations, rad, then translations, m.
    equilibria
        The shapes. None of them is known to be unstable.
    position_errors, angle_errors
        ``(k,)``, m and rad: errors at the targets and at the targets inserted between them.
    waypoints
        Indices of the user's targets among the ``k`` points.
    status, message
        How the path ended, and where and why it breaks off.
    """

    actuations: Array = attrs.field(converter=freezing)
    equilibria: tuple[Equilibrium, ...]
    position_errors: Array = attrs.field(converter=freezing)
    angle_errors: Array = attrs.field(converter=freezing)
    waypoints: NDArray[np.intp] = attrs.field(converter=freezing)
    status: InverseKinematicsStatus
    message: str = ""

    @property
    def converged(self) -> bool:
        """Whether the path leads to the last target."""
        return self.status is InverseKinematicsStatus.CONVERGED

    @property
    def tip_positions(self) -> Array:
        """Positions of the tip, ``(k, 3)``, m."""
        return np.array([shape.tip_position for shape in self.equilibria]).reshape(-1, 3)

    def __len__(self) -> int:
        return len(self.equilibria)

    def __repr__(self) -> str:
        return f"<InverseKinematicsPath: {self.status.description}, {len(self)} points, {len(self.waypoints)} targets>"


def best(search: TipSearch, ends: Sequence[Point], criterion: str, reference: Array) -> Point:
    """Choose the best answer among the ends of searches; without an answer, the stable shape nearest the target."""
    stable = [point for point in ends if point.stable]
    if not stable:
        raise SolveError("no stable equilibrium was found under these loads, neither at home nor at any other start")
    answers = [point for point in stable if point.answers]
    if not answers:
        return min(stable, key=lambda point: point.cost)
    if criterion in ("nearest", "distance"):
        answers = [search.settle(point, reference) for point in answers]
    return min(answers, key=lambda point: CRITERIA[criterion](point, search.distance(point, reference)))
