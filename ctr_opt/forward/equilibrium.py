"""The result of a forward solve: the robot's shape, its internal loads, and how well they are known."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import attrs
import numpy as np

from ..checks import Array, index
from ..errors import DefinitionError, SolveError
from ..layout.configuration import Configuration, Scales
from ..loads.kind import Load
from ..mechanics.law import transmission_energy
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from ..solvers.status import SolveStatus
from ..transcription.shape import Shape, Values
from ..transcription.shooting import Shooting
from ..transcription.stability import SecondVariation
from ..transcription.verification import defect
from .attempt import Attempt, path_of
from .derivatives import Differentiable
from .sensitivity import Solved

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_DISPLAY_STEPS = 100  # `arc_length` has at least so many steps


@attrs.frozen(eq=False)
class BaseMoments:
    """The unknowns of a shooting problem: what the robot exerts on the entry point.

    ``bending (2,)``, N m: total bending moment at ``s = 0`` in the backbone frame; ``torsional (tubes,)``, N m: each
    tube's torsional moment at its base; ``force (3,)``, N: what loads that depend on the shape add to the internal
    force ``n(0)`` of the dead ones, zero without such loads.
    """

    bending: Array
    torsional: Array
    force: Array = attrs.field(factory=lambda: np.zeros(3))

    @property
    def vector(self) -> Array:
        """The moments as one vector, N m."""
        return np.concatenate((self.bending, self.torsional))

    @classmethod
    def of(cls, unknowns: Array, scales: Scales, tubes: int) -> BaseMoments:
        """From dimensionless unknowns, with or without a force."""
        moments = unknowns[: 2 + tubes] * scales.moment
        force = unknowns[2 + tubes :] * scales.force if len(unknowns) > 2 + tubes else np.zeros(3)
        for values in (moments, force):
            values.setflags(write=False)
        return cls(moments[:2], moments[2:], force)

    def unknowns(self, scales: Scales, live: bool) -> Array:
        """As dimensionless unknowns, with a force where loads are ``live``."""
        moments = np.concatenate((self.bending, self.torsional)) / scales.moment
        return np.concatenate((moments, self.force / scales.force)) if live else moments


@attrs.frozen(eq=False)
class Outcome:
    """How a solve went.

    Attributes
    ----------
    status, attempts, message
        How it ended, what was tried, and what went wrong.
    reached
        How far the last continuation came: 1 at the end.
    setup_time, solve_time
        Seconds.
    residual_norm
        Largest entry of the scaled boundary residual.
    discretization_error
        Estimated largest position error along the backbone, m.
    """

    status: SolveStatus
    attempts: tuple[Attempt, ...]
    message: str = ""
    reached: float = 1.0
    setup_time: float = 0.0
    solve_time: float = 0.0
    residual_norm: float = np.inf
    discretization_error: float = np.inf
    jacobian: Array | None = None

    @property
    def path(self) -> str:
        """The attempts in words."""
        return path_of(self.attempts)

    @property
    def iterations(self) -> int:
        """Newton and IPOPT iterations together."""
        return sum(attempt.iterations for attempt in self.attempts)


class Equilibrium(Differentiable):
    """A shape of the robot in equilibrium, or the record of a solve that found none.

    Where a value jumps it is the limit from the right; at a tube's end and at ``length``, from the left. A scalar
    ``s`` gives one value, ``s (k,)`` adds a leading axis. Outside the tube asked for: ``DefinitionError``. The
    shape of a solve that failed raises ``SolveError``.
    """

    def __init__(
        self,
        configuration: Configuration,
        base: BaseMoments,
        outcome: Outcome,
        shape: Shape | None = None,
        last: Equilibrium | None = None,
    ) -> None:
        self._configuration = configuration
        self._base = base
        self._outcome = outcome
        self._solved_shape = shape
        self._last = last

    # -- how it went ---------------------------------------------------------------------------------------------

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self._configuration.robot

    @property
    def actuation(self) -> Actuation:
        """Its actuation."""
        return self._configuration.actuation

    @property
    def loads(self) -> tuple[Load, ...]:
        """The loads on it."""
        return self._configuration.loads

    @property
    def status(self) -> SolveStatus:
        """How the solve ended."""
        return self._outcome.status

    @property
    def converged(self) -> bool:
        """Whether this is an equilibrium."""
        return self.status is SolveStatus.CONVERGED

    @property
    def path(self) -> str:
        """How the solve got here, the methods in their order."""
        return self._outcome.path

    @property
    def message(self) -> str:
        """What was tried and how far it got, if it failed."""
        return self._outcome.message

    @property
    def reached(self) -> float:
        """The continuation parameter where the last continuation ended, 1 where it was completed."""
        return self._outcome.reached

    @property
    def iterations(self) -> int:
        """Newton and IPOPT iterations together."""
        return self._outcome.iterations

    @property
    def setup_time(self) -> float:
        """Seconds spent on building functions and data."""
        return self._outcome.setup_time

    @property
    def solve_time(self) -> float:
        """Seconds spent on solving."""
        return self._outcome.solve_time

    @property
    def residual_norm(self) -> float:
        """Largest entry of the boundary residual; moments over ``max(EI) / length``."""
        return self._outcome.residual_norm

    @property
    def discretization_error(self) -> float:
        """Estimated position error, m, the largest along the backbone.

        Twice the distance to a solve with half the steps' length (for answers of IPOPT, to first order), rounding
        included.
        """
        return self._outcome.discretization_error

    @property
    def unstable_directions(self) -> int | None:
        """How many independent variations of the shape lower the potential energy, to second order.

        The number of negative eigenvalues of the second variation with the tubes' bases held, each counted as often as
        it occurs. None where it is not defined, as a load has no potential (an applied moment, a load in a tube's
        frame, an expression), and for a solve that failed.

        Examples
        --------
        A straight column beyond Euler's load may give way in two planes:

        >>> import numpy as np, ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 2e-3, 0.0, ctr.Straight(0.1), bending_stiffness=0.02, torsional_stiffness=0.015)
        >>> problem, held = ctr.ForwardProblem(ctr.Robot([tube])), ctr.Actuation([0.0], [0.0])
        >>> push = [ctr.PointWrench(force=[0.0, 0.0, -1.5 * np.pi**2 / 4 * 0.02 / 0.1**2])]
        >>> column = problem.solve(held, push, initial=problem.guess(held, push))
        >>> column.unstable_directions, column.is_stable
        (2, False)
        """
        found = self._second_variation
        return None if found is None else found.negative

    @property
    def is_stable(self) -> bool | None:
        """Whether the potential energy has a minimum here: its second variation is positive.

        False at saddles, and where it is zero, but for rounding, in some direction: at a fold, and in a family of
        equilibria (a straight rod that buckled may lie in any plane), which has no ``unstable_directions`` either. None
        where those are None.
        """
        found = self._second_variation
        return None if found is None else found.positive

    @property
    def stability(self) -> float | None:
        """How far the shape is from instability: the smallest eigenvalue of (second variation, elastic part).

        What part of the tubes' stiffness might be lost before the shape gives way, other things held: from 1, where no
        load or precurvature pushes it over, to 0 at a fold; to a thousandth. 0 where it is not stable, None where that
        is not defined.

        Examples
        --------
        A column under a fifth of Euler's load:

        >>> import numpy as np, ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 2e-3, 0.0, ctr.Straight(0.1), bending_stiffness=0.02, torsional_stiffness=0.015)
        >>> push = [ctr.PointWrench(force=[0.0, 0.0, -0.2 * np.pi**2 / 4 * 0.02 / 0.1**2])]
        >>> shape = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [0.0]), push)
        >>> round(shape.stability, 2)
        0.8
        """
        stable = self.is_stable
        return self.shape.smallest_eigenvalue if stable else None if stable is None else 0.0

    @property
    def _second_variation(self) -> SecondVariation | None:
        return None if self._solved_shape is None else self._solved_shape.second_variation

    @property
    def stability_checked(self) -> bool:
        """Whether this equilibrium is *known* to be stable: :attr:`is_stable` is True, not False or None."""
        return self.is_stable is True

    @property
    def determinant(self) -> float:
        """Determinant of :attr:`shooting_jacobian`; changes sign at a fold."""
        return float(np.linalg.det(self.shooting_jacobian)) if self.shooting_jacobian is not None else float("nan")

    @property
    def shooting_jacobian(self) -> Array | None:
        """``d(m_xy, tau)(length) / d(m_xy, tau)(0)`` at the solution, dimensionless; None if there is none.

        Under loads that depend on the shape, ``d(m_xy, tau, n)(length) / d(m_xy, tau, n)(0)``.
        """
        return self._outcome.jacobian

    @property
    def last_iterate(self) -> BaseMoments:
        """Moments (and force) at the base: of the solution, or where a failed solve ended, at ``reached``."""
        return self._base

    @property
    def last_equilibrium(self) -> Equilibrium | None:
        """The last equilibrium of this robot before a continuation failed, or the unstable one that was not accepted.

        Its loads and actuation tell where: on the way from ``initial``, or at the part of the loads that a cold start
        came to. None for a solve that converged, and where none is known.
        """
        return self._last

    # -- the shape -----------------------------------------------------------------------------------------------

    @property
    def configuration(self) -> Configuration:
        """Robot, actuation and loads as numbers along the arc length."""
        return self._configuration

    @property
    def shape(self) -> Shape:
        """The states behind the numbers, for code that works on this result."""
        if self._solved_shape is None:
            raise SolveError(f"there is no shape: {self.message or self.status.description}", self)
        return self._solved_shape

    @property
    def length(self) -> float:
        """Arc length from the entry point to the tip, m."""
        return self._configuration.length

    @cached_property
    def arc_length(self) -> Array:
        """Arc lengths, m, to draw or save the shape at: every break point, and at least 100 steps."""
        breaks = self._configuration.break_points
        spacing = self.length / _DISPLAY_STEPS
        parts = [
            np.linspace(a, b, max(1, int(np.ceil((b - a) / spacing))), endpoint=False) for a, b in pairwise(breaks)
        ]
        grid = np.concatenate((*parts, [self.length]))
        grid.setflags(write=False)
        return grid

    @property
    def one_sided(self) -> bool:
        """Whether it is known that break points coincide, where :meth:`jacobian` has sides and takes long."""
        return False

    @property
    def tip_position(self) -> Array:
        """Position at ``s = length``, m, world frame."""
        return self.position(self.length)

    @property
    def tip_pose(self) -> Array:
        """``pose(length)``: the tip's frame in the world, 4 x 4."""
        return self.pose(self.length)

    def position(self, s: Any) -> Array:
        """Backbone position at ``s``, m, world frame."""
        return self._vectors(s, lambda at: at.state.position.T)

    def pose(self, s: Any, tube: int | None = None) -> Array:
        """Material frame of a tube, 4 x 4, z along the backbone; ``None``: the innermost tube present at ``s``."""
        i = None if tube is None else self._tube(tube)

        def poses(at: Values) -> Array:
            tubes = (
                self._configuration.ends.innermost_along(at.arc_length) if i is None else np.full(len(at.arc_length), i)
            )
            angles = at.state.angles[tubes, np.arange(len(tubes))]
            result = np.tile(np.eye(4), (len(tubes), 1, 1))
            result[:, :3, :3] = _rotations(at.state.orientation, angles)
            result[:, :3, 3] = at.state.position.T
            return result

        return self._vectors(s, poses, i)

    def curvature(self, s: Any) -> Array:
        """Backbone curvature ``(u_x, u_y, 0)``, 1/m, in the rotation-minimizing backbone frame."""
        return self._vectors(s, lambda at: np.pad(at.bent.T, ((0, 0), (0, 1))))

    def torsion(self, tube: int, s: Any) -> Any:
        """``u_i,z`` of a tube, 1/m."""
        i = self._tube(tube)
        return self._evaluate(s, lambda at: at.twisted[i], i)

    def tube_angle(self, tube: int, s: Any) -> Any:
        """``psi_i``, rad: the angle of a tube's material frame against the backbone frame."""
        i = self._tube(tube)
        return self._evaluate(s, lambda at: at.state.angles[i], i)

    def internal_force(self, s: Any) -> Array:
        """``n(s)``, N, world frame: what the material of ``[s, length]`` exerts on ``[0, s]``."""
        return self._vectors(s, lambda at: at.state.force.T)

    def internal_moment(self, s: Any) -> Array:
        """``m(s)``, N m, world frame: what the material of ``[s, length]`` exerts on ``[0, s]``."""

        def moments(at: Values) -> Array:
            own = np.vstack((at.state.bending, at.state.torsion.sum(axis=0)))
            frames = _rotations(at.state.orientation, np.zeros(own.shape[1]))
            return np.asarray(np.einsum("kij,jk->ki", frames, own))

        return self._vectors(s, moments)

    def tube_moment(self, tube: int, s: Any) -> Array:
        """Internal moment of one tube, N m, in its own material frame: ``K_i (u_i - u*_i)`` (paper, (3))."""
        i = self._tube(tube)
        return self._vectors(s, lambda at: at.tube_moments[i].T, i)

    # -- energies ------------------------------------------------------------------------------------------------

    @cached_property
    def energy(self) -> float:
        """Elastic energy, J.

        Of the tubes in ``[0, length]``, the transmissions' torsion, and curved parts held straight behind the entry.
        """
        twisted = float(transmission_energy(self._base.torsional, self._configuration.transmission_compliance).sum())
        return self.shape.elastic_energy + twisted + self._configuration.straightening_energy

    @cached_property
    def load_work(self) -> float:
        """Work of the conservative loads, J: less their potential.

        ``sum F . p + integral of f . p`` of the world-fixed forces, from the world's origin on, less ``V(p)`` of loads
        given by a potential. Moments, loads in a tube's frame and free expressions have no potential and are left out.
        """
        return self.shape.load_work

    @property
    def potential_energy(self) -> float:
        """``energy - load_work``, J: what a stable equilibrium under conservative loads minimizes."""
        return self.energy - self.load_work

    def timed(self, setup_time: float, solve_time: float) -> Equilibrium:
        """The same result with its times, s."""
        outcome = attrs.evolve(self._outcome, setup_time=setup_time, solve_time=solve_time)
        return Equilibrium(self._configuration, self._base, outcome, self._solved_shape, self._last)

    # -- checks and reports --------------------------------------------------------------------------------------

    def verify(self) -> float:
        """Check this shape with SciPy's adaptive DOP853 integrator (relative tolerance 1e-12).

        Returns
        -------
        float
            The defect, m: every step is integrated anew from where it begins, the gaps between the steps and what is
            left at the tip are closed by one Newton step, and this is the largest distance by which the shape then
            moves. Infinite where the integrator fails.
        """
        shape = self.shape
        scales = self._configuration.scales
        shooting = Shooting(self._configuration, shape.mesh, shape.integrator)
        z = self._base.unknowns(scales, self._configuration.kind.live)
        try:
            return scales.length * defect(shooting, z, shape)
        except ArithmeticError:
            return float("inf")

    def report(self) -> str:
        """What was solved, how, how well, and what came out."""
        from .report import equilibrium_report

        return equilibrium_report(self)

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw tubes, loads and tip frame into a 3-D axes (a new one by default) and return it."""
        from .plot import plot_equilibrium

        return plot_equilibrium(self, ax, **style)

    def __str__(self) -> str:
        return self.report()

    def __repr__(self) -> str:
        return f"<Equilibrium: {self.status.description}, length {self.length:g} m, path {self.path!r}>"

    def solved(self) -> Solved:
        """The solution in numbers, for code that works on this result."""
        own, shape = self._configuration, self.shape
        return Solved(own, self._base.unknowns(own.scales, own.kind.live), shape.mesh, shape.integrator)

    # -- internals -----------------------------------------------------------------------------------------------

    def _tube(self, tube: int) -> int:
        return index(tube, "tube", self._configuration.tube_count)

    def _vectors(self, s: Any, of: Callable[[Values], Array], tube: int | None = None) -> Array:
        return np.asarray(self._evaluate(s, of, tube))

    def _evaluate(self, s: Any, of: Callable[[Values], Array], tube: int | None = None) -> Any:
        """``of`` the values at ``s``, within the robot or within a tube."""
        try:
            points = np.asarray(s, dtype=np.float64)
        except (TypeError, ValueError):
            raise DefinitionError(f"s = {s!r} must be a number or a one-dimensional array of numbers, in m") from None
        if points.ndim > 1:
            raise DefinitionError(f"s has shape {points.shape}, but must be a number or one-dimensional")
        if points.size == 0:
            return self._evaluate(np.zeros(1), of, tube)[:0]
        shape, flat = self.shape, np.atleast_1d(points)
        if tube is None:
            flat = shape.inside(flat, self.length, "the robot")
            values = shape.at(flat)
        else:
            end = float(self._configuration.tube_ends[tube])
            flat = shape.inside(flat, end, f"tube {tube} ({self.robot.tubes[tube].name!r})")
            values = shape.at(flat, from_left=flat >= shape.inside(np.array([end]), self.length, "the robot"))
        result = np.asarray(of(values))
        if points.ndim == 0:
            return float(result[0]) if result.ndim == 1 else result[0]
        return result


def _rotations(quaternions: Array, angles: Array) -> Array:
    """``R(q) Rz(angle)``, ``(k, 3, 3)``, from quaternions ``(4, k)``."""
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0]))
    frames = Rotation.from_quat(np.roll(quaternions, -1, axis=0).T) * turns
    return np.asarray(frames.as_matrix())
