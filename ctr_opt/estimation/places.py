"""Places of measured points that are estimated: where they start, how they move, and how they are eliminated.

They are fractions of the robot's length, from 0 at the entry point to 1 at the tip, and belong to their experiment like
its base moments. As a misfit depends on the place of its own point alone, all that is done here is done point by point,
but for points that are kept in their order.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from ..checks import Array
from ..forward.equilibrium import Equilibrium
from .experiment import Experiment
from .measurements import BackboneMeasurement, Measurement

Orders: TypeAlias = tuple[tuple[int, int, bool], ...]
"""Of each measurement with points: where its places begin and end, and whether they are in order."""

_NODES, _PARTS = 49, 8  # points of a shape, straight lines between them, and parts of each: where places are sought


def orders(experiment: Experiment) -> Orders:
    """Those of an experiment."""
    found, start = [], 0
    for each in experiment.measurements:
        if isinstance(each, BackboneMeasurement):
            found.append((start, start := start + len(each.position), each.ordered))
    return tuple(found)


def nearest(
    experiment: Experiment,
    shape: Equilibrium,
    whitener: Callable[[Measurement], Array],
    loss: Callable[[Array], Array],
) -> Array:
    """The places of a grid along a shape where the losses of the squared whitened distances are least, together."""
    measured = [each for each in experiment.measurements if isinstance(each, BackboneMeasurement)]
    if not measured:
        return np.zeros(0)
    nodes, fractions = np.linspace(0.0, 1.0, _NODES), np.linspace(0.0, 1.0, (_NODES - 1) * _PARTS + 1)
    points = shape.position(nodes * shape.length)
    along = np.stack([np.interp(fractions, nodes, axis) for axis in points.T], axis=1)
    found = []
    for each in measured:
        gaps = along - each.position[:, None]
        costs = loss((np.einsum("kij,kgj->kgi", whitener(each), gaps) ** 2).sum(axis=2))
        found.append(fractions[_in_order(costs) if each.ordered else costs.argmin(axis=1)])
    return np.concatenate(found)


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

    found = places - slopes / curvatures
    for start, end, ordered in those:
        for where in np.ndindex(found.shape[:-1] if ordered else 0):
            own = found[where][start:end]
            own[:] = isotonic_regression(own, weights=curvatures[where][start:end]).x
    return np.asarray(np.clip(found, 0.0, 1.0))


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


def eliminated(hessian: Array, gradients: Array, count: int) -> tuple[Array, Array]:
    """Hessian ``(..., j, j)`` and gradients ``(..., blocks, j)`` of all unknowns but the last, which follow at best.

    Those are ``count`` places, none of which acts on another.
    """
    kept = hessian.shape[-1] - count
    own = np.diagonal(hessian, axis1=-2, axis2=-1)[..., kept:]
    follow = _over(hessian[..., kept:, :kept], own)
    inner, outer = (hessian[..., :kept, part] for part in (slice(kept), slice(kept, None)))
    return inner - outer @ follow, gradients[..., :kept] - gradients[..., kept:] @ follow


def _over(rows: Array, curvatures: Array) -> Array:
    """Rows over their curvatures, zero where there is none."""
    return np.asarray(rows / np.where(curvatures == 0.0, 1.0, curvatures)[..., None])
