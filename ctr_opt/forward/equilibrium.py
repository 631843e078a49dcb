"""The result of a forward solve: the robot's shape, internal loads, their derivatives, and how well they are known."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..checks import Array, index
from ..errors import SolveError
from ..layout.configuration import Configuration
from ..loads.kind import Load
from ..mechanics.law import transmission_energy
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from ..solvers.status import SolveStatus
from ..transcription.shape import Shape
from ..transcription.verification import defect
from . import derivatives
from .compiled import Record
from .plot import plot_equilibrium
from .record import BaseMoments
from .report import equilibrium_report
from .sensitivity import Solved
from .values import grid, moments, of_tube, poses, vectors

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Equilibrium:
    """A shape of the robot in equilibrium, or the record of a solve that found none.

    Where a value jumps it is the limit from the right; at a tube's end and at ``length``, from the left. A scalar
    ``s`` gives one value, ``s (k,)`` adds a leading axis. Outside the tube asked for: ``DefinitionError``. The
    shape of a solve that failed raises ``SolveError``.

    Derivatives are exact except for the error of the solution itself: they follow from the implicit-function theorem
    (``docs/how_to/derivatives.md``). Where break points coincide, or one stands at the entry point, those that move
    them apart are one-sided: ``side = +1`` is the derivative for a growing parameter (an advancing tube), ``-1`` that
    for a shrinking one. :attr:`kinks` lists the tubes that stand so.
    """

    def __init__(self, record: Record, last: Equilibrium | None = None) -> None:
        self.record = record
        self._last = last

    # -- how it went ---------------------------------------------------------------------------------------------

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.record.robot

    @property
    def actuation(self) -> Actuation:
        """Its actuation."""
        return self.record.actuation

    @property
    def loads(self) -> tuple[Load, ...]:
        """The loads on it."""
        return self.record.loads

    @property
    def status(self) -> SolveStatus:
        """How the solve ended."""
        return self.record.status

    @property
    def converged(self) -> bool:
        """Whether this is an equilibrium."""
        return self.status is SolveStatus.CONVERGED

    @property
    def path(self) -> str:
        """How the solve got here, the methods in their order."""
        return self.record.outcome.path

    @property
    def message(self) -> str:
        """What was tried and how far it got, if it failed."""
        return self.record.outcome.message

    @property
    def reached(self) -> float:
        """The continuation parameter where the last continuation ended, 1 where it was completed."""
        return self.record.outcome.reached

    @property
    def iterations(self) -> int:
        """Newton and IPOPT iterations together."""
        return self.record.outcome.iterations

    @property
    def setup_time(self) -> float:
        """Seconds spent on building functions and data."""
        return self.record.outcome.setup_time

    @property
    def solve_time(self) -> float:
        """Seconds spent on solving."""
        return self.record.outcome.solve_time

    @property
    def residual_norm(self) -> float:
        """Largest entry of the boundary residual; moments over ``max(EI) / length``."""
        return self.record.outcome.residual_norm

    @property
    def discretization_error(self) -> float:
        """Estimated position error, m, the largest along the backbone.

        Twice the distance to a solve with half the steps' length (for answers of IPOPT, to first order), rounding
        included.
        """
        return self.record.outcome.discretization_error

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
        found = self.record.second_variation
        return None if found is None else found.negative

    @property
    def is_stable(self) -> bool | None:
        """Whether the potential energy has a minimum here: its second variation is positive.

        False at saddles, and where it is zero, but for rounding, in some direction: at a fold, and in a family of
        equilibria (a straight rod that buckled may lie in any plane), which has no ``unstable_directions`` either. None
        where those are None.
        """
        found = self.record.second_variation
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
        return self.record.outcome.jacobian

    @property
    def last_iterate(self) -> BaseMoments:
        """Moments (and force) at the base: of the solution, or where a failed solve ended, at ``reached``."""
        return self.record.base

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
        return self.record.configuration

    @property
    def shape(self) -> Shape:
        """The states behind the numbers, for code that works on this result."""
        shape = self.record.shape
        if shape is None:
            raise self._no_shape()
        return shape

    @property
    def length(self) -> float:
        """Arc length from the entry point to the tip, m."""
        return self.record.length

    @cached_property
    def arc_length(self) -> Array:
        """Arc lengths, m, to draw or save the shape at: every break point, and at least 100 steps."""
        return grid(self.configuration)

    @property
    def one_sided(self) -> bool:
        """Whether it is known that break points coincide, where :meth:`jacobian` has sides and takes long."""
        return self.record.one_sided

    @property
    def tip_position(self) -> Array:
        """Position at ``s = length``, m, world frame."""
        at_hand = self.record.tip_position
        return self.position(self.length) if at_hand is None else at_hand

    @property
    def tip_pose(self) -> Array:
        """``pose(length)``: the tip's frame in the world, 4 x 4."""
        at_hand = self.record.tip_pose
        return self.pose(self.length) if at_hand is None else at_hand

    def position(self, s: Any) -> Array:
        """Backbone position at ``s``, m, world frame."""
        return vectors(self.shape, s, lambda at: at.state.position.T)

    def pose(self, s: Any, tube: int | None = None) -> Array:
        """Material frame of a tube, 4 x 4, z along the backbone; ``None``: the innermost tube present at ``s``."""
        return poses(self.shape, s, tube)

    def curvature(self, s: Any) -> Array:
        """Backbone curvature ``(u_x, u_y, 0)``, 1/m, in the rotation-minimizing backbone frame."""
        return vectors(self.shape, s, lambda at: np.pad(at.bent.T, ((0, 0), (0, 1))))

    def torsion(self, tube: int, s: Any) -> Any:
        """``u_i,z`` of a tube, 1/m."""
        return of_tube(self.shape, tube, s, lambda at, i: at.twisted[i])

    def tube_angle(self, tube: int, s: Any) -> Any:
        """``psi_i``, rad: the angle of a tube's material frame against the backbone frame."""
        return of_tube(self.shape, tube, s, lambda at, i: at.state.angles[i])

    def internal_force(self, s: Any) -> Array:
        """``n(s)``, N, world frame: what the material of ``[s, length]`` exerts on ``[0, s]``."""
        return vectors(self.shape, s, lambda at: at.state.force.T)

    def internal_moment(self, s: Any) -> Array:
        """``m(s)``, N m, world frame: what the material of ``[s, length]`` exerts on ``[0, s]``."""
        return vectors(self.shape, s, moments)

    def tube_moment(self, tube: int, s: Any) -> Array:
        """Internal moment of one tube, N m, in its own material frame: ``K_i (u_i - u*_i)`` (paper, (3))."""
        return np.asarray(of_tube(self.shape, tube, s, lambda at, i: at.tube_moments[i].T))

    @cached_property
    def base_wrench(self) -> Array:
        """Force, N, and moment about the entry point, N m, of the robot on its support, ``(6,)``, world frame.

        The resultant of all loads in front of the entry point, those there included: what a six-axis sensor under the
        robot shows. Actuators rest on it too, so that their forces and torques do not.

        Examples
        --------
        >>> import ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)
        >>> twist = ctr.PointWrench(moment=[0.0, 0.0, 1e-3])
        >>> shape = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [-0.02]), [twist])
        >>> shape.base_wrench.round(9).tolist()
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.001]
        """
        return derivatives.base_wrench(self.solved())

    # -- energies ------------------------------------------------------------------------------------------------

    @cached_property
    def energy(self) -> float:
        """Elastic energy, J.

        Of the tubes in ``[0, length]``, the transmissions' torsion, and curved parts held straight behind the entry.
        """
        own = self.configuration
        twisted = float(transmission_energy(self.last_iterate.torsional, own.transmission_compliance).sum())
        return self.shape.elastic_energy + twisted + own.straightening_energy

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

    # -- derivatives ---------------------------------------------------------------------------------------------

    def jacobian(self, s: float | None = None, side: int = 1) -> Array:
        """Derivative of the pose by rotations, then translations, ``(6, 2 tubes)``.

        Rows: position (m, world axes), and world angular velocity ``w`` with ``dR = hat(w) R`` of the material frame
        of the innermost tube present.

        Parameters
        ----------
        s
            A fixed arc length, m; ``None``: the tip, which moves with the tube that ends there.
        side
            ``+1``: for advancing tubes, ``-1``: for tubes drawn back. They differ for the tubes in :attr:`kinks`
            alone. A base that stands at the entry point cannot advance: its derivative is always that from behind.

        Examples
        --------
        >>> import ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)
        >>> shape = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [-0.02]))
        >>> shape.jacobian()[2].round(9).tolist()
        [0.0, 1.0]
        """
        at_hand = self.record.tip_rates() if s is None and side in (1, -1) else None
        return derivatives.jacobian(self.solved(), s, side) if at_hand is None else at_hand[0]

    def compliance(self, s: float | None = None, load_at: float | None = None, tube: int = 0) -> Array:
        """Derivative of the pose by a world-fixed force (N) and moment (N m) added at a point, ``(6, 6)``.

        Rows as in :meth:`jacobian`. Under conservative loads it is symmetric where pose and load are at the same
        point of the same tube.

        Parameters
        ----------
        s
            Where the pose is taken, m: that of ``tube`` where it reaches so far, else of the innermost tube present;
            ``None``: the tip.
        load_at, tube
            Where the load acts, m, and on which tube; ``None``: at that tube's distal end, as in
            :class:`~ctr_opt.PointWrench`.

        Examples
        --------
        >>> import ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)
        >>> shape = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [0.0]))
        >>> bool(abs(shape.compliance()[0, 0] - 0.1**3 / (3.0 * tube.bending_stiffness)) < 1e-12)
        True
        """
        carrier = index(tube, "tube", len(self.robot.tubes))
        at_hand = self.record.tip_rates(carrier) if s is load_at is None else None
        return derivatives.compliance(self.solved(), s, load_at, carrier) if at_hand is None else at_hand[1]

    def sensitivity(self, of: Any, wrt: str | Sequence[str], order: int = 1, side: int = 1) -> Array:
        """Derivative of an output by parameters.

        Parameters
        ----------
        of
            An attribute's name, ``"tip_position"``, ``"tip_pose"``, ``"energy"``, ``"load_work"``,
            ``"potential_energy"``; or a method's name and its arguments, ``("position", s)``, ``("pose", s)``,
            ``("pose", s, tube)``, ``("curvature", s)``, ``("internal_force", s)``, ``("internal_moment", s)``,
            ``("torsion", tube, s)``, ``("tube_angle", tube, s)``, ``("tube_moment", tube, s)``,
            ``("actuator_wrench", tube)``. ``s`` stays fixed, the tip moves. A pose stands for six numbers, as in
            :meth:`jacobian`; an actuator wrench for force and torque.
        wrt
            A parameter's name, or several: ``"rotations"``, ``"translations"``, ``"tubes[0].bending_stiffness"``,
            ``"tubes[0].precurvature[1].curvature"``, ``"loads[0].force"``, ``"base.rotation"``; a wrong name's error
            lists all there are, and see ``docs/how_to/derivatives.md``.
        order
            1 or 2. Second derivatives of a rotation are those of the rotation vector from the pose as it is.
        side
            From which side, where break points coincide.

        Returns
        -------
        Array
            The output's shape, then the parameter's (then, for ``order = 2``, the parameter's once more); with
            several parameters their numbers stand on one axis, one parameter behind the other.

        Raises
        ------
        DefinitionError
            A name that is not there; a parameter that does not act, and why; a load given as a python function where
            its derivative by ``s`` is needed; second derivatives where break points coincide.
        SolveError
            A singular equilibrium: at a fold, or one of a family.

        Examples
        --------
        >>> import ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 5.0), youngs_modulus=60e9, poisson_ratio=0.3)
        >>> shape = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [0.0]))
        >>> shape.sensitivity("tip_position", "tubes[0].precurvature[0].curvature").shape
        (3, 3)
        """
        return derivatives.sensitivity(self.solved(), of, wrt, order, side)

    def actuator_wrench(self, tube: int, side: int = 1) -> tuple[float, float]:
        """Force (N) and torque (N m) that the actuator exerts on a tube's base, along +z of the entry frame.

        The torque is ``-tau_i(0)``. The force is what virtual work demands when the base is pushed by ``dbeta`` and
        the loads do their work: the elastic energy gained less the work ``F . dp + M . dphi`` of every load at the
        point where it acts (a fixed arc length, or a tube's end), over ``dbeta``. Where an interval of conservative
        load grows with the tube, the potential of what is added counts too, that of a potential's load and of
        world-fixed forces from the world's origin, so that under conservative loads the two are the derivatives of
        :attr:`potential_energy` by translation and rotation. Friction is none.

        It is computed from the shape alone: jumps of ``H = m_xy . u_xy + sum tau_i u_i,z + n . R e3 - W - V`` at the
        tube's break points, the integral of ``m_i . du*_i/ds`` where its curvature varies, and ``H`` of the tube alone
        right behind the entry point.

        Parameters
        ----------
        tube
            Index of the tube, 0 the innermost.
        side
            Where break points coincide: the force against advancing (``+1``) or against drawing back.

        Examples
        --------
        >>> import ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)
        >>> push = ctr.PointWrench(force=[0.0, 0.0, -0.5])
        >>> shape = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [-0.02]), [push])
        >>> round(shape.actuator_wrench(0)[0], 9)
        0.5
        """
        return derivatives.actuator_wrench(self.solved(), tube, side)

    @property
    def unknowns(self) -> Array:
        """Bending and torsional moments (N m) at the base and, where loads depend on the shape, their force (N).

        In the order in which :meth:`ForwardProblem.function <ctr_opt.ForwardProblem.function>` takes and returns them.
        """
        if not self.converged:
            raise self._no_shape()
        return self.record.unknowns

    @property
    def kinks(self) -> tuple[int, ...]:
        """The tubes whose derivative by translation differs between an advancing and a retreating tube.

        One of their break points coincides with the entry point, a load's, or another tube's, and something jumps
        there. A base at the entry point, where no tube can advance, is no kink.
        """
        return derivatives.kinks(self.solved())

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
        return defect(self.shape, self.solved().z)

    def report(self) -> str:
        """What was solved, how, how well, and what came out."""
        return equilibrium_report(self)

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw tubes, loads and tip frame into a 3-D axes (a new one by default) and return it."""
        return plot_equilibrium(self, ax, **style)

    def __str__(self) -> str:
        return self.report()

    def __repr__(self) -> str:
        return f"<Equilibrium: {self.status.description}, length {self.length:g} m, path {self.path!r}>"

    def solved(self) -> Solved:
        """The solution in numbers, for code that works on this result."""
        own, shape = self.configuration, self.shape
        return Solved(own, self.last_iterate.unknowns(own.scales, own.kind.live), shape.mesh, shape.integrator)

    # -- internals -----------------------------------------------------------------------------------------------

    def _no_shape(self) -> SolveError:
        return SolveError(f"there is no shape: {self.message or self.status.description}", self)
