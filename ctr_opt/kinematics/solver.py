"""The solver of inverse kinematics: from where to search for one target, and how to begin a path."""

from __future__ import annotations

from collections.abc import Sequence
from time import perf_counter
from typing import Any

import numpy as np

from ..checks import Array, array, frozen
from ..errors import DefinitionError, SolveError
from ..forward.batch.rows import rows_of_loads
from ..forward.equilibrium import Equilibrium
from ..forward.problem import ForwardProblem
from ..loads.kind import Load
from ..robot.actuation import Actuation, actuation_of, joints_of
from .limits import Allowed, JointLimits
from .path import Follower
from .result import InverseKinematicsPath, InverseKinematicsResult, best
from .search import Point, TipSearch
from .starts import Starts
from .targets import LENGTH, Target


class InverseSolver:
    """Searches of one robot within its limits: see :class:`~ctr_opt.InverseKinematicsProblem` for the arguments."""

    def __init__(
        self,
        forward: ForwardProblem,
        limits: JointLimits | None,
        home: Actuation | None,
        weights: Any,
        tolerances: tuple[float, float],
        *,
        criterion: str,
        starts: int,
    ) -> None:
        if not isinstance(limits, (JointLimits, type(None))):
            raise DefinitionError(f"limits = {limits!r} must be JointLimits")
        self.forward, self.robot, self.limits = forward, forward.robot, limits or JointLimits()
        self.tolerances, self.criterion, self.starts = tolerances, criterion, starts
        tubes = len(self.robot.tubes)
        usual = np.repeat([1.0, 1.0 / LENGTH], tubes)
        self.weights = frozen(usual) if weights is None else array(weights, "weights", (2 * tubes,), above=0.0)
        self.allowed = Allowed.of(self.robot, self.limits)
        self.home = self._home_of(home)
        self._starts = Starts(self.forward, self.allowed, joints_of(self.home))
        if self.forward.compiles:  # tenths of a second now; without compiled code seconds, spent only when needed
            _ = self._starts.table

    def search(self, target: Target, loads: tuple[Load, ...]) -> TipSearch:
        """The search for one target under these loads."""
        allowed = Allowed.of(self.robot, self.limits, loads) if loads else self.allowed
        return TipSearch(self.forward, loads, allowed, self.weights, target, self.tolerances)

    def solve(self, target: Target, loads: tuple[Load, ...], initial: Equilibrium | None) -> InverseKinematicsResult:
        """The best answer of the searches from ``initial``, or home, and from random shapes."""
        begin = perf_counter()
        reference = joints_of(self.home if initial is None else self._checked(initial).actuation)
        search = self.search(target, loads)
        ends: list[Point] = []
        for start in self._starts.points(search, initial, reference, self.starts):
            ends.append(search.reach(start))
            if self.criterion == "nearest" and ends[-1].answers:
                break
        point = best(search, ends, self.criterion, reference)
        seconds = perf_counter() - begin
        return InverseKinematicsResult.of(search, point, reference, starts=len(ends), solve_time=seconds)

    def follow(
        self, targets: Sequence[Target], loads: Sequence[Any], initial: Equilibrium | None, step: Any, throw: bool
    ) -> InverseKinematicsPath:
        """The path through the targets in joint steps of at most ``step``, from ``initial`` or the best start."""
        rows = rows_of_loads(loads, len(targets), "targets")
        searches = [self.search(*row) for row in zip(targets, rows, strict=True)]
        longest = np.repeat(array(step, "longest_step", (2,), above=0.0), len(self.robot.tubes))
        if initial is None:
            path = self._from_anywhere(searches, longest)
        else:
            path = Follower(longest).follow(searches, self._checked(initial))
        if throw and not path.converged:
            raise SolveError(path.message, path)
        return path

    def _from_anywhere(self, searches: list[TipSearch], longest: Array) -> InverseKinematicsPath:
        """Follow a path from its first target, starting from the answer there that leads to the last, or furthest."""
        first, home, furthest = searches[0], joints_of(self.home), None
        for start in self._starts.points(first, None, home, self.starts):
            point = first.reach(start)
            if not point.answers:
                continue
            point = first.settle(point, home)
            path = Follower(longest, [point], [0]).follow(searches, point.equilibrium)
            if furthest is None or len(path.waypoints) > len(furthest.waypoints):
                furthest = path
            if path.converged:
                break
        return furthest or Follower(longest).broken(0, "no start reaches it")

    def _home_of(self, home: Actuation | None) -> Actuation:
        tubes = len(self.robot.tubes)
        if home is None:
            middle = [-0.5 * tube.length for tube in self.robot.tubes]
            joints = self.allowed.nearest(np.concatenate((np.zeros(tubes), middle)), self.weights)
            return actuation_of(joints)
        if not isinstance(home, Actuation) or len(home.rotations) != tubes:
            raise DefinitionError(f"home = {home!r} must be an Actuation of {tubes} tubes")
        self._check_limits(home, "home")
        return home

    def _checked(self, initial: Equilibrium) -> Equilibrium:
        if not isinstance(initial, Equilibrium) or not initial.converged or initial.robot != self.robot:
            raise DefinitionError(f"initial = {initial!r} must be a solved Equilibrium of this problem's robot")
        self._check_limits(initial.actuation, "initial")
        return initial

    def _check_limits(self, actuation: Actuation, field: str) -> None:
        exceeded = self.allowed.exceeded(joints_of(actuation))
        if exceeded:
            raise DefinitionError(f"{field} = {actuation!r} exceeds the limits: {'; '.join(exceeded)}")
