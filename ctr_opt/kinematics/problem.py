"""Inverse kinematics under known loads: actuations for a wanted position or pose of the tip."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from ..checks import choice, flag, number, whole
from ..errors import CompilationError, DefinitionError
from ..forward.equilibrium import Equilibrium
from ..forward.problem import ForwardProblem
from ..forward.solver import as_loads
from ..loads.kind import Load
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from .limits import JointLimits
from .path import targets_of
from .result import CRITERIA, InverseKinematicsPath, InverseKinematicsResult
from .search import TipSearch
from .solver import InverseSolver
from .targets import Target

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
        accepted = number(tolerance, "tolerance", least=1e-9, most=1e-2, unit="m")
        self.tolerances = accepted, number(angle_tolerance, "angle_tolerance", least=1e-8, most=1.0, unit="rad")
        self.criterion = choice(criterion, "criterion", tuple(CRITERIA))
        self.starts = whole(starts, "starts", 1)
        wanted = compiled if compiled is None else flag(compiled, "compiled")
        self.forward = _forward(robot, accepted, wanted)
        self._solver = InverseSolver(
            self.forward, limits, home, weights, self.tolerances, criterion=self.criterion, starts=self.starts
        )
        self.robot, self.limits = robot, self._solver.limits
        self.weights, self.home = self._solver.weights, self._solver.home

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
        return self._solver.solve(Target.of(target_position, target_axis, target_pose), as_loads(loads), initial)

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
        return self._solver.follow(targets_of(targets, axes), loads, initial, longest_step, throw)

    def search(self, target: Target, loads: tuple[Load, ...]) -> TipSearch:
        """Prepare the search for one target, for code that chooses its own start.

        Parameters
        ----------
        target
            The target.
        loads
            The loads on the robot at the target.
        """
        return self._solver.search(target, loads)


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
