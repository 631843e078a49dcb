"""Comparison of the times of calls, taken in turns so that other work on the computer affects all of them alike.

The fastest call of each counts, because disturbances only add time.
"""

import gc
from time import perf_counter_ns

import attrs
import numpy as np

_BATCH = 200_000  # ns: quicker calls are timed several at once
_SLICE = 4_000_000  # ns: how long a quick call is repeated before it is the next one's turn
_WARM_UP = 2  # calls that are not timed


@attrs.frozen
class Effort:
    """Effort of a measurement: seconds per comparison, least number of turns, and neighbours to go to."""

    seconds: float
    turns: int
    neighbours: int


def fastest(actions, effort):
    """Seconds of the fastest call of each of some actions, without garbage collection."""
    batches = [max(1, _BATCH // _warmed(action)) for action in actions]
    best, turns = np.full(len(actions), np.inf), 0
    gc.disable()
    try:
        until = perf_counter_ns() + int(1e9 * effort.seconds)
        while turns < effort.turns or perf_counter_ns() < until:
            for k, (action, batch) in enumerate(zip(actions, batches, strict=True)):
                best[k] = min(best[k], _slice(action, batch))
            turns += 1
    finally:
        gc.enable()
    return 1e-9 * best


def _warmed(action):
    """Nanoseconds of a call, after a warm-up."""
    for _ in range(_WARM_UP):
        begin = perf_counter_ns()
        action()
        once = perf_counter_ns() - begin
    return max(once, 1)


def _slice(action, batch):
    """Nanoseconds of the fastest call while it is its turn."""
    best, until = np.inf, perf_counter_ns() + _SLICE
    while True:
        begin = perf_counter_ns()
        for _ in range(batch):
            action()
        end = perf_counter_ns()
        best = min(best, (end - begin) / batch)
        if end > until:
            return best
