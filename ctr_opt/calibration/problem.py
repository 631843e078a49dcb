"""Calibration: estimate a robot's parameters from measured shapes (paper, section III)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ..checks import function, listed
from ..estimation.experiment import Experiment
from ..robot.robot import Robot
from . import solving
from .estimation import Estimation, Progress
from .fit import Fit
from .unknowns import Parameter


class CalibrationProblem:
    """Estimate the robot parameters that best explain measured shapes, with their uncertainty.

    Parameters
    ----------
    robot
        The robot with nominal parameters; the estimation starts there.
    experiments
        List of :class:`~ctr_opt.Experiment`: actuation, known loads and measurements.
    parameters
        The parameters to estimate: names, or :class:`~ctr_opt.Parameter` with prior, bounds, start or scale.
        ``"base.translation"`` (m, world axes) and ``"base.rotation"`` (XYZ Euler angles, rad, applied on the right) are
        relative to ``robot.base_pose``.
    loss
        ``"squared"``: weighted least squares, for normal errors. ``"distance"``: the sum of the points' distances, the
        paper's objective, smoothed within a hundredth of a standard deviation. ``"huber"``, ``"cauchy"``: robust
        losses, squared for small misfits and lower for outliers.
    tolerance
        Tolerance of the forward solves, as in :class:`~ctr_opt.ForwardProblem`.
    compiled
        None: compiled code if there is a compiler and the code supports the problem; compiling takes a few seconds once
        per machine. ``False``: CasADi's virtual machine. ``True``: an error without a compiler.

    Raises
    ------
    DefinitionError
        The message names the parameter, experiment or measurement and what is allowed.

    Examples
    --------
    Estimate the curvature and the stiffness of a rod from its free and its loaded tip:

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
        self.parameters = parameters if plain else listed(parameters, "parameters", "a list of names or Parameters")
        self._estimation = Estimation(robot, experiments, self.parameters, loss, tolerance, compiled)
        solving.check_sensors(self._estimation)

    @property
    def robot(self) -> Robot:
        """The robot with nominal parameters."""
        return self._estimation.robot

    @property
    def experiments(self) -> list[Experiment]:
        """The experiments, as given."""
        return self._estimation.experiments

    def solve(self, *, method: str = "simultaneous", progress: Progress | None = None) -> Fit:
        """Estimate the parameters.

        Parameters
        ----------
        method
            ``"simultaneous"``: IPOPT solves for the parameters and the base moments of all experiments together.
            ``"reduced"``: SciPy's trust region solves for the parameters and computes the equilibria at every step.
            Both reach the same answer. If the first does not converge, the second is tried.
        progress
            Function called as ``progress(what, done, all)``.

        Returns
        -------
        Fit
            Estimates with standard errors, residuals and undetermined directions.

        Raises
        ------
        EstimationError
            The estimation failed. The message says what was tried, how far it came and what to do.
        """
        return solving.solve(self._estimation, method, function(progress, "progress"))

    def nominal(self) -> Fit:
        """Compare the initial parameters with the measurements, without estimation.

        Raises
        ------
        EstimationError
            An experiment has no equilibrium with the initial parameters.
        """
        return solving.nominal(self._estimation)
