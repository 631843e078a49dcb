"""Inverse kinematics under known loads: actuations for a wanted position or pose of the tip."""

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

_FORWARD, _MOST_FORWARD = 0.1, 1e-7  # largest errors of the forward solves: over the tolerance, and over the length


class InverseKinematicsProblem:
    """Find actuations that bring a robot's tip to a position, a position and an axis, or a pose.

    Parameters
    ----------
    robot
        The robot.
    limits
        Limits of the joints. Default: any angle, translations from the place where 0.1 mm of a tube stand out to 0,
        bases and tips in the order of the tubes.
    home
        Actuation where searches begin without an ``initial`` shape. Default: no rotation and every tube half drawn
        back, or the nearest actuation within the limits.
    criterion
        Choice among several answers.

        - ``"nearest"``: the first answer found, then moved toward the start of the search in steps that keep the tip.
        - ``"distance"``: the answer of all ``starts`` with the least distance from the start of the search.
        - ``"torsion"``: the answer of all ``starts`` with the smallest torsional moment at a base, taking the largest
          over the tubes.
        - ``"stability"``: the answer of all ``starts`` with the largest stability, the smallest eigenvalue of the
          second variation of the potential energy relative to its elastic part. Stability counts as 0 under loads
          without a potential, where it is not defined.
    starts
        Largest number of shapes from which searches begin: the initial one, then random stable ones with the tip near.
    weights
        ``(2 tubes,)``: weights of a radian, then of a metre, of each joint in distances. Default: 1 and 50, so that a
        radian counts as much as 20 mm.
    tolerance, angle_tolerance
        Largest accepted distance of the tip, m, and angle of its axis or frame, rad. Forward solves are accurate to a
        tenth of ``tolerance``, but never worse than 1e-7 of the robot's length.
    compiled
        Default: compiled code where it applies and a compiler exists; it takes some seconds the first time on a
        machine. ``False``: CasADi's virtual machine, hundreds of times slower. ``True``: an error without a compiler.

    Raises
    ------
    DefinitionError
        An argument has the wrong type, shape or range, the limits contradict each other, or ``home`` exceeds them.
    CompilationError
        ``compiled=True`` and there is no compiler, or it fails.

    Notes
    -----
    Searches take damped Gauss-Newton steps within the limits, with the exact Jacobian. Each step is solved on the
    branch of the shape before it. Break points are sorted again in every solve. See
    ``docs/how_to/inverse_kinematics.md``.

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
        if self.forward.compiles:  # tenths of a second now; without compiled code seconds, spent only when needed
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
            Target position of the tip, ``(3,)``, m, world frame. A pose ``(4, 4)`` is taken as ``target_pose``.
        loads
            The loads on the robot at the target.
        initial
            The current shape, under these or other loads, where the search begins and from which distances count.
            Default: home.
        target_axis
            Direction of the tip's axis, ``(3,)``, of any length; only with a position.
        target_pose
            Target pose of the tip, ``(4, 4)``, instead of a position: the frame of the innermost tube that ends there.

        Returns
        -------
        InverseKinematicsResult
            The answer, or the nearest stable shape with the status ``UNREACHABLE``.

        Raises
        ------
        DefinitionError
            A target has the wrong shape, ``initial`` is outside the limits, a load lies beyond its tube, and the like.
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

        Each answer is the one nearest to the answer before it. It is on the same branch when the joints move straight
        between the two. Targets are inserted where steps would be too long.

        Parameters
        ----------
        targets
            Positions of the tip ``(k, 3)``, m, or poses ``(k, 4, 4)``.
        loads
            One list of loads for all targets, or a list of loads per target. Where the loads change, the robot is first
            loaded at its present actuation.
        initial
            The current shape, from which the path leads to the first target. To plan a path again when a load appears,
            give the current shape and the new loads. Default: the path begins at the first target, with the first of
            several answers there from which it leads to the last target.
        axes
            Directions of the tip's axis, ``(k, 3)``; only with positions.
        longest_step
            Largest change of a rotation, rad, and of a translation, m, from one answer to the next.
        throw
            Raise ``SolveError`` if the path breaks off; otherwise return the path up to there.

        Raises
        ------
        DefinitionError
            As :meth:`solve`.
        SolveError
            The path breaks off. The message says where and why; ``.result`` is the path up to there.
        """
        places = targets_of(targets, axes)
        rows = [entry if isinstance(entry, Load) else as_loads(entry) for entry in as_loads(loads)]
        searches = [self.search(*row) for row in zip(places, rows_of_loads(rows, len(places)), strict=True)]
        longest = np.repeat(array(longest_step, "longest_step", (2,), above=0.0), len(self.robot.tubes))
        if initial is None:
            path = self._from_anywhere(searches, longest)
        else:
            path = Follower(longest).follow(searches, self._checked(initial))
        if throw and not path.converged:
            raise SolveError(path.message, path)
        return path

    def search(self, target: Target, loads: tuple[Load, ...]) -> TipSearch:
        """Prepare the search for one target, for code that chooses its own start.

        Parameters
        ----------
        target
            The target.
        loads
            The loads on the robot at the target.
        """
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
            joints = self._allowed.nearest(np.concatenate((np.zeros(tubes), middle)), self.weights)
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
        exceeded = self._allowed.exceeded(joints_of(actuation))
        if exceeded:
            raise DefinitionError(f"{field} = {actuation!r} exceeds the limits: {'; '.join(exceeded)}")


def _forward(robot: Robot, tolerance: float, compiled: bool | None) -> ForwardProblem:
    """Make the forward problem with sufficient accuracy, compiled if wanted and possible."""
    if not isinstance(robot, Robot):
        raise DefinitionError(f"robot = {robot!r} must be a Robot")
    relative = _FORWARD * tolerance / max(tube.length for tube in robot.tubes)
    forward = ForwardProblem(robot, tolerance=min(_MOST_FORWARD, relative), compiled=compiled)
    if compiled is None:
        with suppress(CompilationError):
            forward.compile()
    return forward
