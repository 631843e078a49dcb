"""The result of a calibration: estimates, refits, report and figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..checks import Array
from ..estimation.experiment import Experiment
from ..robot.actuation import Actuation
from . import refits
from .plot import figure_fit
from .report import fit_report
from .solution import CalibrationSolution, Residual

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Fit(CalibrationSolution):
    """The result of a :class:`~ctr_opt.CalibrationProblem`.

    Attributes
    ----------
    names
        Names of the parameters.
    labels
        One label for each number: the rows and columns of :attr:`covariance`.
    method, iterations, objective
        Method and iterations of the solve, and the final loss, priors included.
    outcome
        Final values of the solve, undetermined numbers and base moments included.
    """

    def actuation(self, rotations: Any, translations: Any) -> Actuation:
        """The actuation of the calibrated robot: joint readings plus the estimated homes.

        A force estimate with ``fit=`` requires this actuation if ``"tubes[i].rotation_offset"`` or
        ``"tubes[i].translation_offset"`` were estimated.

        Parameters
        ----------
        rotations, translations
            Joint readings ``(n,)``, rad and m, one for each tube, as in the experiments of the fit.

        Raises
        ------
        DefinitionError
            The home puts a tube's base in front of the entry point.
        EstimationError
            The data do not determine the homes.

        Examples
        --------
        A rod whose rotation reading is 0.1 rad too low:

        >>> import ctr_opt as ctr
        >>> rod = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)
        >>> tip = ctr.ForwardProblem(ctr.Robot([rod])).solve(ctr.Actuation([0.6], [0.0])).tip_position
        >>> seen = ctr.PositionMeasurement(None, tip, sigma=1e-4)
        >>> experiments = [ctr.Experiment(ctr.Actuation([0.5], [0.0]), [], [seen])]
        >>> fit = ctr.CalibrationProblem(ctr.Robot([rod]), experiments, ["tubes[0].rotation_offset"]).solve()
        >>> fit.actuation([0.5], [0.0]).rotations.round(6).tolist()
        [0.6]
        """
        return self.homes.actuation(rotations, translations)

    def profile(self, label: str, *, count: int = 9, width: float = 3.0) -> tuple[Array, Array]:
        """Profile likelihood of one number: the excess loss at fixed values, all other numbers refitted.

        Parameters
        ----------
        label
            One of :attr:`labels`.
        count, width
            Number of values, and their range: ``width`` standard errors to both sides of the estimate, cut at bounds.

        Returns
        -------
        tuple
            Values ``(count,)`` and excess loss ``(count,)``. For a linear problem with normal errors the excess loss is
            half the squared distance in standard errors.

        Raises
        ------
        EstimationError
            The data do not determine the number, or a refit failed.
        """
        return refits.profile(self, label, count, width)

    def without(self, experiments: Sequence[int] | int) -> Fit:
        """Refit without some experiments, starting from this fit.

        Parameters
        ----------
        experiments
            Number of the experiment to leave out, or a list of numbers.

        Raises
        ------
        EstimationError
            The refit failed.
        """
        return refits.without(self, experiments)

    def errors_without(self, experiments: Sequence[int] | int) -> list[Residual]:
        """Residuals of held-out experiments, predicted by a refit to all other experiments.

        Parameters
        ----------
        experiments
            Number of the experiment to hold out, or a list of numbers.

        Raises
        ------
        EstimationError
            The refit failed, or a held-out experiment has no equilibrium with its estimates.
        """
        return refits.errors_without(self, experiments)

    def tested(self, experiments: Sequence[Experiment]) -> Fit:
        """Compare the estimates with other experiments, without estimation.

        Raises
        ------
        DefinitionError
            An actuation already has the homes that the fit adds.
        EstimationError
            An experiment has no equilibrium with the estimates.
        """
        return refits.tested(self, experiments, "the estimates")

    def bootstrap(self, repetitions: int = 200, *, seed: int = 0) -> Array:
        """Bootstrap estimates ``(repetitions, len(labels))`` from experiments resampled with replacement.

        A repetition is left out, with an :class:`~ctr_opt.EstimationWarning`, if its fit fails or leaves numbers open
        that all experiments together determine. The result then has fewer rows. Undetermined numbers are not a number.

        Raises
        ------
        EstimationError
            More than one repetition in twenty was left out, so that the rest is a biased sample.
        """
        return refits.bootstrap(self, repetitions, seed)

    # -- for people ------------------------------------------------------------------------------------------------

    def report(self) -> str:
        """Text report: estimates with errors, correlations, residuals and undetermined directions."""
        return fit_report(self)

    def plot(self) -> Figure:
        """Figure of the tip errors, residuals along the robot, correlations and confidence ellipses."""
        return figure_fit(self)

    def __repr__(self) -> str:
        open_ones = f", {len(self.undetermined)} directions undetermined" if self.undetermined else ""
        return f"<Fit of {len(self.labels)} numbers to {len(self.estimation.experiments)} experiments{open_ones}>"
