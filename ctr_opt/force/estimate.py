"""The result of an estimate of loads, for people: the solution, its report and figures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .plot import figure_force
from .report import force_report
from .solution import Solution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MANY = 8  # numbers: with more of them, the forces alone are shown


class ForceEstimate(Solution):
    """The result of a :class:`~ctr_opt.ForceEstimationProblem`.

    Attributes
    ----------
    labels
        A name for each number: the rows and columns of :attr:`covariance`.
    states
        Solutions, that of least loss first.
    evidence
        Where the number of :class:`~ctr_opt.Contacts` was sought: loss and criterion by number.
    """

    def report(self) -> str:
        """Loads with their errors, consistency, and what may hide behind them, as text."""
        return force_report(self)

    def plot(self) -> Figure:
        """The shape beside what was measured, and confidence ellipses of the force."""
        return figure_force(self)

    def __repr__(self) -> str:
        if len(self.labels) > _MANY:
            return f"<ForceEstimate: {len(self.labels)} numbers, force = {np.round(self.force, 4).tolist()} N>"
        return f"<ForceEstimate: {self._in_words()}>"
