"""Records of solves: the moments at the base, the outcome, and the shape."""

from __future__ import annotations

from typing import Any, ClassVar

import attrs
import numpy as np

from ..checks import Array, array
from ..layout.configuration import Configuration, Scales
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
    jacobian: Array | None = None

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
    only by compiled code, without evaluating the shape: the tip's position and pose, and ``one_sided``.
    """

    configuration: Configuration
    base: BaseMoments
    outcome: Outcome
    shape: Shape | None = None
    tip_position: ClassVar[Array | None] = None
    tip_pose: ClassVar[Array | None] = None
    one_sided: ClassVar[bool] = False

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

    def tip_rates(self, tube: int | None = None) -> tuple[Array, Array] | None:
        """Derivatives of the tip's pose by actuation and by a wrench, if known without computation; here None."""
        del tube
        return None
