"""Intrinsic force estimation: what presses on a robot, from its shape (paper, sections I and IV)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..calibration.fit import Fit
from ..estimation.measurements import Measurement
from ..loads.kind import Load
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from .estimate import ForceEstimate
from .estimation import Estimation
from .unknown import UnknownLoad


class ForceEstimationProblem:
    """Find the loads that explain a robot's measured shape, and how well the shape determines them.

    Parameters
    ----------
    robot
        The robot, calibrated.
    unknown
        What is sought: :class:`TipForce`, :class:`TipWrench`, :class:`PointForce`, :class:`DistributedForce`, one or
        several, and :class:`Contacts` whose number is unknown.
    prior
        Mean and standard deviation of the forces, N, known before, of those unknown loads that have none of their own.
    loss
        ``"squared"`` for normal errors; ``"huber"`` or ``"cauchy"`` where points may be outliers; ``"distance"``.
    rotation_sigma, translation_sigma
        Standard deviations of the given actuation: numbers or one for each tube, rad and m. Default: it is exact.
    tolerance
        Of the forward solves, as in :class:`~ctr_opt.ForwardProblem`.
    compiled
        As in :class:`~ctr_opt.CalibrationProblem`.
    starts
        From how many the search sets out, where loads may be large enough for several answers: the first from the
        prior's mean, others (seeded) around it.

    Raises
    ------
    DefinitionError
        Names the field, the value and what is allowed.

    Examples
    --------
    The force at the tip of a rod from its position and direction:

    >>> import ctr_opt as ctr
    >>> rod = ctr.Robot([ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)])
    >>> held = ctr.Actuation([0.0], [0.0])
    >>> pushed = ctr.ForwardProblem(rod).solve(held, [ctr.PointWrench([0.2, 0.1, 0.0])])
    >>> seen = ctr.PositionMeasurement([0.05, 0.1], pushed.position([0.05, 0.1]), sigma=1e-4)
    >>> estimate = ctr.ForceEstimationProblem(rod, [ctr.TipForce()]).solve(held, [seen])
    >>> estimate.force[:2].round(4).tolist()
    [0.2, 0.1]
    """

    def __init__(
        self,
        robot: Robot,
        unknown: UnknownLoad | Sequence[UnknownLoad],
        *,
        prior: Any = None,
        loss: str = "squared",
        rotation_sigma: Any = None,
        translation_sigma: Any = None,
        tolerance: float = 1e-7,
        compiled: bool | None = None,
        starts: int = 1,
    ) -> None:
        self._estimation = Estimation(
            robot, unknown, prior, loss, rotation_sigma, translation_sigma, tolerance, compiled, starts
        )
        self.robot, self.unknown, self.starts = robot, self._estimation.unknown, self._estimation.starts
        self.loss, self.tolerance = loss, self._estimation.forward.settings.tolerance

    def solve(
        self,
        actuation: Actuation,
        measurements: Measurement | Sequence[Measurement],
        loads: Sequence[Load] = (),
        fit: Fit | None = None,
        initial: ForceEstimate | None = None,
    ) -> ForceEstimate:
        """Estimate the loads.

        Parameters
        ----------
        actuation
            Of the robot when it was measured; if the fit estimated homes of the joints, by ``fit.actuation``.
        measurements
            Any mix, each with its ``sigma``.
        loads
            Loads that are known: gravity and the like.
        fit
            The calibration that the robot is from: the errors of its parameters are counted among those of the loads.
        initial
            An earlier estimate of the same unknown loads, close by: the search starts there.

        Raises
        ------
        DefinitionError
            The fit estimated homes of the joints, and the actuation does not have them.
        EstimationError
            No loads were found: what was tried, how far it got and what to do.
        """
        return self._estimation.solve(self._estimation.experiment(actuation, measurements, loads), fit, initial)

    def check(self, actuation: Actuation, measurements: Any, loads: Sequence[Load] = ()) -> None:
        """Check what would be solved, without solving.

        Raises
        ------
        DefinitionError
            As :meth:`solve`.
        """
        self._estimation.check(self._estimation.experiment(actuation, measurements, loads))
