"""A path of targets, followed from shape to shape."""

from __future__ import annotations

from typing import Any

import attrs
import numpy as np

from ..checks import Array, array, rigid
from ..errors import DefinitionError
from ..forward.equilibrium import Equilibrium
from .limits import joints_of
from .result import InverseKinematicsPath, InverseKinematicsStatus
from .search import Ending, Point, Search
from .starts import loaded
from .targets import Target

_LEAST_PART = 2.0**-10  # of the way between two targets: shorter steps are not tried
_SAME = 10.0  # tolerances: tips that far apart are of two shapes


class Broken(Exception):  # noqa: N818 - never leaves this package
    """The path breaks off: why."""


@attrs.define(eq=False)
class Follower:
    """The points of a path so far, and which of them are targets that were given: ``waypoints``.

    ``longest``: changes of the joints ``(2 tubes,)`` from point to point.
    """

    longest: Array
    points: list[Point] = attrs.field(factory=list)
    waypoints: list[int] = attrs.field(factory=list)

    def advance(self, here: Equilibrium, search: Search) -> Equilibrium:
        """From a shape to the target of a search, over places in between where steps would be too long."""
        shape = loaded(search, here)
        if shape is None:
            raise Broken("the robot snaps when the loads change")
        start, done, part = search.target.at(shape), 0.0, 1.0
        while done < 1.0:
            place = search.target if done + part == 1.0 else start.toward(search.target, done + part)
            point, why = self._step(shape, attrs.evolve(search, target=place))
            if not why:
                self.points.append(point)
                shape, done = point.equilibrium, done + part
                part = min(2.0 * part, 1.0 - done)
                continue
            part *= 0.5
            if part < _LEAST_PART:
                raise Broken(why)
        self.waypoints.append(len(self.points) - 1)
        return shape

    def path(self, message: str) -> InverseKinematicsPath:
        """What has been found; with a message: where it breaks off."""
        errors = [point.target.errors(point.equilibrium) for point in self.points]
        position, angle = np.array(errors).reshape(-1, 2).T
        return InverseKinematicsPath(
            actuations=np.array([point.joints for point in self.points]).reshape(-1, len(self.longest)),
            equilibria=tuple(point.equilibrium for point in self.points),
            position_errors=position,
            angle_errors=angle,
            waypoints=np.array(self.waypoints, dtype=np.intp),
            status=InverseKinematicsStatus.BROKEN if message else InverseKinematicsStatus.CONVERGED,
            message=message,
        )

    def _step(self, here: Equilibrium, search: Search) -> tuple[Point, str]:
        """The next point, and why it is none."""
        start, before = Point(here, search.target), joints_of(here.actuation)
        point, ending = search.reach(start)
        if ending is not Ending.REACHED:
            return point, _with_limits(ending.value, search, point)
        point = search.settle(point, before)
        if not search.stable(point):
            return point, "the shape becomes unstable"
        if (np.abs(point.joints - before) > self.longest).any():
            return point, _with_limits("the joints would have to jump", search, point)
        straight = search.moved(start, search.weights * (point.joints - before))
        if straight is None or not search.met(straight, _SAME):
            return point, "the robot would snap on the way of the joints"
        return point, ""


def _with_limits(why: str, search: Search, point: Point) -> str:
    met = search.allowed.active(point.joints)
    return f"{why}; at its limits: {', '.join(met)}" if met else why


def targets_of(targets: Any, axes: Any) -> list[Target]:
    """Positions ``(k, 3)``, with or without axes, or poses ``(k, 4, 4)``, as targets."""
    if np.ndim(targets) == 3:
        if axes is not None:
            raise DefinitionError("axes belong to positions: poses have axes of their own")
        poses = array(targets, "targets", (None, 4, 4), unit="m")
        made = [Target.of(None, None, rigid(pose, f"targets[{k}]")) for k, pose in enumerate(poses)]
    else:
        positions = array(targets, "targets", (None, 3), unit="m")
        wanted = [None] * len(positions) if axes is None else array(axes, "axes", (len(positions), 3))
        for k, axis in enumerate(wanted):
            if axis is not None and not axis.any():
                raise DefinitionError(f"axes[{k}] is zero: it must be a direction")
        made = [Target.of(p, axis, None) for p, axis in zip(positions, wanted, strict=True)]
    if not made:
        raise DefinitionError("targets is empty")
    return made
