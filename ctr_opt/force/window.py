"""Loads that wander, seen at several times and estimated together: a window of samples, and what came before it.

The window is smoothed by passes forwards and backwards, and samples are linearized anew where their estimates move:
Gauss-Newton steps on the whole window (Bell, SIAM J. Optim. 4, 1994), at the price of a Kalman filter.
"""

from __future__ import annotations

from bisect import bisect_right

import attrs
import numpy as np

from ..checks import Array
from ..robot.actuation import Actuation
from .search import Normal, Search, State

_BENT = 1e-2  # standard deviations: how far misfits' second order may be off before they are linearized anew
_MOST_PASSES = 2


@attrs.frozen(eq=False)
class Belief:
    """A normal distribution of the numbers sought, in their units, and behind them of so many ``errors`` of the model.

    Mean ``(k,)``, covariance ``(k, k)``.
    """

    mean: Array
    covariance: Array
    errors: int = 0

    def later(self, spread: Array) -> Belief:
        """After a walk with this covariance."""
        return attrs.evolve(self, covariance=self.covariance + spread)

    def told(self, matrix: Array, gradient: Array) -> Belief:
        """With a loss of such second and first derivatives at the mean."""
        covariance = np.linalg.solve(np.eye(len(self.mean)) + self.covariance @ matrix, self.covariance)
        covariance = 0.5 * (covariance + covariance.T)
        return attrs.evolve(self, mean=self.mean - covariance @ gradient, covariance=covariance)

    def unlearned(self) -> Belief:
        """With errors that are standard normal again, and what the numbers sought have of them (Schmidt's filter)."""
        first = len(self.mean) - self.errors
        mean, covariance = self.mean.copy(), self.covariance.copy()
        mean[first:], covariance[first:, first:] = 0.0, np.eye(self.errors)
        return attrs.evolve(self, mean=mean, covariance=covariance)

    def given(self, predicted: Belief, later: Array) -> Array:
        """The mean, if what was predicted from here turned out to be this."""
        gain = np.linalg.solve(predicted.covariance, self.covariance).T
        return np.asarray(self.mean + gain @ (later - predicted.mean))


@attrs.frozen(eq=False)
class Sample:
    """A robot seen at a time, s, and all of it to first order at ``state``; ``search`` is without prior.

    ``unit``, ``matrix`` and ``gradient``: of the numbers sought and the errors; the latter two of the loss, in units.
    """

    time: float
    actuation: Actuation
    search: Search
    unit: Array
    state: State
    normal: Normal
    matrix: Array
    gradient: Array

    @classmethod
    def of(cls, time: float, actuation: Actuation, search: Search, unit: Array, state: State) -> Sample:
        """At a state."""
        normal = Normal.of(search, state)
        matrix, gradient = normal.matrix * (unit[:, None] * unit), normal.gradient * unit
        return cls(time, actuation, search, unit, state, normal, matrix, gradient)

    @property
    def mean(self) -> Array:
        """Where it is linearized, in units."""
        return np.concatenate((self.state.x, self.state.e)) / self.unit

    def bent(self, mean: Array) -> bool:
        """Whether the linearization does not reach so far: the change of slopes is as that of the numbers' scales."""
        step = mean - self.mean
        size = np.abs(step * self.unit / self.search.sought.whole_scale)[: len(self.state.x)].max()
        return bool(size * np.sqrt(step @ self.matrix @ step) > _BENT)

    def at(self, mean: Array) -> Sample:
        """Linearized anew; as it was where the model cannot be evaluated."""
        search, state = self.search, self.state
        whole = np.clip(mean * self.unit, *search.sought.whole_bounds)
        x, e = np.split(whole, [len(state.x)])
        z = state.z + state.follow @ np.concatenate(([1.0], x - state.x))
        found = search.at(z, x, self.normal.places(state, whole - self.mean * self.unit), e)
        return self if found is None else Sample.of(self.time, self.actuation, search, self.unit, found)


class Window:
    """The last samples in the order of their times.

    ``drift (k, k)``: covariance of the walk in a second, in units; zero for errors. ``since``: time of the last sample
    that is not in the window any more; what it and those before it told is in ``before``.
    """

    def __init__(self, before: Belief, drift: Array, horizon: int) -> None:
        self.before, self.since = before, -np.inf
        self.samples: list[Sample] = []
        self.means: list[Array] = []
        self._predictions: list[Belief] = []
        self._beliefs: list[Belief] = []
        self._drift, self._horizon = drift, horizon

    def predicted(self, time: float) -> Belief:
        """From all samples that are not later."""
        return self._predicted(bisect_right(self._times, time), time)

    def nearest(self, time: float) -> State | None:
        """The state of the sample before a time, or of the first."""
        return self.samples[max(bisect_right(self._times, time) - 1, 0)].state if self.samples else None

    def add(self, sample: Sample) -> None:
        """Estimate all samples with another one; the oldest leaves a window that is full."""
        first = bisect_right(self._times, sample.time)
        self.samples.insert(first, sample)
        self._pass(first)
        for _ in range(_MOST_PASSES):
            bent = [k for k, each in enumerate(self.samples) if each.bent(self.means[k])]
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
        return [each.time for each in self.samples]

    def _predicted(self, k: int, time: float) -> Belief:
        """For a time, from the samples before the one with number k."""
        belief, since = (self._beliefs[k - 1], self.samples[k - 1].time) if k else (self.before, self.since)
        return belief if np.isinf(since) else belief.later(self._drift * (time - since))

    def _pass(self, first: int) -> None:
        """Forwards from a sample, which gives beliefs by all up to each, and backwards, which gives the means."""
        del self._predictions[first:], self._beliefs[first:]
        for k, each in enumerate(self.samples[first:], first):
            belief = self._predicted(k, each.time)
            self._predictions.append(belief)
            self._beliefs.append(belief.told(each.matrix, each.gradient + each.matrix @ (belief.mean - each.mean)))
        self.means = [self._beliefs[-1].mean]
        for belief, predicted in zip(self._beliefs[-2::-1], self._predictions[:0:-1], strict=True):
            self.means.insert(0, belief.given(predicted, self.means[0]))
