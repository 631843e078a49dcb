"""Path following: from shape to shape along a sequence of targets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import attrs
import numpy as np

from ..checks import Array, array
from ..errors import DefinitionError
from ..forward.equilibrium import Equilibrium
from ..robot.actuation import joints_of
from .result import InverseKinematicsPath, InverseKinematicsStatus
from .search import Ending, Point, TipSearch
from .starts import loaded
from .targets import Target

_LEAST_PART = 2.0**-10  # of the way between two targets: shorter steps are not tried
_SAME = 10.0  # tolerances: tips farther apart belong to two shapes


class Broken(Exception):  # noqa: N818 - never leaves this package
    """Raised when the path breaks off; the text says why."""


@attrs.define(eq=False)
class Follower:
    """The points of a path so far, and the indices of the user's targets among them, ``waypoints``.

    ``longest`` holds the largest allowed changes of the joints ``(2 tubes,)`` from point to point.
    """

    longest: Array
    points: list[Point] = attrs.field(factory=list)
    waypoints: list[int] = attrs.field(factory=list)

    def follow(self, searches: Sequence[TipSearch], here: Equilibrium) -> InverseKinematicsPath:
        """Follow the remaining targets from a shape, one search per target."""
        for k in range(len(self.waypoints), len(searches)):
            try:
                here = self._advance(here, searches[k])
            except Broken as broken:
                return self.broken(k, str(broken))
        return self._path("")

    def broken(self, target: int, why: str) -> InverseKinematicsPath:
        """Return the path up to the place where it breaks off."""
        return self._path(f"the path breaks off on the way to targets[{target}]: {why}")

    def _path(self, message: str) -> InverseKinematicsPath:
        position, angle = np.array([point.errors for point in self.points]).reshape(-1, 2).T
        return InverseKinematicsPath(
            actuations=np.array([point.joints for point in self.points]).reshape(-1, len(self.longest)),
            equilibria=tuple(point.equilibrium for point in self.points),
            position_errors=position,
            angle_errors=angle,
            waypoints=np.array(self.waypoints, dtype=np.intp),
            status=InverseKinematicsStatus.BROKEN if message else InverseKinematicsStatus.CONVERGED,
            message=message,
        )

    def _advance(self, here: Equilibrium, search: TipSearch) -> Equilibrium:
        """Move from a shape to the target of a search, with intermediate targets if steps would be too long."""
        shape = loaded(search, here)
        if shape is None:
            raise Broken("the robot snaps when the loads change")
        start, done, part = search.target.at(shape), 0.0, 1.0
        while done < 1.0:
            place = search.target if done + part == 1.0 else start.toward(search.target, done + part)
            try:
                point = self._next(shape, attrs.evolve(search, target=place))
            except Broken:
                part *= 0.5
                if part < _LEAST_PART:
                    raise
                continue
            self.points.append(point)
            shape, done = point.equilibrium, done + part
            part = min(2.0 * part, 1.0 - done)
        self.waypoints.append(len(self.points) - 1)
        return shape

    def _next(self, here: Equilibrium, search: TipSearch) -> Point:
        """Find the next point, at the target of a search; ``Broken`` says why it cannot be reached."""
        start, before = Point(here, search.target), joints_of(here.actuation)
        point = search.reach(start)
        if point.ending is not Ending.REACHED:
            raise Broken(point.ending.value + search.limits_at(point))
        point = search.settle(point, before)
        if not point.stable:
            raise Broken("the shape becomes unstable")
        if (np.abs(point.joints - before) > self.longest).any():
            raise Broken("the joints would have to jump" + search.limits_at(point))
        straight = search.moved(start, search.weights * (point.joints - before))
        if straight is None or not search.met(straight, _SAME):
            raise Broken("the robot would snap while the joints move there")
        return point


def targets_of(targets: Any, axes: Any) -> list[Target]:
    """Convert positions ``(k, 3)``, with or without axes, or poses ``(k, 4, 4)`` to targets."""
    posed = np.ndim(targets) == 3
    if posed and axes is not None:
        raise DefinitionError("axes must be given with positions only: poses already contain axes")
    places = array(targets, "targets", (None, 4, 4) if posed else (None, 3), unit="m")
    if not len(places):
        raise DefinitionError("targets is empty, but must contain at least one target")
    directions = [None] * len(places) if axes is None else array(axes, "axes", (len(places), 3))
    pairs = enumerate(zip(places, directions, strict=True))
    return [
        Target.of(place, axis, None, (f"targets[{k}]", f"axes[{k}]", f"targets[{k}]")) for k, (place, axis) in pairs
    ]
