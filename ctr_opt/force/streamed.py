"""What is known of the loads on a robot at one time of a stream."""

from __future__ import annotations

import attrs

from ..checks import Array
from ..estimation.chi_square import p_value
from .numbers import Estimated, Numbered


@attrs.frozen(eq=False)
class StreamedForce(Estimated):
    """The result of :meth:`ForceEstimator.update <ctr_opt.ForceEstimator.update>`.

    Attributes
    ----------
    time
        For which it stands, s: that of the newest sample, dropped ones included.
    status
        What became of the sample: ``"used"``; ``"late"``: sorted in among earlier ones; ``"dropped"``: there was
        nothing to see; ``"too late"``: older than the horizon, kept out; ``"left out"``: no load explains it.
    labels
        A name for each number: the rows and columns of :attr:`covariance`.
    estimates, covariance
        Of all numbers, SI, ``(k,)`` and ``(k, k)``: by all samples up to ``time``.
    chi_squared, degrees_of_freedom
        Of the innovation: the squared distances of this sample from what was predicted, over their covariance. Not a
        number and zero where the sample was not used.
    window_times, window_estimates
        Times of the samples in the horizon, s, ``(n,)``, and the numbers then, ``(n, k)``, by those after them, too.
    """

    time: float
    status: str
    labels: tuple[str, ...]
    estimates: Array
    covariance: Array
    chi_squared: float
    degrees_of_freedom: int
    window_times: Array
    window_estimates: Array
    numbered: Numbered = attrs.field(repr=False)

    @property
    def samples(self) -> int:
        """How many samples are in the horizon."""
        return len(self.window_times)

    @property
    def p_value(self) -> float:
        """Probability of an innovation so large; not a number where there is none."""
        return p_value(self.chi_squared, self.degrees_of_freedom)

    def __repr__(self) -> str:
        return f"<StreamedForce at {self.time:g} s, {self.status}: {self._in_words()}>"
