"""The result of a force estimation: loads, report and figures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .plot import figure_force
from .report import force_report
from .solution import ForceSolution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MANY = 8  # numbers: with more of them only the total force is shown


class ForceEstimate(ForceSolution):
    """The result of a :class:`~ctr_opt.ForceEstimationProblem`.

    Attributes
    ----------
    labels
        One label for each number: the rows and columns of :attr:`covariance`.
    states
        All solutions, in order of their loss.
    evidence
        With :class:`~ctr_opt.Contacts`: loss and criterion for each number of contacts.
    """

    def report(self) -> str:
        """Text report: loads with errors, consistency, and model errors that look like forces."""
        return force_report(self)

    def plot(self) -> Figure:
        """Figure of the shape with the measurements, and confidence ellipses of the force."""
        return figure_force(self)

    def __repr__(self) -> str:
        if len(self.labels) > _MANY:
            return f"<ForceEstimate: {len(self.labels)} numbers, force = {np.round(self.force, 4).tolist()} N>"
        return f"<ForceEstimate: {self._in_words()}>"
