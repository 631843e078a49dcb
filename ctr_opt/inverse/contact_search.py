"""Where a contact may be: at many places along a tube, the force that explains the measurements best to first order."""

from __future__ import annotations

import numpy as np

from ..robot.checks import Array
from ..robot.loads import PointWrench
from .force_case import Case
from .loaded_model import loaded_model

_PLACES = 24
_BEST = 3


def contacts(case: Case, z: Array, places: Array) -> list[Array]:
    """Starts of the search: for each contact in turn, the places of least loss, those found before being held."""
    starts = [case.start.copy()]
    for part in case.contacts:
        starts = [found for start in starts for found in _likely(case, z, places, start, part)]
        starts = starts[: _BEST * _BEST]
    return starts


def _likely(case: Case, z: Array, places: Array, x: Array, part: slice) -> list[Array]:
    """Copies of ``x`` with a contact, whose numbers are ``part`` of it, at each of the best places."""
    sought, search = case.search.sought, case.search
    tube = case.numbered.unknown[case.numbered.parts.index(part)].tube  # type: ignore[attr-defined]
    at = part.stop - 1
    grid = sought.lower[at] + (np.arange(_PLACES) + 0.5) / _PLACES * (sought.upper[at] - sought.lower[at])
    held = case.loads_at(x)
    loads = [*held, *(PointWrench([0.0] * 3, arc_length=float(s), tube=tube) for s in grid)]
    names = [f"loads[{len(held) + k}].force" for k in range(_PLACES)]
    model = loaded_model(
        case.robot, case.experiment.actuation, loads, names, (), case.experiment.requests, case.compiled, lambda: 1
    )
    told = model.at(z, np.zeros(3 * _PLACES), places * search.length)
    n = model.unknowns
    misfit, rates = (each[0] for each in search.seen.comparison.compare(told.predictions))
    follow = -np.linalg.solve(told.slopes[:, :n], np.column_stack((told.residual, told.slopes[:, n:])))
    misfit = misfit + rates[:, :n] @ follow[:, 0]
    slopes = rates[:, n:] + rates[:, :n] @ follow[:, 1:]
    _, weights = search.seen.weights(misfit)
    information = sought.prior_information[part, part][:3, :3]
    costs, forces = np.empty(_PLACES), np.empty((_PLACES, 3))
    for k in range(_PLACES):
        own = slopes[:, 3 * k : 3 * k + 3]
        matrix = own.T @ (weights[:, None] * own) + information
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        matrix = matrix / np.outer(scale, scale) + 1e-6 * np.eye(3)
        pull = own.T @ (weights * misfit) - information @ sought.prior_mean[part][:3]
        forces[k] = -np.linalg.solve(matrix, pull / scale) / scale
        left = misfit + own @ forces[k]
        costs[k] = search.seen.weights(left)[0]
    least = [k for k in range(_PLACES) if costs[k] <= min(costs[max(k - 1, 0) : k + 2])]
    found = []
    for k in sorted(least, key=lambda k: float(costs[k]))[:_BEST]:
        start = x.copy()
        start[part.start : part.start + 3], start[at] = forces[k], grid[k]
        found.append(start)
    return found
