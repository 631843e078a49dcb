"""Comparison of predictions with measurements, for all experiments of a group together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..checks import Array
from ..layout.observables import ObservedList, Somewhere, Stacked
from .measurements import Measurement


class Comparison:
    """Measurements ``(experiments, measurements)`` of experiments that share kinds and shapes of measurements."""

    def __init__(self, measurements: Sequence[Sequence[Measurement]], loss: str) -> None:
        self._columns = [_Column(list(column), loss) for column in zip(*measurements, strict=True)]

    def compare(self, predictions: ObservedList) -> tuple[Array, Array]:
        """Whitened misfits ``(experiments, numbers)`` and their derivatives, from predictions of all experiments."""
        if len(self._columns) == 1:
            return self._columns[0].compare(predictions)
        misfits, rates, start = [], [], 0
        for column in self._columns:
            misfit, rate = column.compare(predictions[start : start + column.observables])
            start += column.observables
            misfits.append(misfit)
            rates.append(rate)
        return np.concatenate(misfits, axis=1), np.concatenate(rates, axis=1)

    def along(self, predictions: ObservedList) -> Array:
        """Derivatives of the whitened misfits by the estimated arc lengths, ``(experiments, numbers, k)``.

        A point moves along the backbone's tangent at unit rate with its arc length; no other number changes.
        """
        size = sum(column.numbers for column in self._columns)
        count = sum(column.observables for column in self._columns if column.somewhere)
        slopes = np.zeros((len(predictions[0].value), size, count))
        row = place = start = 0
        for column in self._columns:
            observed = slice(start, start := start + column.observables)
            if column.somewhere:
                points = np.arange(column.observables)[:, None]
                slopes[:, row + 3 * points + np.arange(3), place + points] = column.tangents(predictions[observed])
                place += column.observables
            row += column.numbers
        return slopes


class _Column:
    """One measurement across all experiments of a group."""

    def __init__(self, measurements: list[Measurement], loss: str) -> None:
        self.measurements = measurements
        self.observables = len(measurements[0].observables)
        self.numbers = int(np.prod(measurements[0].shape))
        self.somewhere = isinstance(measurements[0].observables[0].place, Somewhere)
        self._whitener = np.array([measurement.whitener_for(loss) for measurement in measurements])

    def compare(self, predictions: ObservedList) -> tuple[Array, Array]:
        values, rates = self.measurements[0].compare(self.measurements, predictions)
        count = len(values)
        misfit = np.matmul(self._whitener, values[..., None])[..., 0]
        return misfit.reshape(count, -1), np.matmul(self._whitener, rates).reshape(count, -1, rates.shape[-1])

    def tangents(self, predictions: ObservedList) -> Array:
        """Whitened tangents of the backbone ``(experiments, points, 3)``."""
        tangents = Stacked.of(predictions).value[..., 2]
        return np.asarray(np.matmul(self._whitener, tangents[..., None])[..., 0])
