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
        self._columns = [_Column(list(column), whitener) for column in zip(*measurements, strict=True)]

    def compare(self, predictions: Sequence[Predicted]) -> tuple[Array, Array]:
        """Whitened misfits ``(experiments, numbers)`` and their derivatives, from predictions of all experiments."""
        misfits, rates, start = [], [], 0
        for column in self._columns:
            misfit, rate = column.compare(predictions[start : start + column.requests])
            start += column.requests
            misfits.append(misfit)
            rates.append(rate)
        return np.concatenate(misfits, axis=1), np.concatenate(rates, axis=1)


class _Column:
    """The same measurement in all experiments."""

    def __init__(self, measurements: list[Measurement], whitener: Callable[[Measurement], Array]) -> None:
        self.measurements = measurements
        self.requests = len(measurements[0].requests)
        self._whitener = np.array([whitener(each) for each in measurements])

    def compare(self, found: Sequence[Predicted]) -> tuple[Array, Array]:
        values, rates = self.measurements[0].compare(self.measurements, found)
        count = len(values)
        misfit = np.matmul(self._whitener, values[..., None])[..., 0]
        return misfit.reshape(count, -1), np.matmul(self._whitener, rates).reshape(count, -1, rates.shape[-1])
