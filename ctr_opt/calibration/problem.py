"""Calibration: a robot's parameters from its measured shapes (paper, section III)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ..estimation.experiment import Experiment
from ..robot.robot import Robot
from . import solving
from .estimation import Estimation, Progress
from .fit import Fit
from .unknowns import Parameter


class CalibrationProblem:
    """Find the parameters of a robot that explain measured shapes best, and how well the data determine them.

    Parameters
    ----------
    robot
        With nominal parameters, where the estimation starts.
    experiments
        What was done and measured.
    parameters
        What to estimate: names, or :class:`~ctr_opt.Parameter` with prior, bounds, start or scale.
        ``"base.translation"`` (m, world axes) and ``"base.rotation"`` (XYZ Euler angles, rad, applied on the right) are
        relative to ``robot.base_pose``.
    loss
        ``"squared"``: weighted least squares, for normal errors; ``"distance"``: the sum of the points' distances, the
        paper's objective (smoothed within a hundredth of a standard deviation); ``"huber"``, ``"cauchy"``: squared for
        small misfits, less for outliers.
    tolerance
        Of the forward solves, as in :class:`~ctr_opt.ForwardProblem`.
    compiled
        Default: compiled code for what it knows, where there is a compiler (waiting some seconds the first time on a
        machine); ``False``: CasADi's virtual machine; ``True``: an error where there is no compiler.

    Raises
    ------
    DefinitionError
        Names the parameter, experiment or measurement and what is allowed.

    Examples
    --------
    The curvature and the stiffness of a rod from its free and loaded tip:

    >>> import ctr_opt as ctr
    >>> rod = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)
    >>> held, push = ctr.Actuation([0.0], [0.0]), ctr.PointWrench([0.3, 0.0, 0.0])
    >>> experiments = []
    >>> for loads in ([], [push]):
    ...     tip = ctr.ForwardProblem(ctr.Robot([rod])).solve(held, loads).tip_position
    ...     experiments.append(ctr.Experiment(held, loads, [ctr.PositionMeasurement(None, tip, sigma=1e-4)]))
    >>> nominal = ctr.Robot([ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 9.0), youngs_modulus=50e9, poisson_ratio=0.3)])
    >>> names = ["tubes[0].precurvature[0].curvature", "tubes[0].youngs_modulus"]
    >>> fit = ctr.CalibrationProblem(nominal, experiments, names).solve()
    >>> round(fit.values["tubes[0].youngs_modulus"] / 1e9, 4)
    60.0
    """

    def __init__(
        self,
        robot: Robot,
        experiments: Sequence[Experiment],
        parameters: Iterable[str | Parameter],
        *,
        loss: str = "squared",
        tolerance: float = 1e-7,
        compiled: bool | None = None,
    ) -> None:
        plain = parameters is None or isinstance(parameters, (str, Parameter))
        self.parameters = parameters if plain else list(parameters)
        self._estimation = Estimation(robot, experiments, self.parameters, loss, tolerance, compiled)
        solving.check_sensors(self._estimation)

    @property
    def robot(self) -> Robot:
        """The robot with nominal parameters."""
        return self._estimation.robot

    @property
    def experiments(self) -> list[Experiment]:
        """The experiments."""
        return self._estimation.experiments

    def solve(self, *, method: str = "simultaneous", progress: Progress | None = None) -> Fit:
        """Estimate the parameters.

        Parameters
        ----------
        method
            ``"simultaneous"``: base moments of all experiments and parameters together, by IPOPT; ``"reduced"``: the
            equilibria are solved for at every step of SciPy's trust region. Both end at the same answer; where
            the first does not converge, the second is tried.
        progress
            Called as ``progress(what, done, all)``.

        Raises
        ------
        EstimationError
            No answer was found: what was tried, how far it got and what to do.
        """
        return solving.solve(self._estimation, method, progress)

    def nominal(self) -> Fit:
        """The initial parameters beside the measurements, as if they had been found: their residuals.

        Raises
        ------
        EstimationError
            They have no equilibrium in some experiment.
        """
        return solving.nominal(self._estimation)
