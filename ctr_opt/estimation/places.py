"""Places of measured points that are estimated: where they start, how they move, and how they are eliminated.

They are fractions of the robot's length, from 0 at the entry point to 1 at the tip, and belong to their experiment like
its base moments. As a misfit depends on the place of its own point alone, all that is done here is done point by point,
but for points that are kept in their order.
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
"""Of each measurement with points: where its places begin and end, and whether they are in order."""

_NODES, _PARTS = 49, 8  # points of a shape, straight lines between them, and parts of each: where places are sought


def orders(measurements: Sequence[Measurement]) -> Orders:
    """Those of an experiment's measurements."""
    points = [one for one in measurements if isinstance(one, BackboneMeasurement)]
    ends = np.cumsum([len(one.position) for one in points]).tolist()
    return tuple((end - len(one.position), end, one.ordered) for one, end in zip(points, ends, strict=True))


def nearest(experiment: Experiment, shape: Equilibrium, loss: str) -> Array:
    """The places of a grid along a shape where the losses of the squared whitened distances are least, together."""
    measured = [one for one in experiment.measurements if isinstance(one, BackboneMeasurement)]
    if not measured:
        return np.zeros(0)
    nodes, fractions = np.linspace(0.0, 1.0, _NODES), np.linspace(0.0, 1.0, (_NODES - 1) * _PARTS + 1)
    points = shape.position(nodes * shape.length)
    along = np.stack([np.interp(fractions, nodes, axis) for axis in points.T], axis=1)
    places = []
    for one in measured:
        gaps, whitener = along - one.position[:, None], one.whitener_for(loss)
        costs = Loss(loss, 3).evaluate((np.einsum("kij,kgj->kgi", whitener, gaps) ** 2).sum(axis=2))[0]
        places.append(fractions[_in_order(costs) if one.ordered else costs.argmin(axis=1)])
    return np.concatenate(places)


def _in_order(costs: Array) -> list[int]:
    """Columns, none before that of the row above, whose costs have the least sum: dynamic programming."""
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


def moved(places: Array, slopes: Array, curvatures: Array, those: Orders) -> Array:
    """Places ``(..., k)`` of the least second-order model of a loss, separate for each, from 0 to 1 and in order.

    What stands against the order is pooled (isotonic regression).
    """
    from scipy.optimize import isotonic_regression

    there = places - slopes / curvatures
    for start, end, ordered in those:
        for where in np.ndindex(there.shape[:-1] if ordered else 0):
            part = there[where][start:end]
            part[:] = isotonic_regression(part, weights=curvatures[where][start:end]).x
    return np.asarray(np.clip(there, 0.0, 1.0))


def pulls(misfit: Array, along: Array, weights: Array) -> tuple[Array, Array]:
    """Slopes ``(..., k)`` and curvatures of a loss by places, from those of misfits ``along`` them and its weights."""
    return np.einsum("...n,...nk->...k", weights * misfit, along), np.einsum("...n,...nk->...k", weights, along**2)


def free(places: Array, those: Orders) -> Array:
    """The ways in which places ``(..., k)`` may move, as columns ``(..., k, k)``.

    A place moves in its own column, or in that of the first one with which it is pooled; those at the entry point or
    the tip do not, and leave their columns zero.
    """
    first = np.ones(places.shape, dtype=bool)
    for start, end, ordered in those:
        if ordered:
            first[..., start + 1 : end] = places[..., start + 1 : end] > places[..., start : end - 1]
    pools = np.cumsum(first, axis=-1)
    moves = first & (places > 0.0) & (places < 1.0)
    return np.asarray((pools[..., :, None] == pools[..., None, :]) & moves[..., None, :], dtype=np.float64)


def across(slopes: Array, along: Array) -> Array:
    """Slopes ``(numbers, j)`` without what the columns of ``along``, no two of which share a row, can explain."""
    return np.asarray(slopes - along @ _over(along.T @ slopes, (along**2).sum(axis=0)))


def eliminated(
    hessian: Array, gradients: Array, cross: Array, curvatures: Array, by_place: Array
) -> tuple[Array, Array]:
    """Hessian ``(..., j, j)`` and gradients ``(..., blocks, j)`` of unknowns that places follow at their best.

    Schur complement of the places, none of which acts on another: second derivatives by both, ``cross (..., k, j)``,
    ``curvatures (..., k)`` by places, and gradients ``by_place (..., blocks, k)``.
    """
    follow = _over(cross, curvatures)
    return hessian - np.swapaxes(cross, -1, -2) @ follow, gradients - by_place @ follow


def _over(rows: Array, curvatures: Array) -> Array:
    """Rows over their curvatures, zero where there is none."""
    return np.asarray(rows / np.where(curvatures == 0.0, 1.0, curvatures)[..., None])
