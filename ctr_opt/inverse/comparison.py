"""Predictions beside measurements, for all experiments of a group together."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..robot.checks import Array
from .measurements import Measurement, Predicted


class Comparison:
    """The measurements of experiments that were all measured in the same way: ``(experiments, measurements)``.

    ``whitener``: of a measurement.
    """

    def __init__(self, measurements: Sequence[Sequence[Measurement]], whitener: Callable[[Measurement], Array]) -> None:
        self._columns = list(zip(*measurements, strict=True))  # the same measurement in all experiments
        self._whiteners = [np.array([whitener(each) for each in column]) for column in self._columns]

    def compare(self, predictions: Sequence[Predicted]) -> tuple[Array, Array]:
        """Whitened misfits ``(experiments, numbers)`` and their derivatives, from predictions of all experiments."""
        misfits, rates, start = [], [], 0
        for column, whitener in zip(self._columns, self._whiteners, strict=True):
            end = start + len(column[0].requests)
            values, slopes = column[0].compare(column, predictions[start:end])
            start, count = end, len(column)
            misfits.append(np.matmul(whitener, values[..., None]).reshape(count, -1))
            rates.append(np.matmul(whitener, slopes).reshape(count, -1, slopes.shape[-1]))
        return np.concatenate(misfits, axis=1), np.concatenate(rates, axis=1)
