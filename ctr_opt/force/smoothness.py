"""How smooth a distributed force is: the weight of its roughness that makes the measurements most likely (evidence).

Around a state loads act linearly and errors are normal, so that the marginal likelihood of a weight ``w`` is known:
``-log p = least loss + 1/2 log det(D + w R) - rank(R)/2 log w + const``, with the information ``D`` of the measurements
and what else is known of the loads, and the roughness ``x' R x`` (MacKay, Neural Computation 4, 1992).
"""

from __future__ import annotations

from collections.abc import Callable

import attrs
import numpy as np

from .case import Case
from .search import Normal, State

_ROUGHEST, _SMOOTHEST = -12, 0  # powers of ten where the search ends, by the weight of equal traces of data and prior
_LIKELY = 2.0  # how much less likely, as a logarithm, a weight may be than the best
_SAME = 0.05  # relative change of weights that are not chosen anew
_ROUNDS = 8
_NEARLY = 0.3  # standard deviations: how close to the least loss a weight is chosen
_NONE = 1e-13  # of eigenvalues: what counts as zero


def smoothed(case: Case, weight: float) -> Case:
    """The case with a weight, from one without."""
    sought = case.search.sought
    information = sought.prior_information + weight * np.asarray(case.roughness)
    search = attrs.evolve(case.search, sought=attrs.evolve(sought, prior_information=information))
    return attrs.evolve(case, search=search)


def smoothest(case: Case, start: State) -> tuple[Case, State | None]:
    """The case with the weight that agrees with the state of least loss by it, and that state."""
    state, weight = start, likeliest(case, start)
    for _ in range(_ROUNDS):
        rough = smoothed(case, weight).search
        found = attrs.evolve(rough, arrived=_NEARLY).solve(state.z, state.x, state.places)
        if found is None:
            break
        state, before = found, weight
        weight = likeliest(case, state)
        if abs(np.log(weight / before)) < _SAME:
            break
    chosen = smoothed(case, weight)
    return chosen, chosen.search.solve(state.z, state.x, state.places)


def likeliest(case: Case, state: State) -> float:
    """The least weight whose marginal likelihood is not far below the greatest, to first order around a state.

    Where measurements tell little a straight line is the likeliest of all, and its errors are far too small.
    """
    from scipy.linalg import eigh
    from scipy.optimize import minimize_scalar

    information, gradient = Normal.of(case.search, state).reduced(len(state.x))
    pull = information @ state.x - gradient  # the loss is x' D x / 2 - pull' x + const, without their roughness
    scale = case.search.sought.scale
    information, rough = (each * np.outer(scale, scale) for each in (information, np.asarray(case.roughness)))
    unit = float(np.trace(information) / np.trace(rough))
    both = information + unit * rough
    shares, vectors = eigh(unit * rough, both + _NONE * np.trace(both) / len(both) * np.eye(len(both)))
    parts, rank = vectors.T @ (scale * pull), int(np.linalg.matrix_rank(rough))
    shares[:-rank] = 0.0

    def unlikely(logarithm: float) -> float:
        known = np.maximum(1.0 - shares, 0.0) + np.exp(logarithm) * shares
        return float(0.5 * (np.log(known) - parts**2 / known).sum() - 0.5 * rank * logarithm)

    grid = np.log(10.0) * np.arange(_ROUGHEST, _SMOOTHEST + 1)
    best = float(grid[np.argmin([unlikely(each) for each in grid])])
    found = minimize_scalar(unlikely, bounds=(best - np.log(10.0), best + np.log(10.0)), method="bounded")
    return unit * float(np.exp(_least(unlikely, float(found.x), float(grid[0]))))


def _least(unlikely: Callable[[float], float], best: float, lowest: float) -> float:
    """The least logarithm of a weight that is not much less likely than the best."""
    from scipy.optimize import brentq

    allowed = unlikely(best) + _LIKELY
    steps = np.arange(best, lowest, -0.5 * np.log(10.0))
    beyond = next((float(step) for step in steps if unlikely(step) > allowed), None)
    if beyond is None:
        return lowest
    return float(brentq(lambda step: unlikely(step) - allowed, beyond, min(beyond + 0.5 * np.log(10.0), best)))
