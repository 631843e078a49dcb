"""Intrinsic force estimation: loads on a robot from its measured shape (paper, sections I and IV)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..calibration.fit import Fit
from ..estimation.measurements import Measurement
from ..loads.kind import Load
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from .estimate import ForceEstimate
from .estimation import ForceEstimation
from .unknown import UnknownLoad


class ForceEstimationProblem:
    """Estimate the loads that explain a robot's measured shape, with their uncertainty.

    Parameters
    ----------
    robot
        The robot, calibrated.
    unknown
        One unknown load or a list: :class:`TipForce`, :class:`TipWrench`, :class:`PointForce`,
        :class:`DistributedForce`, or :class:`Contacts`, whose number is unknown.
    prior
        Mean and standard deviation, N, for the forces of all unknown loads without their own ``prior``.
    loss
        ``"squared"`` for normal errors; ``"huber"`` or ``"cauchy"`` if points may be outliers; ``"distance"``. See
        :class:`~ctr_opt.CalibrationProblem`.
    rotation_sigma, translation_sigma
        Standard deviations of the actuation, rad and m: a number, or one for each tube. Default: the actuation is
        exact.
    tolerance
        Tolerance of the forward solves, as in :class:`~ctr_opt.ForwardProblem`.
    compiled
        Use of compiled code, as in :class:`~ctr_opt.CalibrationProblem`.
    starts
        Number of starts of the search. The first is the prior's mean; further starts are drawn around it with a fixed
        seed. More than one helps if large loads allow several answers.

    Raises
    ------
    DefinitionError
        The message names the field, the value and what is allowed.

    Examples
    --------
    Estimate the force at the tip of a rod from two measured points:

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
        self._estimation = ForceEstimation(
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
            Actuation during the measurement; from ``fit.actuation`` if the fit estimated homes of the joints.
        measurements
            One measurement or a list of any kinds, each with its ``sigma``.
        loads
            Known loads, such as gravity.
        fit
            The calibration of the robot. The covariance of the loads then includes the errors of its parameters.
        initial
            An earlier estimate of the same unknown loads, close to this one: the search starts there.

        Returns
        -------
        ForceEstimate
            Loads with their covariance, consistency with the measurements, and alternative solutions.

        Raises
        ------
        DefinitionError
            The fit estimated homes of the joints, but the actuation does not contain them.
        EstimationError
            The estimation failed. The message says what was tried, how far it came and what to do.
        """
        return self._estimation.solve(self._estimation.experiment(actuation, measurements, loads), fit, initial)

    def check(self, actuation: Actuation, measurements: Any, loads: Sequence[Load] = ()) -> None:
        """Check the arguments of :meth:`solve` without solving.

        Raises
        ------
        DefinitionError
            The message names the field, the value and what is allowed.
        """
        self._estimation.check(self._estimation.experiment(actuation, measurements, loads))
