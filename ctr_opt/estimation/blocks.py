"""Blocks of an experiment's misfit: their losses, and the estimated places of points."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from .losses import Loss
from .measurements import Measurement
from .places import Orders, eliminated, free, orders


def form(measurements: Sequence[Measurement]) -> tuple[object, ...]:
    """What the measurements of experiments must share, beside their observables, to share a model and blocks."""
    return *((type(measurement), measurement.shape) for measurement in measurements), orders(measurements)


@attrs.frozen(eq=False, slots=False)
class Blocks:
    """Consecutive blocks (points, poses) of ``sizes`` numbers under a loss; ``orders`` groups the estimated places."""

    loss: str
    sizes: NDArray[np.intp]
    orders: Orders

    @classmethod
    def of(cls, measurements: Sequence[Measurement], loss: str) -> Blocks:
        """The blocks of an experiment's measurements."""
        counts, sizes = np.array([measurement.shape for measurement in measurements], dtype=np.intp).T
        return cls(loss, np.repeat(sizes, counts), orders(measurements))

    @cached_property
    def starts(self) -> NDArray[np.intp]:
        """Index of each block's first number."""
        return np.cumsum(self.sizes) - self.sizes

    @cached_property
    def places(self) -> int:
        """Number of estimated places."""
        return self.orders[-1][1] if self.orders else 0

    @cached_property
    def plain(self) -> bool:
        """Whether the loss is the plain sum of squares."""
        return self.loss == "squared"

    @cached_property
    def _ones(self) -> Array:
        return np.ones(int(self.sizes.sum()))

    @cached_property
    def _loss(self) -> Loss:
        same = len(set(self.sizes.tolist())) == 1
        return Loss(self.loss, self.sizes[0] if same else self.sizes)

    def losses(self, misfit: Array) -> tuple[Array, Array, Array]:
        """``rho``, ``rho'``, ``rho''`` of misfits ``(..., numbers)`` by squared norms, each ``(..., blocks)``."""
        return self._loss.evaluate(np.add.reduceat(misfit**2, self.starts, axis=-1))

    def weights(self, misfit: Array) -> tuple[Array, Array]:
        """The loss of misfits ``(..., numbers)``, and twice its slopes by the numbers' squares; ones if plain."""
        if self.plain:
            return 0.5 * np.einsum("...n,...n->...", misfit, misfit), self._ones
        rho, first, _ = self.losses(misfit)
        return rho.sum(axis=-1), np.repeat(2.0 * first, self.sizes, axis=-1)

    def along(self, slopes: Array, places: Array) -> Array:
        """Slopes of misfits by the free places, pooled places together; zero by fixed places."""
        return np.asarray(slopes @ free(places, self.orders))

    def expanded(self, misfit: Array, rows: Array, along: Array, *, positive: bool) -> tuple[Array, Array, Array]:
        """Second-order model of the losses, block by block, with the places eliminated.

        ``rows (..., numbers, k)`` are slopes by the unknowns, ``along`` slopes by places. Returns losses
        ``(..., blocks)``, gradients ``(..., blocks, k)`` and the Hessian of their sum ``(..., k, k)``, without second
        derivatives of the misfits. ``positive`` keeps the curvature along a residual from being negative.
        """
        rho, first, second = self.losses(misfit)
        both, kept = np.concatenate((rows, along), axis=-1), rows.shape[-1]
        pulls = np.add.reduceat(misfit[..., None] * both, self.starts, axis=-2)
        weights = np.repeat(2.0 * first, self.sizes, axis=-1)
        hessian = np.matmul(np.swapaxes(both, -1, -2), weights[..., None] * both)
        if second.any():
            bend = 4.0 * second
            if positive:
                squared = np.maximum(np.add.reduceat(misfit**2, self.starts, axis=-1), 1e-300)
                bend = np.maximum(bend, -2.0 * first / squared)
            hessian += np.matmul(np.swapaxes(pulls, -1, -2), bend[..., None] * pulls)
        gradients = 2.0 * first[..., None] * pulls
        cross, curvatures = hessian[..., kept:, :kept], np.diagonal(hessian, axis1=-2, axis2=-1)[..., kept:]
        inner = eliminated(hessian[..., :kept, :kept], gradients[..., :kept], cross, curvatures, gradients[..., kept:])
        return rho, inner[1], inner[0]
