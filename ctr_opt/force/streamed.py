"""Loads on a robot at one time of a stream."""

from __future__ import annotations

import attrs

from ..checks import Array, freezing
from ..estimation.chi_square import p_value
from .numbers import Estimated, Numbered


@attrs.frozen(eq=False)
class StreamedForce(Estimated):
    """The result of :meth:`ForceEstimator.update <ctr_opt.ForceEstimator.update>`.

    Attributes
    ----------
    time
        Time of the estimate, s: that of the newest sample, dropped samples included.
    status
        Use of the sample. ``"used"``; ``"late"``: inserted among earlier samples; ``"dropped"``: without measurements;
        ``"too late"``: older than the horizon, not used; ``"left out"``: no loads explain it.
    labels
        One label for each number: the rows and columns of :attr:`covariance`.
    estimates, covariance
        Estimates ``(k,)`` and covariance ``(k, k)`` of all numbers, SI, from all samples up to ``time``.
    chi_squared, degrees_of_freedom
        Normalized innovation squared: the squared distance of this sample from its prediction over the covariance. Not
        a number and zero if the sample was not used.
    window_times, window_estimates
        Times of the samples in the horizon, s, ``(n,)``, and smoothed estimates then, ``(n, k)``, SI.
    """

    time: float
    status: str
    labels: tuple[str, ...]
    estimates: Array = attrs.field(converter=freezing)
    covariance: Array = attrs.field(converter=freezing)
    chi_squared: float
    degrees_of_freedom: int
    window_times: Array = attrs.field(converter=freezing)
    window_estimates: Array = attrs.field(converter=freezing)
    numbered: Numbered = attrs.field(repr=False)

    @property
    def samples(self) -> int:
        """Number of samples in the horizon."""
        return len(self.window_times)

    @property
    def p_value(self) -> float:
        """Probability of an innovation at least this large; not a number if the sample was not used."""
        return p_value(self.chi_squared, self.degrees_of_freedom)

    def __repr__(self) -> str:
        return f"<StreamedForce at {self.time:g} s, {self.status}: {self._in_words()}>"
