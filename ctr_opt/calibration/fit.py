"""The result of a calibration, for people: the solution, fits made again from it, report and figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..checks import Array
from ..estimation.experiment import Experiment
from ..robot.actuation import Actuation
from . import refits
from .plot import figure_fit
from .report import fit_report
from .solution import Residual, Solution

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Fit(Solution):
    """The result of a :class:`~ctr_opt.CalibrationProblem`.

    Attributes
    ----------
    names
        The parameters' names.
    labels
        A name for each number: the rows and columns of :attr:`covariance`.
    method, iterations, objective
        How it was found; the loss reached, priors included.
    found
        Where the solve ended, undetermined numbers and base moments as they stood.
    """

    def actuation(self, rotations: Any, translations: Any) -> Actuation:
        """The actuation of the calibrated robot at joints as they are read: with the estimated homes added.

        A force estimate with ``fit=`` accepts no other if ``"tubes[i].rotation_offset"`` or
        ``"tubes[i].translation_offset"`` were estimated.

        Parameters
        ----------
        rotations, translations
            One for each tube, rad and m, as in the experiments of the fit.

        Raises
        ------
        DefinitionError
            With its home, a tube's base is in front of the entry point.
        EstimationError
            The data do not determine the homes.

        Examples
        --------
        A rod whose rotation reads 0.1 rad too little:

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
        """Profile likelihood of one number: its values, and the loss with all others estimated anew, over the least.

        Parameters
        ----------
        label
            One of :attr:`labels`.
        count, width
            So many values, as far as ``width`` standard errors from the estimate, or to its bounds.

        Returns
        -------
        tuple
            Values ``(count,)`` and excess loss ``(count,)``; for normal errors half the squared distance in standard
            errors where the problem is linear.

        Raises
        ------
        EstimationError
            The data do not determine the number, or with some value no answer was found.
        """
        return refits.profile(self, label, count, width)

    def without(self, experiments: Sequence[int] | int) -> Fit:
        """The fit to the other experiments, from here: leave one out, or a block, to hold it out.

        Raises
        ------
        EstimationError
            It found no answer.
        """
        return refits.without(self, experiments)

    def errors_without(self, experiments: Sequence[int] | int) -> list[Residual]:
        """The residuals of experiments that a fit to the others predicts: a hold-out.

        Raises
        ------
        EstimationError
            The fit found no answer, or the experiments have no equilibrium with its estimates.
        """
        return refits.errors_without(self, experiments)

    def tested(self, experiments: Sequence[Experiment]) -> Fit:
        """The same estimates beside other experiments, as if they had been found from these: their residuals.

        Raises
        ------
        EstimationError
            The experiments have no equilibrium with the estimates.
        """
        return refits.tested(self, experiments, "the estimates")

    def bootstrap(self, repetitions: int = 200, *, seed: int = 0) -> Array:
        """Estimates from experiments drawn again with replacement, ``(repetitions, len(labels))``.

        Repetitions that find no answer, or do not determine what all experiments do, are left out, so that there are
        fewer rows, with an :class:`~ctr_opt.EstimationWarning`. Not a number where the data do not determine it.

        Raises
        ------
        EstimationError
            More than one repetition in twenty is of that kind: without them the others are no fair sample.
        """
        return refits.bootstrap(self, repetitions, seed)

    # -- for people ------------------------------------------------------------------------------------------------

    def report(self) -> str:
        """Estimates with their errors, correlations, residuals, and what the data do not tell, as text."""
        return fit_report(self)

    def plot(self) -> Figure:
        """Histogram of the tip's errors, residuals along the robot, correlations and confidence ellipses."""
        return figure_fit(self)

    def __repr__(self) -> str:
        open_ones = f", {len(self.undetermined)} directions undetermined" if self.undetermined else ""
        return f"<Fit of {len(self.labels)} numbers to {len(self.estimation.experiments)} experiments{open_ones}>"
