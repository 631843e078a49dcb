"""Predictions beside measurements, for all experiments of a group together."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..robot.checks import Array
from .measurements import Measurement, PositionMeasurement, Predicted


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
        self._positions = (
            np.array([each.position for each in measurements if isinstance(each, PositionMeasurement)])
            if all(isinstance(each, PositionMeasurement) for each in measurements)
            else None
        )

    def compare(self, found: Sequence[Predicted]) -> tuple[Array, Array]:
        if self._positions is not None:  # by far the most, so all at once
            values = np.stack([each.value[:, :3, 3] for each in found], axis=1) - self._positions
            rates = np.stack([each.slopes[:, :3] for each in found], axis=1)
        else:
            own = [
                each.compare([Predicted(one.value[e], one.slopes[e]) for one in found])
                for e, each in enumerate(self.measurements)
            ]
            values, rates = np.array([value for value, _ in own]), np.array([rate for _, rate in own])
        count = len(values)
        misfit = np.matmul(self._whitener, values[..., None])[..., 0]
        return misfit.reshape(count, -1), np.matmul(self._whitener, rates).reshape(count, -1, rates.shape[-1])
