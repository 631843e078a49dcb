"""What inverse kinematics answers: an actuation, its shape, and how near that is to the target; a path of them."""

from __future__ import annotations

from enum import Enum

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..forward.equilibrium import Equilibrium
from ..robot.actuation import Actuation


class InverseKinematicsStatus(Enum):
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

    def __init__(self, description: str, advice: str) -> None:
        self.description = description
        self.advice = advice


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
