"""Estimated places of measured points: their start values, their steps, and their elimination.

Places are fractions of the robot's length, from 0 at the entry point to 1 at the tip. They belong to their experiment,
like its base moments. A misfit depends on the place of its own point only. All computations are therefore separate for
each point, except for points that are kept in their order.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from ..checks import Array
from ..forward.equilibrium import Equilibrium
from .experiment import Experiment
from .losses import Loss
from .measurements import BackboneMeasurement, Measurement

Orders: TypeAlias = tuple[tuple[int, int, bool], ...]
"""First and last place of each measurement with points, and whether its places are in order."""

_NODES, _PARTS = 49, 8  # points of a shape, and parts of each line between them: the grid of places


def orders(measurements: Sequence[Measurement]) -> Orders:
    """The orders of an experiment's measurements."""
    points = [one for one in measurements if isinstance(one, BackboneMeasurement)]
    ends = np.cumsum([len(one.position) for one in points]).tolist()
    return tuple((end - len(one.position), end, one.ordered) for one, end in zip(points, ends, strict=True))


def nearest(experiment: Experiment, shape: Equilibrium, loss: str) -> Array:
    """Grid places along a shape with the least total loss of the whitened distances to the points."""
    measured = [one for one in experiment.measurements if isinstance(one, BackboneMeasurement)]
    if not measured:
        return np.zeros(0)
    nodes, fractions = np.linspace(0.0, 1.0, _NODES), np.linspace(0.0, 1.0, (_NODES - 1) * _PARTS + 1)
    points = shape.position(nodes * shape.length)
    along = np.stack([np.interp(fractions, nodes, axis) for axis in points.T], axis=1)
    places = []
    for points_measured in measured:
        gaps, whitener = along - points_measured.position[:, None], points_measured.whitener_for(loss)
        costs = Loss(loss, 3).evaluate((np.einsum("kij,kgj->kgi", whitener, gaps) ** 2).sum(axis=2))[0]
        places.append(fractions[_in_order(costs) if points_measured.ordered else costs.argmin(axis=1)])
    return np.concatenate(places)


def _in_order(costs: Array) -> list[int]:
    """Non-decreasing columns, one for each row, with the least sum of costs: dynamic programming."""
    total = np.zeros(costs.shape[1])
    before = []
    for row in costs:
        least = np.minimum.accumulate(total)
        before.append(np.maximum.accumulate(np.where(total <= least, np.arange(len(row)), 0)))
        total = least + row
    columns = [int(total.argmin())]
    for chosen in before[:0:-1]:
        columns.append(int(chosen[columns[-1]]))
    return columns[::-1]


def moved(places: Array, slopes: Array, curvatures: Array, groups: Orders) -> Array:
    """Places ``(..., k)`` that minimize a separable second-order model of a loss, from 0 to 1 and in order.

    Places that violate the order are pooled (isotonic regression).
    """
    from scipy.optimize import isotonic_regression

    there = places - slopes / curvatures
    for start, end, ordered in groups:
        for where in np.ndindex(there.shape[:-1] if ordered else 0):
            part = there[where][start:end]
            part[:] = isotonic_regression(part, weights=curvatures[where][start:end]).x
    return np.asarray(np.clip(there, 0.0, 1.0))


def pulls(misfit: Array, along: Array, weights: Array) -> tuple[Array, Array]:
    """Slopes and curvatures ``(..., k)`` of a loss by places, from weights and the misfits' slopes ``along`` them."""
    return np.einsum("...n,...nk->...k", weights * misfit, along), np.einsum("...n,...nk->...k", weights, along**2)


def free(places: Array, groups: Orders) -> Array:
    """Directions in which places ``(..., k)`` may move, as columns ``(..., k, k)``.

    A place moves in its own column, or in that of the first place in its pool. Places at the entry point or the tip are
    fixed: their columns are zero.
    """
    first = np.ones(places.shape, dtype=bool)
    for start, end, ordered in groups:
        if ordered:
            first[..., start + 1 : end] = places[..., start + 1 : end] > places[..., start : end - 1]
    pools = np.cumsum(first, axis=-1)
    moves = first & (places > 0.0) & (places < 1.0)
    return np.asarray((pools[..., :, None] == pools[..., None, :]) & moves[..., None, :], dtype=np.float64)


def across(slopes: Array, along: Array) -> Array:
    """Slopes ``(numbers, j)`` projected off the columns of ``along``, no two of which share a row."""
    return np.asarray(slopes - along @ _over(along.T @ slopes, (along**2).sum(axis=0)))


def eliminated(
    hessian: Array, gradients: Array, cross: Array, curvatures: Array, by_place: Array
) -> tuple[Array, Array]:
    """Hessian ``(..., j, j)`` and gradients ``(..., blocks, j)`` of the unknowns with the places eliminated.

    This is the Schur complement; places do not couple with each other. ``cross (..., k, j)`` are second derivatives by
    both, ``curvatures (..., k)`` those by places, and ``by_place (..., blocks, k)`` gradients by places.
    """
    follow = _over(cross, curvatures)
    return hessian - np.swapaxes(cross, -1, -2) @ follow, gradients - by_place @ follow


def _over(rows: Array, curvatures: Array) -> Array:
    """Rows divided by their curvatures; rows without curvature are zero."""
    return np.asarray(rows / np.where(curvatures == 0.0, 1.0, curvatures)[..., None])
