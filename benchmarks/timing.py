"""Times of calls: the fastest of several, as everything else that a computer does only adds to it."""

import gc
from time import perf_counter_ns

import attrs
import numpy as np

_BATCH = 200_000  # ns: quicker calls are timed several at once
_WARM_UP = 2  # calls that are not timed


@attrs.frozen
class Effort:
    """How long to measure: seconds on each call, calls (or batches) at least, and neighbours to go to."""

    seconds: float
    calls: int
    neighbours: int


def fastest(action, effort):
    """Seconds of the fastest call, without garbage collection."""
    for _ in range(_WARM_UP):
        begin = perf_counter_ns()
        action()
        once = perf_counter_ns() - begin
    batch, best, calls = max(1, _BATCH // max(once, 1)), np.inf, 0
    gc.disable()
    try:
        until = perf_counter_ns() + int(1e9 * effort.seconds)
        while calls < effort.calls or perf_counter_ns() < until:
            begin = perf_counter_ns()
            for _ in range(batch):
                action()
            best = min(best, (perf_counter_ns() - begin) / batch)
            calls += 1
    finally:
        gc.enable()
    return 1e-9 * best


def median(actions, effort):
    """The median of the fastest calls of several actions, s."""
    return float(np.median([fastest(action, effort) for action in actions]))
