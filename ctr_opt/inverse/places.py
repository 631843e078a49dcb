"""Places of measured points that are estimated: where they start, how they move, and how they are eliminated.

They are fractions of the robot's length, from 0 at the entry point to 1 at the tip, and belong to their experiment like
its base moments. As a misfit depends on the place of its own point alone, all that is done here is done point by point,
but for points that are kept in their order.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from ..equilibrium import Equilibrium
from ..robot.checks import Array
from .experiment import Experiment
from .measurements import BackboneMeasurement, Measurement

Orders: TypeAlias = tuple[tuple[int, int, bool], ...]
"""Of each measurement with points: where its places begin and end, and whether they are in order."""

_GRID = 401  # places among which the first ones are sought


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
    fractions = np.linspace(0.0, 1.0, _GRID)
    found = [np.zeros(0)]
    for each in experiment.measurements:
        if isinstance(each, BackboneMeasurement):
            gaps = shape.position(fractions * shape.length) - each.position[:, None]
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
    """Places of the least second-order model of a loss, with a curvature of each, between 0 and 1 and in order.

    What stands against the order is pooled (isotonic regression).
    """
    from scipy.optimize import isotonic_regression

    found = places - slopes / curvatures
    for start, end, ordered in those:
        if ordered:
            found[start:end] = isotonic_regression(found[start:end], weights=curvatures[start:end]).x
    return np.asarray(np.clip(found, 0.0, 1.0))


def free(places: Array, those: Orders) -> Array:
    """The ways in which places may move, ``(places, k)``: each on its own, pooled ones together, none at an end."""
    rows = []
    for start, end, ordered in those:
        own = places[start:end]
        first = np.ones(end - start, dtype=bool)
        if ordered:
            first[1:] = own[1:] > own[:-1]
        for member in np.cumsum(first) == np.arange(1, first.sum() + 1)[:, None]:
            if 0.0 < own[member][0] < 1.0:
                rows.append(np.zeros(len(places)))
                rows[-1][start:end] = member
    return np.reshape(rows, (len(rows), len(places))).T


def across(slopes: Array, along: Array) -> Array:
    """Slopes ``(numbers, k)`` with what the columns of ``along``, of which no two share a row, can explain removed."""
    if not along.shape[1]:
        return slopes
    return np.asarray(slopes - along @ ((along.T @ slopes) / (along**2).sum(axis=0)[:, None]))


def eliminated(hessian: Array, gradients: Array, kept: int) -> tuple[Array, Array]:
    """A Hessian, and gradients ``(blocks, unknowns)``, of the first unknowns, the others following at their best."""
    follow = np.linalg.solve(hessian[kept:, kept:], hessian[kept:, :kept])
    return hessian[:kept, :kept] - hessian[:kept, kept:] @ follow, gradients[:, :kept] - gradients[:, kept:] @ follow
