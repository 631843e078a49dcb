"""The result of a forward solve: shape, internal loads, derivatives and error estimates."""

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
from .sample import Sample, sample
from .sensitivity import Solved
from .values import grid, moments, of_tube, poses, vectors

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Equilibrium:
    """A shape of the robot in equilibrium, or the record of a failed solve.

    A scalar ``s`` gives one value; ``s (k,)`` adds a leading axis. Where a value jumps, it is the limit from the right;
    at a tube's end and at ``length``, from the left. An ``s`` outside the robot or the given tube raises
    ``DefinitionError``. The shape of a failed solve raises ``SolveError``.

    Derivatives are exact except for the error of the solution itself. They follow from the implicit-function theorem
    (``docs/how_to/derivatives.md``). Where break points coincide, or one is at the entry point, derivatives by
    parameters that separate them are one-sided. ``side = +1`` is the derivative for a growing parameter (an advancing
    tube), ``side = -1`` for a shrinking one. :attr:`kinks` lists the tubes concerned.
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
        """The actuation."""
        return self.record.actuation

    @property
    def loads(self) -> tuple[Load, ...]:
        """The loads on the robot."""
        return self.record.loads

    @property
    def status(self) -> SolveStatus:
        """The status with which the solve ended."""
        return self.record.status

    @property
    def converged(self) -> bool:
        """Whether the solve found an equilibrium."""
        return self.status is SolveStatus.CONVERGED

    @property
    def path(self) -> str:
        """The methods that the solve tried, in their order."""
        return self.record.outcome.path

    @property
    def message(self) -> str:
        """Message of a failed solve: what was tried and how far it got; empty if the solve converged."""
        return self.record.outcome.message

    @property
    def reached(self) -> float:
        """The continuation parameter where the last continuation ended; 1 if it was completed."""
        return self.record.outcome.reached

    @property
    def iterations(self) -> int:
        """Total number of Newton and IPOPT iterations."""
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
        """Largest entry of the boundary residual, dimensionless; moments are divided by ``max(EI) / length``."""
        return self.record.outcome.residual_norm

    @property
    def discretization_error(self) -> float:
        """Estimated largest position error along the backbone, m, rounding included.

        It is twice the distance to a solve with half the step length (for answers of IPOPT, to first order).
        """
        return self.record.outcome.discretization_error

    @property
    def unstable_directions(self) -> int | None:
        """Number of independent variations of the shape that lower the potential energy, to second order.

        It counts the negative eigenvalues of the second variation with the tubes' bases held, with multiplicity. It is
        None if a load has no potential (an applied moment, a load in a tube's frame, an expression) and after a failed
        solve.

        Examples
        --------
        A straight column beyond Euler's load can buckle in two planes:

        >>> import numpy as np, ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 2e-3, 0.0, ctr.Straight(0.1), bending_stiffness=0.02, torsional_stiffness=0.015)
        >>> problem, held = ctr.ForwardProblem(ctr.Robot([tube])), ctr.Actuation([0.0], [0.0])
        >>> push = [ctr.PointWrench(force=[0.0, 0.0, -1.5 * np.pi**2 / 4 * 0.02 / 0.1**2])]
        >>> column = problem.solve(held, push, initial=problem.guess(held, push))
        >>> column.unstable_directions, column.is_stable
        (2, False)
        """
        variation = self.record.second_variation
        return None if variation is None else variation.negative

    @property
    def is_stable(self) -> bool | None:
        """Whether the potential energy has a minimum here, that is, a positive second variation.

        False at saddles. False also if the second variation vanishes in some direction, up to rounding: at a fold, and
        in a family of equilibria (a buckled straight rod may lie in any plane). None if :attr:`unstable_directions` is
        None.
        """
        variation = self.record.second_variation
        return None if variation is None else variation.positive

    @property
    def stability(self) -> float | None:
        """Distance from instability, from 0 to 1: the smallest eigenvalue of (second variation, elastic part).

        It is the fraction of the tubes' stiffness that could be lost before the shape becomes unstable, all else
        unchanged. It is 1 if no load or precurvature destabilizes the shape, 0 at a fold or an unstable shape, and None
        if stability is not defined. The resolution is 0.001.

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
        """Determinant of :attr:`shooting_jacobian`, which changes sign at a fold."""
        return float(np.linalg.det(self.shooting_jacobian)) if self.shooting_jacobian is not None else float("nan")

    @property
    def shooting_jacobian(self) -> Array | None:
        """Derivative of the tip's moments by those at the base, dimensionless; None after a failed solve.

        ``d(m_xy, tau)(length) / d(m_xy, tau)(0)`` at the solution; under loads that depend on the shape,
        ``d(m_xy, tau, n)(length) / d(m_xy, tau, n)(0)``.
        """
        return self.record.outcome.jacobian

    @property
    def last_iterate(self) -> BaseMoments:
        """Moments and force at the base, of the solution or of the point where a failed solve ended."""
        return self.record.base

    @property
    def last_equilibrium(self) -> Equilibrium | None:
        """The last equilibrium of this robot before a continuation failed, or a rejected unstable one.

        Its loads and actuation show where the continuation ended: between ``initial`` and the target, or at a fraction
        of the loads for a cold start. None if the solve converged or no equilibrium is known.
        """
        return self._last

    # -- the shape -----------------------------------------------------------------------------------------------

    @property
    def configuration(self) -> Configuration:
        """Robot, actuation and loads as numbers along the arc length."""
        return self.record.configuration

    @property
    def shape(self) -> Shape:
        """The shape's states at the nodes, for code that works on this result."""
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
        """Arc lengths, m, at which to draw or save the shape: every break point, in at least 100 steps."""
        return grid(self.configuration)

    @property
    def one_sided(self) -> bool:
        """Whether break points coincide that an actuation can move apart, so that :meth:`jacobian` has two sides."""
        return derivatives.coincide(self.record, self.solved)

    @property
    def tip_position(self) -> Array:
        """Position at ``s = length``, m, world frame."""
        at_hand = self.record.tip_position
        return self.position(self.length) if at_hand is None else at_hand

    @property
    def tip_pose(self) -> Array:
        """The tip's frame in the world, 4 x 4: ``pose(length)``."""
        at_hand = self.record.tip_pose
        return self.pose(self.length) if at_hand is None else at_hand

    def sample(self, s: Any) -> Sample:
        """All values at arc lengths ``s``: positions, frames, curvatures, angles, torsions, moments and forces.

        After a compiled solve this is one call of compiled code, at the price of a few warm solves for some sixty
        places. :meth:`position`, :meth:`torsion` and the other methods of ``s`` use it.

        Parameters
        ----------
        s
            Arc lengths ``(k,)``, m, or one of them.

        Examples
        --------
        >>> import numpy as np, ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)
        >>> shape = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [0.0]))
        >>> values = shape.sample(np.linspace(0.0, 0.1, 11))
        >>> values.position.shape, values.torsion.shape, values.curvature[5].round(9).tolist()
        ((11, 3), (11, 1), [10.0, 0.0, 0.0])
        """
        return sample(self.shape, s)

    def position(self, s: Any) -> Array:
        """Backbone position at ``s``, m, world frame."""
        return vectors(self.shape, s, lambda at: at.state.position.T)

    def pose(self, s: Any, tube: int | None = None) -> Array:
        """Material frame of a tube at ``s``, 4 x 4, z along the backbone; ``tube=None``: the innermost tube there."""
        return poses(self.shape, s, tube)

    def curvature(self, s: Any) -> Array:
        """Backbone curvature ``(u_x, u_y, 0)``, 1/m, in the rotation-minimizing backbone frame."""
        return vectors(self.shape, s, lambda at: np.pad(at.bent.T, ((0, 0), (0, 1))))

    def torsion(self, tube: int, s: Any) -> Any:
        """Torsion ``u_i,z`` of a tube at ``s``, 1/m."""
        return of_tube(self.shape, tube, s, lambda at, i: at.twisted[i])

    def tube_angle(self, tube: int, s: Any) -> Any:
        """Angle ``psi_i`` of a tube's material frame against the backbone frame at ``s``, rad."""
        return of_tube(self.shape, tube, s, lambda at, i: at.state.angles[i])

    def internal_force(self, s: Any) -> Array:
        """Internal force ``n(s)`` that ``[s, length]`` exerts on ``[0, s]``, N, world frame."""
        return vectors(self.shape, s, lambda at: at.state.force.T)

    def internal_moment(self, s: Any) -> Array:
        """Internal moment ``m(s)`` that ``[s, length]`` exerts on ``[0, s]``, N m, world frame."""
        return vectors(self.shape, s, moments)

    def tube_moment(self, tube: int, s: Any) -> Array:
        """Internal moment ``K_i (u_i - u*_i)`` of one tube at ``s``, N m, in its material frame (paper, (3))."""
        return np.asarray(of_tube(self.shape, tube, s, lambda at, i: at.tube_moments[i].T))

    @cached_property
    def base_wrench(self) -> Array:
        """Force (N) and moment about the entry point (N m) of the robot on its support, ``(6,)``, world frame.

        A six-axis sensor under the robot shows this wrench. It is the resultant of all loads at and in front of the
        entry point. The actuators stand on the sensor too, so their forces and torques do not appear.

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

        It includes the tubes in ``[0, length]``, the torsion of the transmissions, and the curved parts held straight
        behind the entry point.
        """
        configuration = self.configuration
        twisted = float(transmission_energy(self.last_iterate.torsional, configuration.transmission_compliance).sum())
        return self.shape.elastic_energy + twisted + configuration.straightening_energy

    @cached_property
    def load_work(self) -> float:
        """Work of the conservative loads, J, which is minus their potential.

        ``sum F . p + integral of f . p`` of the world-fixed forces, measured from the world's origin, minus ``V(p)`` of
        loads given by a potential. Moments, loads in a tube's frame and free expressions have no potential and are left
        out.
        """
        return self.shape.load_work

    @property
    def potential_energy(self) -> float:
        """Potential energy ``energy - load_work``, J; a stable equilibrium under conservative loads minimizes it."""
        return self.energy - self.load_work

    # -- derivatives ---------------------------------------------------------------------------------------------

    def jacobian(self, s: float | None = None, side: int = 1) -> Array:
        """Derivative of the pose by rotations, then translations, ``(6, 2 tubes)``.

        The first three rows are the position (m, world axes). The last three are the angular velocity ``w`` in the
        world, ``dR = hat(w) R``, of the material frame of the innermost tube present.

        Parameters
        ----------
        s
            A fixed arc length, m; ``None``: the tip, which moves with the tube that ends there.
        side
            ``+1`` for advancing tubes, ``-1`` for tubes drawn back. The two differ only for the tubes in :attr:`kinks`.
            A base at the entry point cannot advance; its derivative is always the one from behind.

        Examples
        --------
        >>> import ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)
        >>> shape = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [-0.02]))
        >>> shape.jacobian()[2].round(9).tolist()
        [0.0, 1.0]
        """
        return derivatives.jacobian(self.record, self.solved, s, side)

    def compliance(self, s: float | None = None, load_at: float | None = None, tube: int = 0) -> Array:
        """Derivative of the pose by a world-fixed force (N) and moment (N m) added at a point, ``(6, 6)``.

        The rows are those of :meth:`jacobian`. Under conservative loads the matrix is symmetric if pose and load are at
        the same point of the same tube.

        Parameters
        ----------
        s
            Arc length of the pose, m; ``None``: the tip. It is the pose of ``tube`` if that tube reaches ``s``,
            otherwise of the innermost tube present.
        load_at, tube
            Arc length of the load, m, and its tube; ``None``: the distal end of that tube, as in
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
        return derivatives.compliance(self.record, self.solved, s, load_at, carrier)

    def sensitivity(self, of: Any, wrt: str | Sequence[str], order: int = 1, side: int = 1) -> Array:
        """Derivative of an output by parameters.

        Parameters
        ----------
        of
            An attribute's name: ``"tip_position"``, ``"tip_pose"``, ``"energy"``, ``"load_work"``,
            ``"potential_energy"``, ``"base_wrench"``. Or a method's name with its arguments: ``("position", s)``,
            ``("pose", s)``, ``("pose", s, tube)``, ``("curvature", s)``, ``("internal_force", s)``,
            ``("internal_moment", s)``, ``("torsion", tube, s)``, ``("tube_angle", tube, s)``,
            ``("tube_moment", tube, s)``, ``("actuator_wrench", tube)``. ``s`` stays fixed; the tip moves. A pose counts
            as six numbers, as in :meth:`jacobian`; an actuator wrench as force and torque.
        wrt
            One or several names of parameters: ``"rotations"``, ``"translations"``, ``"tubes[0].bending_stiffness"``,
            ``"tubes[0].precurvature[1].curvature"``, ``"loads[0].force"``, ``"base.rotation"``. The error for an
            unknown name lists all names; see also ``docs/how_to/derivatives.md``.
        order
            1 or 2. Second derivatives of a rotation are those of the rotation vector from the present pose.
        side
            The side of the derivative where break points coincide: +1 or -1.

        Returns
        -------
        Array
            The output's shape followed by the parameter's shape, which appears twice for ``order = 2``. Several
            parameters share one axis, one behind the other.

        Raises
        ------
        DefinitionError
            An unknown name; a parameter without effect; a load given as a Python function whose derivative by ``s`` is
            needed; second derivatives where break points coincide.
        SolveError
            The equilibrium is singular: at a fold, or one of a family.

        Examples
        --------
        >>> import ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 5.0), youngs_modulus=60e9, poisson_ratio=0.3)
        >>> shape = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [0.0]))
        >>> shape.sensitivity("tip_position", "tubes[0].precurvature[0].curvature").shape
        (3, 3)
        """
        return derivatives.sensitivity(self.record, self.solved, of, wrt, order, side)

    def actuator_wrench(self, tube: int, side: int = 1) -> tuple[float, float]:
        """Force (N) and torque (N m) that the actuator exerts on a tube's base, along +z of the entry frame.

        The torque is ``-tau_i(0)``. The force follows from virtual work as the base advances by ``dbeta``. It is the
        elastic energy gained minus the work ``F . dp + M . dphi`` of every load at its point (a fixed arc length, or a
        tube's end), divided by ``dbeta``. If an interval of conservative load grows with the tube, the potential of the
        added part counts too. Under conservative loads, force and torque are therefore the derivatives of
        :attr:`potential_energy` by translation and rotation. There is no friction in the model.

        The force is computed from the shape alone. It sums the jumps of
        ``H = m_xy . u_xy + sum tau_i u_i,z + n . R e3 - W - V`` at the tube's break points, the integral of
        ``m_i . du*_i/ds`` where its precurvature varies, and ``H`` of the tube alone just behind the entry point.

        Parameters
        ----------
        tube
            Index of the tube, 0 the innermost.
        side
            Where break points coincide: the force against advancing (``+1``) or against drawing back (``-1``).

        Examples
        --------
        >>> import ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)
        >>> push = ctr.PointWrench(force=[0.0, 0.0, -0.5])
        >>> shape = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [-0.02]), [push])
        >>> round(shape.actuator_wrench(0)[0], 9)
        0.5
        """
        return derivatives.actuator_wrench(self.record, self.solved, tube, side)

    @property
    def unknowns(self) -> Array:
        """Moments (N m) at the base and, if loads depend on the shape, their force (N).

        The order is bending, torsion, force, as in
        :meth:`ForwardProblem.function <ctr_opt.ForwardProblem.function>`.
        """
        if not self.converged:
            raise self._no_shape()
        return self.record.unknowns

    @property
    def kinks(self) -> tuple[int, ...]:
        """The tubes whose derivative by translation differs between an advancing and a retreating tube.

        One of their break points coincides with the entry point, a load or another tube's break point, and a value
        jumps there. A base at the entry point does not count, as the tube cannot advance.
        """
        return derivatives.kinks(self.record, self.solved)

    # -- checks and reports --------------------------------------------------------------------------------------

    def verify(self) -> float:
        """Check this shape with SciPy's adaptive DOP853 integrator (relative tolerance 1e-12).

        Returns
        -------
        float
            The defect, m: the largest distance by which the shape moves when it is corrected. Every step is integrated
            again from its start, and one Newton step closes the gaps between steps and the conditions at the tip.
            Infinite if the integrator fails.
        """
        return defect(self.shape, self.solved().z)

    def report(self) -> str:
        """A text that says what was solved, by which methods, how accurately, and the results."""
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
        configuration, shape = self.configuration, self.shape
        z = self.last_iterate.unknowns(configuration.scales, configuration.kind.live)
        return Solved(configuration, z, shape.mesh, shape.integrator)

    # -- internals -----------------------------------------------------------------------------------------------

    def _no_shape(self) -> SolveError:
        return SolveError(f"there is no shape: {self.message or self.status.description}", self)
