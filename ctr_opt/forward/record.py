"""Records of solves: the moments at the base, the outcome, and the shape."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array, array, freezing
from ..layout.configuration import Configuration, Scales
from ..layout.ends import Ends
from ..loads.kind import Load
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from ..solvers.status import SolveStatus
from ..transcription.shape import Shape
from ..transcription.stability import SecondVariation
from .attempt import Attempt, path_of


@attrs.frozen(eq=False)
class BaseMoments:
    """The unknowns of a shooting problem: moments (and force) that the robot exerts on the entry point.

    Attributes
    ----------
    bending
        ``(2,)``, N m: total bending moment at ``s = 0`` in the backbone frame.
    torsional
        ``(tubes,)``, N m: each tube's torsional moment at its base.
    force
        ``(3,)``, N: the part of the internal force ``n(0)`` that is due to loads that depend on the shape; zero without
        such loads.

    Examples
    --------
    >>> import ctr_opt as ctr
    >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)
    >>> shape = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [0.0]))
    >>> shape.last_iterate.vector.shape
    (3,)
    """

    bending: Array
    torsional: Array
    force: Array = attrs.field(factory=lambda: np.zeros(3))

    @property
    def vector(self) -> Array:
        """The moments as one vector ``(2 + tubes,)``, N m."""
        return np.concatenate((self.bending, self.torsional))

    @classmethod
    def of(cls, unknowns: Array, scales: Scales, tubes: int) -> BaseMoments:
        """Moments and force from dimensionless unknowns, with or without a force."""
        values = np.zeros(5 + tubes)
        values[: len(unknowns)] = unknowns * scales.unknowns(tubes, len(unknowns) > 2 + tubes)
        values.setflags(write=False)
        return cls(values[:2], values[2:-3], values[-3:])

    @classmethod
    def checked(cls, bending: Any, torsional: Any, tubes: int) -> BaseMoments:
        """Moments from user input, checked; ``torsional=None`` means zero."""
        return cls(
            array(bending, "bending", (2,), unit="N m"),
            array(np.zeros(tubes) if torsional is None else torsional, "torsional", (tubes,), unit="N m"),
        )

    def unknowns(self, scales: Scales, live: bool) -> Array:
        """The dimensionless unknowns, including the force if loads are ``live``."""
        moments = np.concatenate((self.bending, self.torsional)) / scales.moment
        return np.concatenate((moments, self.force / scales.force)) if live else moments


class PoseRate(NamedTuple):
    """A question for derivatives of a pose: at an arc length, under a wrench at another; None: the tip, the tube's end.

    ``frame`` is the tube whose frame is the pose; -1: the innermost there. ``tube`` carries the wrench. ``side`` is
    that of the derivatives where break points coincide.
    """

    s: float | None = None
    frame: int = -1
    load_at: float | None = None
    tube: int = 0
    side: int = 1


@attrs.frozen(eq=False)
class PoseRates:
    """Derivatives of a pose, read-only, SI.

    Attributes
    ----------
    jacobian, compliance
        By rotations and translations ``(6, 2n)``; by a force and a moment ``(6, 6)``.
    unknowns
        Derivatives of the moments (and force) at the base by rotations and translations ``(k, 2n)``.
    coincide
        ``(n,)``: whether break points of a tube coincide with others, so that its derivative is one-sided.
    """

    jacobian: Array
    compliance: Array
    unknowns: Array
    coincide: NDArray[np.intc]


@attrs.frozen(eq=False)
class Outcome:
    """The outcome of a solve, with its diagnostics.

    Attributes
    ----------
    status, attempts, message
        How the solve ended, what was tried, and what went wrong.
    reached
        How far the last continuation got: 1 at the end.
    setup_time, solve_time
        Time in seconds.
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
    jacobian: Array | None = attrs.field(default=None, converter=attrs.converters.optional(freezing))

    @property
    def path(self) -> str:
        """The attempts as text."""
        return path_of(self.attempts)

    @property
    def iterations(self) -> int:
        """Total number of Newton and IPOPT iterations."""
        return sum(attempt.iterations for attempt in self.attempts)


@attrs.frozen(eq=False)
class SolvedRecord:
    """The record of a solve in CasADi's virtual machine, or of a failure or a guess, which have no shape.

    An :class:`~ctr_opt.Equilibrium` holds one, or a ``CompiledRecord`` with the same members. Some members are provided
    only by compiled code, without evaluating the shape: the tip's position and pose, and derivatives.
    """

    configuration: Configuration
    base: BaseMoments
    outcome: Outcome
    shape: Shape | None = None
    tip_position: ClassVar[Array | None] = None
    tip_pose: ClassVar[Array | None] = None

    @classmethod
    def guess(cls, configuration: Configuration, base: BaseMoments) -> SolvedRecord:
        """The record of a guess, from which a solve may start."""
        outcome = Outcome(SolveStatus.GUESS, (Attempt("guess"),), "this is a guess, not a solution")
        return cls(configuration, base, outcome)

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.configuration.robot

    @property
    def actuation(self) -> Actuation:
        """The actuation."""
        return self.configuration.actuation

    @property
    def loads(self) -> tuple[Load, ...]:
        """The loads on the robot."""
        return self.configuration.loads

    @property
    def length(self) -> float:
        """Arc length from the entry point to the tip, m."""
        return self.configuration.length

    @property
    def status(self) -> SolveStatus:
        """The status with which the solve ended."""
        return self.outcome.status

    @property
    def unknowns(self) -> Array:
        """Moments (N m) and force (N) at the base in the order of the equations."""
        base, live = self.base, self.configuration.kind.live
        return np.concatenate((base.bending, base.torsional, base.force if live else []))

    @property
    def second_variation(self) -> SecondVariation | None:
        """The second variation of the potential energy; None without a potential or a shape."""
        return None if self.shape is None else self.shape.second_variation

    @property
    def ends(self) -> Ends:
        """Where the tubes end."""
        return self.configuration.ends

    def rates(self, wanted: PoseRate) -> PoseRates | None:
        """Derivatives of a pose, if known without symbols; here None."""
        del wanted
        return None

    def tip_rates(self, tube: int) -> PoseRates | None:
        """Derivatives of the tip's pose under a wrench on a tube that is the innermost there, if known; here None."""
        del tube
        return None

    def push(self, tube: int, side: int) -> float | None:
        """The axial force of the actuator on a tube's base, if known without symbols; here None."""
        del tube, side
        return None
