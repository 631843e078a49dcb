"""Smoothness of a distributed force: the weight of its roughness by marginal likelihood (evidence).

Around a state loads act linearly and errors are normal. The marginal likelihood of a weight ``w`` is then closed-form:
``-log p = least loss + 1/2 log det(D + w R) - rank(R)/2 log w + const``, with the information ``D`` of the measurements
and other priors, and the roughness ``x' R x`` (MacKay, Neural Computation 4, 1992).
"""

from __future__ import annotations

from collections.abc import Callable

import attrs
import numpy as np

from .case import Case
from .search import Normal, SearchState

_ROUGHEST, _SMOOTHEST = -12, 0  # powers of ten where the search ends, by the weight of equal traces of data and prior
_LIKELY = 2.0  # logarithm of the evidence by which a weight may be below the best
_SAME = 0.05  # relative change of weights below which the iteration ends
_ROUNDS = 8
_NEARLY = 0.3  # standard deviations: tolerance of the search while the weight is chosen
_NONE = 1e-13  # of eigenvalues: what counts as zero


def smoothed(case: Case, weight: float) -> Case:
    """The case with a given weight of the roughness."""
    unknowns = case.search.unknowns
    information = unknowns.prior_information + weight * np.asarray(case.roughness)
    search = attrs.evolve(case.search, unknowns=attrs.evolve(unknowns, prior_information=information))
    return attrs.evolve(case, search=search)


def smoothest(case: Case, start: SearchState) -> tuple[Case, SearchState | None]:
    """The case with a self-consistent weight, and its state of least loss."""
    state, weight = start, likeliest(case, start)
    for _ in range(_ROUNDS):
        rough = smoothed(case, weight).search
        ahead = attrs.evolve(rough, arrived=_NEARLY).solve(state.z, state.x, state.places)
        if ahead is None:
            break
        state, before = ahead, weight
        weight = likeliest(case, state)
        if abs(np.log(weight / before)) < _SAME:
            break
    chosen = smoothed(case, weight)
    return chosen, chosen.search.solve(state.z, state.x, state.places)


def likeliest(case: Case, state: SearchState) -> float:
    """The smallest weight whose evidence is within a factor ``e^2`` of the maximum, linearized around a state.

    With little information the maximum itself is at a straight line, whose errors are far too small.
    """
    from scipy.linalg import eigh
    from scipy.optimize import minimize_scalar

    information, gradient = Normal.of(case.search, state).reduced(len(state.x))
    pull = information @ state.x - gradient  # the loss is x' D x / 2 - pull' x + const, without the roughness
    scale = case.search.unknowns.scale
    information, rough = (form * np.outer(scale, scale) for form in (information, np.asarray(case.roughness)))
    unit = float(np.trace(information) / np.trace(rough))
    both = information + unit * rough
    shares, vectors = eigh(unit * rough, both + _NONE * np.trace(both) / len(both) * np.eye(len(both)))
    parts, rank = vectors.T @ (scale * pull), int(np.linalg.matrix_rank(rough))
    shares[:-rank] = 0.0

    def unlikely(logarithm: float) -> float:
        known = np.maximum(1.0 - shares, 0.0) + np.exp(logarithm) * shares
        return float(0.5 * (np.log(known) - parts**2 / known).sum() - 0.5 * rank * logarithm)

    grid = np.log(10.0) * np.arange(_ROUGHEST, _SMOOTHEST + 1)
    best = float(grid[np.argmin([unlikely(logarithm) for logarithm in grid])])
    refined = minimize_scalar(unlikely, bounds=(best - np.log(10.0), best + np.log(10.0)), method="bounded")
    return unit * float(np.exp(_least(unlikely, float(refined.x), float(grid[0]))))


def _least(unlikely: Callable[[float], float], best: float, lowest: float) -> float:
    """The least logarithm of a weight whose evidence is close enough to the best."""
    from scipy.optimize import brentq

    allowed = unlikely(best) + _LIKELY
    steps = np.arange(best, lowest, -0.5 * np.log(10.0))
    beyond = next((float(step) for step in steps if unlikely(step) > allowed), None)
    if beyond is None:
        return lowest
    return float(brentq(lambda step: unlikely(step) - allowed, beyond, min(beyond + 0.5 * np.log(10.0), best)))
