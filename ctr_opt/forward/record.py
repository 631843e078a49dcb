"""What a solve leaves: the moments at the base, how it went, and the shape."""

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
        values = np.zeros(5 + tubes)
        values[: len(unknowns)] = unknowns * scales.unknowns(tubes, len(unknowns) > 2 + tubes)
        values.setflags(write=False)
        return cls(values[:2], values[2:-3], values[-3:])

    @classmethod
    def checked(cls, bending: Any, torsional: Any, tubes: int) -> BaseMoments:
        """From what a user gives; no torsional moments are zero."""
        return cls(
            array(bending, "bending", (2,), unit="N m"),
            array(np.zeros(tubes) if torsional is None else torsional, "torsional", (tubes,), unit="N m"),
        )

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


@attrs.frozen(eq=False)
class SolvedRecord:
    """The record of a solve in CasADi's virtual machine, or of a failure or a guess, which have no shape.

    An :class:`~ctr_opt.Equilibrium` is made of one, or of a ``CompiledRecord`` with the same members. What is at hand
    without an evaluation of the shape is None here: the tip's position and pose, and whether it is known that
    derivatives there have sides.
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
        """Its actuation."""
        return self.configuration.actuation

    @property
    def loads(self) -> tuple[Load, ...]:
        """The loads on it."""
        return self.configuration.loads

    @property
    def length(self) -> float:
        """Arc length from the entry point to the tip, m."""
        return self.configuration.length

    @property
    def status(self) -> SolveStatus:
        """How the solve ended."""
        return self.outcome.status

    @property
    def unknowns(self) -> Array:
        """Moments, N m, and force, N, at the base in the order of the equations."""
        base, live = self.base, self.configuration.kind.live
        return np.concatenate((base.bending, base.torsional, base.force if live else []))

    @property
    def second_variation(self) -> SecondVariation | None:
        """Of the potential energy; None where there is none, or no shape."""
        return None if self.shape is None else self.shape.second_variation

    def tip_rates(self, tube: int | None = None) -> tuple[Array, Array] | None:
        """Derivatives of the tip's pose by actuation and by a wrench, where they take no derivation."""
        del tube
        return None
