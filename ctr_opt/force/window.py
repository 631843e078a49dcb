"""A window of samples whose randomly walking loads are estimated together, and the belief from earlier samples.

Forward and backward passes smooth the window, and samples are linearized again if their estimates move. These are
Gauss-Newton steps on the whole window (Bell, SIAM J. Optim. 4, 1994) at the cost of a Kalman filter.
"""

from __future__ import annotations

from bisect import bisect_right

import attrs
import numpy as np

from ..checks import Array
from ..robot.actuation import Actuation
from .search import Normal, Search, SearchState

_BENT = 1e-2  # standard deviations: second-order error of misfits above which a sample is linearized again
_MOST_PASSES = 2


@attrs.frozen(eq=False)
class Belief:
    """A normal distribution of the unknown numbers, in their units, followed by ``errors`` model errors.

    Mean ``(k,)``, covariance ``(k, k)``.
    """

    mean: Array
    covariance: Array
    errors: int = 0

    def later(self, spread: Array) -> Belief:
        """The belief after a random walk with this covariance."""
        return attrs.evolve(self, covariance=self.covariance + spread)

    def updated(self, matrix: Array, gradient: Array) -> Belief:
        """The belief updated by a loss with these second and first derivatives at the mean."""
        covariance = np.linalg.solve(np.eye(len(self.mean)) + self.covariance @ matrix, self.covariance)
        covariance = 0.5 * (covariance + covariance.T)
        return attrs.evolve(self, mean=self.mean - covariance @ gradient, covariance=covariance)

    def unlearned(self) -> Belief:
        """The belief with standard normal errors again, and their share in the unknowns kept (Schmidt's filter)."""
        first = len(self.mean) - self.errors
        mean, covariance = self.mean.copy(), self.covariance.copy()
        mean[first:], covariance[first:, first:] = 0.0, np.eye(self.errors)
        return attrs.evolve(self, mean=mean, covariance=covariance)

    def smoothed(self, predicted: Belief, later: Array) -> Array:
        """The mean given the smoothed mean of the ``later`` sample, which was ``predicted`` from here."""
        gain = np.linalg.solve(predicted.covariance, self.covariance).T
        return np.asarray(self.mean + gain @ (later - predicted.mean))


@attrs.frozen(eq=False)
class WindowSample:
    """A measured robot at a time, s, linearized at ``state``; ``search`` has no prior.

    ``unit`` scales the unknown numbers and errors. ``matrix`` and ``gradient`` are derivatives of the loss in units.
    """

    time: float
    actuation: Actuation
    search: Search
    unit: Array
    state: SearchState
    normal: Normal
    matrix: Array
    gradient: Array

    @classmethod
    def of(cls, time: float, actuation: Actuation, search: Search, unit: Array, state: SearchState) -> WindowSample:
        """The sample linearized at a state."""
        normal = Normal.of(search, state)
        matrix, gradient = normal.matrix * (unit[:, None] * unit), normal.gradient * unit
        return cls(time, actuation, search, unit, state, normal, matrix, gradient)

    @property
    def mean(self) -> Array:
        """The point of linearization, in units."""
        return np.concatenate((self.state.x, self.state.e)) / self.unit

    def bent(self, mean: Array) -> bool:
        """Whether ``mean`` is beyond the linearization's range, by the relative change of the numbers' scales."""
        step = mean - self.mean
        size = np.abs(step * self.unit / self.search.unknowns.whole_scale)[: len(self.state.x)].max()
        return bool(size * np.sqrt(step @ self.matrix @ step) > _BENT)

    def at(self, mean: Array) -> WindowSample:
        """The sample linearized again at ``mean``; unchanged if the model cannot be evaluated there."""
        search, state = self.search, self.state
        whole = np.clip(mean * self.unit, *search.unknowns.whole_bounds)
        x, e = np.split(whole, [len(state.x)])
        z = state.z + state.follow @ np.concatenate(([1.0], x - state.x))
        there = search.at(z, x, self.normal.places(state, whole - self.mean * self.unit), e)
        return self if there is None else WindowSample.of(self.time, self.actuation, search, self.unit, there)


class Window:
    """The last samples in the order of their times.

    ``drift (k, k)`` is the covariance of the walk in one second, in units; zero for errors. ``since`` is the time of
    the newest sample that has left the window. ``before`` is the belief from it and all earlier samples.
    """

    def __init__(self, before: Belief, drift: Array, horizon: int) -> None:
        self.before, self.since = before, -np.inf
        self.samples: list[WindowSample] = []
        self.means: list[Array] = []
        self._predictions: list[Belief] = []
        self._beliefs: list[Belief] = []
        self._drift, self._horizon = drift, horizon

    def predicted(self, time: float) -> Belief:
        """The belief at a time from all samples up to it."""
        return self._predicted(bisect_right(self._times, time), time)

    def nearest(self, time: float) -> SearchState | None:
        """The state of the last sample before a time, or of the first sample; None without samples."""
        return self.samples[max(bisect_right(self._times, time) - 1, 0)].state if self.samples else None

    def add(self, sample: WindowSample) -> None:
        """Insert a sample and estimate all samples again; the oldest leaves a full window."""
        first = bisect_right(self._times, sample.time)
        self.samples.insert(first, sample)
        self._pass(first)
        for _ in range(_MOST_PASSES):
            bent = [k for k, member in enumerate(self.samples) if member.bent(self.means[k])]
            if not bent:
                break
            for k in bent:
                self.samples[k] = self.samples[k].at(self.means[k])
            self._pass(bent[0])
        if len(self.samples) > self._horizon:
            self.before, self.since = self._beliefs.pop(0).unlearned(), self.samples.pop(0).time
            del self._predictions[0], self.means[0]
            if self.before.errors:
                self._pass(0)

    @property
    def _times(self) -> list[float]:
        return [sample.time for sample in self.samples]

    def _predicted(self, k: int, time: float) -> Belief:
        """The belief at a time from the first ``k`` samples."""
        belief, since = (self._beliefs[k - 1], self.samples[k - 1].time) if k else (self.before, self.since)
        return belief if np.isinf(since) else belief.later(self._drift * (time - since))

    def _pass(self, first: int) -> None:
        """Filter forwards from sample ``first``, then smooth backwards for the means."""
        del self._predictions[first:], self._beliefs[first:]
        for k, sample in enumerate(self.samples[first:], first):
            belief = self._predicted(k, sample.time)
            gradient = sample.gradient + sample.matrix @ (belief.mean - sample.mean)
            self._predictions.append(belief)
            self._beliefs.append(belief.updated(sample.matrix, gradient))
        self.means = [self._beliefs[-1].mean]
        for belief, predicted in zip(self._beliefs[-2::-1], self._predictions[:0:-1], strict=True):
            self.means.insert(0, belief.smoothed(predicted, self.means[0]))
