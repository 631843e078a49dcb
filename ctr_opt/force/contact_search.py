"""Start places of contacts: the places along the tubes whose forces explain the measurements best.

All contacts are scanned together, to first order about the robot without the unknown loads.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..loads.point import PointWrench
from .case import Case
from .model import LoadedModel, loaded_model

_PLACES = 24  # along a tube
_BEST = 3  # starts
_STEPS = 1  # in each section, in the virtual machine: this number of loads gives many sections
_RIDGE = 1e-6  # of the squared sensitivities: forces that the measurements determine less stay small

Chosen: TypeAlias = tuple[int, ...]


def contacts(case: Case, z: Array, places: Array) -> list[Array]:
    """Starts of the search, the likeliest first: places at local minima of the loss, with zero forces."""
    scan = _Scan.of(case, z, places)
    losses: dict[Chosen, float] = {(): 0.0}
    for part in case.contacts:
        kept = sorted(losses, key=lambda chosen: losses[chosen])[:_PLACES]
        losses = scan.losses([(*chosen, k) for chosen in kept for k in scan.beyond(chosen, part)])
    least = [chosen for chosen in losses if all(losses[chosen] <= losses.get(near, np.inf) for near in _next(chosen))]
    return [scan.start(chosen) for chosen in sorted(least, key=lambda chosen: losses[chosen])[:_BEST]]


def _next(chosen: Chosen) -> list[Chosen]:
    """All neighbouring choices, with one place moved by one."""
    return [(*chosen[:i], chosen[i] + step, *chosen[i + 1 :]) for i in range(len(chosen)) for step in (-1, 1)]


@attrs.frozen(eq=False)
class _Scan:
    """Candidate places ``grid (m,)`` on ``tubes (m,)``, and a second-order model of the loss by all numbers.

    The numbers are those of unknown loads other than contacts, followed by three of a force at every place.
    """

    case: Case
    grid: Array
    tubes: NDArray[np.intp]
    rest: int
    matrix: Array
    gradient: Array

    @classmethod
    def of(cls, case: Case, z: Array, places: Array) -> _Scan:
        """The scan about the base moments without the unknown loads."""
        touched = sorted({case.contact(part).tube for part in case.contacts})
        tubes = np.repeat(np.array(touched, dtype=np.intp), _PLACES)
        grid = np.concatenate([(np.arange(_PLACES) + 0.5) / _PLACES * case.ends.of(tube) for tube in touched])
        misfit, by_unknowns, by_forces = _linearized(case, _model(case, grid, tubes), z, places, 3 * len(grid))
        rest = np.ones(by_unknowns.shape[1], dtype=bool)
        for part in case.contacts:
            rest[part] = False
        slopes = np.hstack((by_unknowns[:, rest], by_forces))
        weighted = case.search.blocks.weights(misfit)[1][:, None] * slopes
        matrix, gradient = slopes.T @ weighted, weighted.T @ misfit
        k = int(rest.sum())
        matrix[:k, :k] += case.search.unknowns.prior_information[np.ix_(rest, rest)]
        return cls(case, grid, tubes, k, matrix, gradient)

    def beyond(self, chosen: Chosen, part: slice) -> list[int]:
        """Possible places of the next contact, distal to those chosen: contacts on one tube are interchangeable.

        Places just beyond the bounds count too, as the search clips its start.
        """
        tube, unknowns, at = self.case.contact(part).tube, self.case.search.unknowns, part.stop - 1
        before = [k for k in chosen if self.tubes[k] == tube]
        off = np.abs(self.grid - np.clip(self.grid, unknowns.lower[at], unknowns.upper[at]))
        there = (self.tubes == tube) & (off <= 0.5 * self.case.ends.of(tube) / _PLACES)
        return [int(k) for k in np.flatnonzero(there) if not before or k > before[-1]]

    def losses(self, sets: Sequence[Chosen]) -> dict[Chosen, float]:
        """Loss with the best forces at each set of places, minus the loss without the loads.

        All sets have the same length and hold the places of the first contacts in order.
        """
        from scipy.linalg import block_diag

        chosen = np.array(sets, dtype=np.intp)
        forces = (self.rest + 3 * chosen[:, :, None] + np.arange(3)).reshape(len(sets), -1)
        rows = np.hstack((np.tile(np.arange(self.rest), (len(sets), 1)), forces))
        matrices, pulls = self.matrix[rows[:, :, None], rows[:, None, :]], self.gradient[rows]
        parts = self.case.contacts[: chosen.shape[1]]
        turn = np.asarray(block_diag(np.eye(self.rest), *(self.case.contact(part).resultant[:, :-1] for part in parts)))
        matrices, pulls = turn.T @ matrices @ turn, pulls @ turn
        unknowns, start = self.case.search.unknowns, self.rest
        for part in parts:
            forces_of = slice(part.start, part.stop - 1)
            columns = slice(start, start := start + forces_of.stop - forces_of.start)
            known = unknowns.prior_information[forces_of, forces_of]
            matrices[:, columns, columns] += known
            pulls[:, columns] -= known @ unknowns.prior_mean[forces_of]
        scale = np.sqrt(np.maximum(np.diagonal(matrices, axis1=1, axis2=2), 1e-300))
        matrices = matrices / (scale[:, :, None] * scale[:, None, :]) + _RIDGE * np.eye(turn.shape[1])
        pulls = pulls / scale
        won = -0.5 * np.einsum("ij,ij->i", pulls, np.linalg.solve(matrices, pulls[:, :, None])[:, :, 0])
        return dict(zip(sets, won.tolist(), strict=True))

    def start(self, chosen: Chosen) -> Array:
        """Start values of the unknown numbers, with the contacts at the chosen places."""
        x = self.case.start
        for part, k in zip(self.case.contacts, chosen, strict=True):
            x[part] = 0.0
            x[part.stop - 1] = self.grid[k]
        return x


def _model(case: Case, grid: Array, tubes: NDArray[np.intp]) -> LoadedModel:
    """A model with an added zero force at every place; cached for cases with the same places."""
    key = grid.tobytes()
    if key not in case.scans:
        held = case.loads_at(case.start)
        both = zip(grid.tolist(), tubes.tolist(), strict=True)
        loads = [*held, *(PointWrench([0.0] * 3, arc_length=s, tube=tube) for s, tube in both)]
        names = [*case.numbered.names, *(f"loads[{k}].force" for k in range(len(held), len(loads)))]
        experiment = case.experiment
        case.scans.clear()
        case.scans[key] = loaded_model(
            case.robot, experiment.actuation, loads, names, (), experiment.observables, case.compiled, lambda: _STEPS
        )
    case.scans[key].actuated(case.experiment.actuation)
    return case.scans[key]


def _linearized(case: Case, model: LoadedModel, z: Array, places: Array, count: int) -> tuple[Array, Array, Array]:
    """Misfits in equilibrium, and their slopes by the unknown numbers and by the forces at all places."""
    from scipy.linalg import block_diag

    mixing = case.search.unknowns.mixing
    turn = np.asarray(block_diag(mixing, np.eye(count)))
    here = case.search.linearized(model, z, np.append(mixing @ case.start, np.zeros(count)), turn, places)
    known = mixing.shape[1]
    return here.settled, here.reduced[:, :known], here.reduced[:, known:]
