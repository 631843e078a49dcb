"""Inverse kinematics under known load: from where the tip shall be to what the actuators do."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from time import perf_counter
from typing import Any

import numpy as np

from ..checks import Array, array, choice, flag, number, whole
from ..errors import CompilationError, DefinitionError, SolveError
from ..forward.batch.rows import rows_of_loads
from ..forward.equilibrium import Equilibrium
from ..forward.problem import ForwardProblem
from ..forward.solver import as_loads
from ..loads.kind import Load
from ..robot.actuation import Actuation, actuation_of, joints_of
from ..robot.robot import Robot
from .limits import Allowed, JointLimits
from .path import Follower, targets_of
from .result import CRITERIA, InverseKinematicsPath, InverseKinematicsResult, best
from .search import Point, TipSearch
from .starts import Starts
from .targets import LENGTH, Target

_FORWARD, _LEAST_FORWARD = 0.1, 1e-7  # errors of the forward solves: over the tolerance, and over the length


class InverseKinematicsProblem:
    """Find actuations that bring a robot's tip to a position, a position and an axis, or a pose.

    Parameters
    ----------
    robot
        The robot.
    limits
        What the joints may do; default: any angle, translations from where 0.1 mm of a tube stand out to 0, bases and
        tips in the order of the tubes.
    home
        Where searches begin without an ``initial`` shape; default: no rotation and every tube half drawn back, or the
        nearest to that within the limits.
    criterion
        Which of several answers. ``"nearest"``: the first one found, moved to the place nearest to where the search
        began that steps with the same tip lead to. Or the best of all ``starts``: by least ``"distance"``, by the least
        ``"torsion"`` (largest torsional moment at a base), or by the most ``"stability"`` (smallest eigenvalue of the
        second variation of the potential energy against its elastic part).
    starts
        From how many shapes searches begin at most: the initial one, then random stable ones with the tip near.
    weights
        ``(2 tubes,)``: what a radian, then what a metre of each joint counts in distances. Default: 1 and 50, so that a
        radian counts as much as 20 mm.
    tolerance, angle_tolerance
        Largest accepted distance of the tip, m, and angle of its axis or frame, rad. Forward solves are accurate to a
        tenth of the former.
    compiled
        Default: compiled code for what it knows, where there is a compiler (waiting some seconds the first time on a
        machine); ``False``: CasADi's virtual machine, hundreds of times slower; ``True``: an error without compiler.

    Notes
    -----
    ``docs/how_to/inverse_kinematics.md``. Searches are damped Gauss-Newton steps with the exact Jacobian within the
    limits, each solved on the branch of the shape before it; break points are sorted again in every solve.

    Examples
    --------
    >>> import ctr_opt as ctr
    >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)
    >>> problem = ctr.InverseKinematicsProblem(ctr.Robot([tube]))
    >>> answer = problem.solve([0.023516, 0.0, 0.064422])  # on the surface that this tip sweeps
    >>> answer.status.description, answer.actuation.translations.round(3).tolist()
    ('converged', [-0.03])
    """

    def __init__(
        self,
        robot: Robot,
        *,
        limits: JointLimits | None = None,
        home: Actuation | None = None,
        criterion: str = "nearest",
        starts: int = 20,
        weights: Any = None,
        tolerance: float = 1e-6,
        angle_tolerance: float = 1e-4,
        compiled: bool | None = None,
    ) -> None:
        if not isinstance(limits, (JointLimits, type(None))):
            raise DefinitionError(f"limits = {limits!r} must be JointLimits")
        accepted = number(tolerance, "tolerance", least=1e-9, most=1e-2, unit="m")
        self.tolerances = accepted, number(angle_tolerance, "angle_tolerance", least=1e-8, most=1.0, unit="rad")
        self.criterion = choice(criterion, "criterion", tuple(CRITERIA))
        self.starts = whole(starts, "starts", 1)
        wanted = compiled if compiled is None else flag(compiled, "compiled")
        self.forward = _forward(robot, accepted, wanted)
        self.robot, self.limits = robot, limits or JointLimits()
        tubes = len(robot.tubes)
        usual = np.repeat([1.0, 1.0 / LENGTH], tubes)
        self.weights = usual if weights is None else array(weights, "weights", (2 * tubes,), above=0.0)
        self._allowed = Allowed.of(robot, self.limits)
        self.home = self._home_of(home)
        self._starts = Starts(self.forward, self._allowed, joints_of(self.home))
        if self.forward.compiles:  # some tenths of a second; else seconds, which are spent where they are needed
            _ = self._starts.table

    def solve(
        self,
        target_position: Any = None,
        loads: Sequence[Load] = (),
        initial: Equilibrium | None = None,
        *,
        target_axis: Any = None,
        target_pose: Any = None,
    ) -> InverseKinematicsResult:
        """Find an actuation for one target.

        Parameters
        ----------
        target_position
            Where the tip shall be, ``(3,)``, m, world frame; a pose ``(4, 4)`` counts as ``target_pose``.
        loads
            The loads under which it shall be there.
        initial
            The current shape, under these loads or others: where the search begins, and what is near; default: home.
        target_axis
            With a position: the direction of the tip's axis, ``(3,)``, of any length.
        target_pose
            Instead: the pose of the tip, ``(4, 4)``, of the innermost tube that ends there.

        Raises
        ------
        DefinitionError
            A target of the wrong shape, an ``initial`` outside the limits, a load that finds no place, and the like.
        SolveError
            No start has a stable equilibrium under these loads.
        """
        target = Target.of(target_position, target_axis, target_pose)
        return self._solved(target, as_loads(loads), None if initial is None else self._checked(initial))

    def solve_path(
        self,
        targets: Any,
        loads: Sequence[Any] = (),
        initial: Equilibrium | None = None,
        *,
        axes: Any = None,
        longest_step: tuple[float, float] = (0.2, 5e-3),
        throw: bool = True,
    ) -> InverseKinematicsPath:
        """Follow a path of targets without a jump, through stable shapes only.

        Each answer is the nearest to the one before and on its branch along the straight way of the joints; where steps
        would be too long, targets are put in between.

        Parameters
        ----------
        targets
            Positions of the tip ``(k, 3)``, m, or poses ``(k, 4, 4)``.
        loads
            One list of loads for all targets, or a list of them for each: where it changes, the robot is first loaded
            as it stands.
        initial
            The current shape, from which the path leads to the first target. So is a path planned again when a load
            appears: from the current shape, with the new loads. Default: it begins at the first target, with the first
            of several answers there from which it leads to the last.
        axes
            With positions: the directions of the tip's axis, ``(k, 3)``.
        longest_step
            By how much a rotation, rad, and a translation, m, change at most from one answer to the next.
        throw
            Raise ``SolveError`` where the path breaks off; otherwise return what there is.

        Raises
        ------
        DefinitionError
            As :meth:`solve`.
        SolveError
            The path breaks off: where and why; ``.result`` is the path up to there.
        """
        places = targets_of(targets, axes)
        given = [entry if isinstance(entry, Load) else as_loads(entry) for entry in as_loads(loads)]
        searches = [self.search(*row) for row in zip(places, rows_of_loads(given, len(places)), strict=True)]
        longest = np.repeat(array(longest_step, "longest_step", (2,), above=0.0), len(self.robot.tubes))
        if initial is None:
            path = self._from_anywhere(searches, longest)
        else:
            path = Follower(longest).follow(searches, self._checked(initial))
        if throw and not path.converged:
            raise SolveError(path.message, path)
        return path

    def search(self, target: Target, loads: tuple[Load, ...]) -> TipSearch:
        """The way to a target, for code that takes it from a start of its own."""
        allowed = Allowed.of(self.robot, self.limits, loads) if loads else self._allowed
        return TipSearch(self.forward, loads, allowed, self.weights, target, self.tolerances)

    # -- internals -------------------------------------------------------------------------------------------------

    def _solved(self, target: Target, loads: tuple[Load, ...], initial: Equilibrium | None) -> InverseKinematicsResult:
        begin = perf_counter()
        reference = joints_of(self.home if initial is None else initial.actuation)
        search = self.search(target, loads)
        ends: list[Point] = []
        for start in self._starts.points(search, initial, reference, self.starts):
            ends.append(search.reach(start))
            if self.criterion == "nearest" and ends[-1].answers:
                break
        point = best(search, ends, self.criterion, reference)
        seconds = perf_counter() - begin
        return InverseKinematicsResult.of(search, point, reference, starts=len(ends), solve_time=seconds)

    def _from_anywhere(self, searches: list[TipSearch], longest: Array) -> InverseKinematicsPath:
        """A path that begins at its first target, with the answer from which it leads to the last, or furthest."""
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
        return furthest or Follower(longest).broken(0, "it is reached from no start")

    def _home_of(self, given: Actuation | None) -> Actuation:
        tubes = len(self.robot.tubes)
        if given is None:
            middle = [-0.5 * tube.length for tube in self.robot.tubes]
            joints = self._allowed.nearest(np.concatenate((np.zeros(tubes), middle)), self.weights)
            return actuation_of(joints)
        if not isinstance(given, Actuation) or len(given.rotations) != tubes:
            raise DefinitionError(f"home = {given!r} must be an Actuation of {tubes} tubes")
        self._check_limits(given, "home")
        return given

    def _checked(self, initial: Equilibrium) -> Equilibrium:
        if not isinstance(initial, Equilibrium) or not initial.converged or initial.robot != self.robot:
            raise DefinitionError(f"initial = {initial!r} must be a solved Equilibrium of this problem's robot")
        self._check_limits(initial.actuation, "initial")
        return initial

    def _check_limits(self, actuation: Actuation, field: str) -> None:
        exceeded = self._allowed.exceeded(joints_of(actuation))
        if exceeded:
            raise DefinitionError(f"{field} = {actuation!r} exceeds the limits: {'; '.join(exceeded)}")


def _forward(robot: Robot, tolerance: float, compiled: bool | None) -> ForwardProblem:
    """Forward solves that are accurate enough, compiled where that is wanted and possible."""
    if not isinstance(robot, Robot):
        raise DefinitionError(f"robot = {robot!r} must be a Robot")
    relative = _FORWARD * tolerance / max(tube.length for tube in robot.tubes)
    forward = ForwardProblem(robot, tolerance=min(_LEAST_FORWARD, relative), compiled=compiled)
    if compiled is None:
        with suppress(CompilationError):
            forward.compile()
    return forward
