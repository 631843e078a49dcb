"""What an equilibrium knows of its derivatives: Jacobian, compliance, sensitivities, forces on the actuators."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..checks import Array, index
from ..errors import DefinitionError
from ..layout.configuration import Configuration
from ..loads.point import PointWrench
from ..robot.names import Parameter, chosen, parameters
from .outputs import Output, output, place_of
from .sensitivity import Derivatives, Solved, derivatives, kinked

_APART = 1e-9  # relative: derivatives from the two sides that differ by less are the same


class Differentiable:
    """The derivatives of a solved equilibrium, exact but for the error of the solution itself.

    All follow from the implicit-function theorem (``docs/derivatives.md``). Where break points coincide, or one stands
    at the entry point, derivatives that move them apart are one-sided: ``side = +1`` is the derivative for a growing
    parameter (an advancing tube), ``-1`` that for a shrinking one. :attr:`kinks` tells which tubes stand so.
    """

    def solved(self) -> Solved:
        """The equilibrium in numbers; raises ``SolveError`` where there is none."""
        raise NotImplementedError

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
        wanted = Output("tip_pose") if s is None else output(("pose", s), self.solved().configuration)
        return self._derivatives(wanted, self._actuation_parameters(), side).first

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
        solved = self.solved()
        own = solved.configuration
        carrier = index(tube, "tube", own.tube_count)
        at = None if load_at is None else place_of(load_at, carrier, own, "load_at")
        configuration = Configuration(own.robot, own.actuation, (*own.loads, PointWrench(arc_length=at, tube=carrier)))
        reached = own.length if s is None else place_of(s, None, own)
        present = carrier if own.ends.reaches(carrier, reached) else None
        wanted = Output("tip_pose", present) if s is None else Output("pose", present, reached)
        name = f"loads[{len(own.loads)}]"
        added = chosen(parameters(own.robot, own.actuation, configuration.loads), [f"{name}.force", f"{name}.moment"])
        return derivatives(solved.under(configuration), wanted, added).first

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
            lists all there are, and see ``docs/derivatives.md``.
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
        solved = self.solved()
        own = solved.configuration
        if order not in (1, 2):
            raise DefinitionError(f"order = {order!r} must be 1 or 2")
        single = isinstance(wrt, str)
        selected = chosen(parameters(own.robot, own.actuation, own.loads), [wrt] if isinstance(wrt, str) else wrt)
        wanted = output(of, own)
        found = self._derivatives(wanted, selected, side, order)
        shape = selected[0].value.shape if single else (sum(parameter.size for parameter in selected),)
        if order == 1:
            return found.first.reshape(wanted.shape + shape)
        assert found.second is not None
        return found.second.reshape(wanted.shape + shape + shape)

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
        wanted = output(("actuator_wrench", tube), self.solved().configuration)
        moving = [each for each in self._actuation_parameters() if each.name == "translations"]
        assert wanted.tube is not None
        force, torque = derivatives(self.solved(), wanted, moving, side=side, at=wanted.tube).value
        return float(force), float(torque)

    @property
    def unknowns(self) -> Array:
        """Bending and torsional moments (N m) at the base and, where loads depend on the shape, their force (N).

        In the order in which :meth:`ForwardProblem.function <ctr_opt.ForwardProblem.function>` takes and returns them.
        """
        solved = self.solved()
        own = solved.configuration
        return np.asarray(solved.z * own.scales.unknowns(own.tube_count, own.kind.live))

    @property
    def kinks(self) -> tuple[int, ...]:
        """The tubes whose derivative by translation differs between an advancing and a retreating tube.

        One of their break points coincides with the entry point, a load's, or another tube's, and something jumps
        there. A base at the entry point, where no tube can advance, is no kink.
        """
        solved = self.solved()
        moving = [each for each in self._actuation_parameters() if each.name == "translations"]
        suspects = kinked(solved, moving)
        if not suspects:
            return ()
        sides = [derivatives(solved, Output("tip_pose"), moving, side=side) for side in (1, -1)]
        both = [np.vstack((each.first, each.unknowns)) for each in sides]
        apart = np.abs(both[0] - both[1]).max(axis=0) > _APART * np.abs(both[0]).max()
        return tuple(i for i in suspects if apart[i])

    # -- internals -------------------------------------------------------------------------------------------------

    def _actuation_parameters(self) -> list[Parameter]:
        own = self.solved().configuration
        return chosen(parameters(own.robot, own.actuation), ["rotations", "translations"])

    def _derivatives(self, wanted: Output, selected: list[Parameter], side: int, order: int = 1) -> Derivatives:
        if side not in (1, -1):
            raise DefinitionError(f"side = {side!r} must be 1 or -1")
        return derivatives(self.solved(), wanted, selected, side=side, order=order)
