"""When to cut steps further to meet a tolerance, and when to give up."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .accuracy import Estimate

_REFINEMENTS = 7  # times all steps may be halved to reach the tolerance
_LOCAL_REFINEMENTS = 30  # times some may: loads with kinks are met by ever shorter steps there
_PROGRESS = 0.9  # of the error: cutting steps and gaining less meets a limit that is not the discretization's
_IDLE = 4  # times in succession that this may happen where some steps were cut, as a kink may lie badly once
_MOST_STEPS = 3000  # no mesh has more


class Refinement:
    """Into how many parts to cut the steps next, until it is of no use."""

    def __init__(self, tolerance: float) -> None:
        self._tolerance = tolerance
        self._best = np.inf
        self._whole = self._local = self._idle = 0

    def next(self, estimate: Estimate) -> NDArray[np.intp] | None:
        """The parts of every step; None to give up."""
        parts = estimate.parts(self._tolerance)
        whole = bool(np.all(parts > 1))
        self._whole += whole
        self._local += not whole
        self._idle = 0 if estimate.error <= _PROGRESS * self._best else self._idle + 1
        self._best = min(self._best, estimate.error)
        stuck = self._idle > (0 if whole else _IDLE)
        idle = parts.sum() == len(parts) or parts.sum() > _MOST_STEPS
        if stuck or idle or self._whole >= _REFINEMENTS or self._local >= _LOCAL_REFINEMENTS:
            return None
        return parts
