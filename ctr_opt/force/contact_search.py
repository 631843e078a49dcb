"""Where contacts may be: of many places along the tubes, those whose forces explain the measurements best.

To first order about the robot without the unknown loads, and all contacts together.
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
_STEPS = 1  # in each section, in the virtual machine: there are many with so many loads
_RIDGE = 1e-6  # of the squared sensitivities: forces of which the measurements know less stay small

Chosen: TypeAlias = tuple[int, ...]


def contacts(case: Case, z: Array, places: Array) -> list[Array]:
    """Starts of the search, the likeliest first: places where the loss has a minimum, and no force there yet."""
    scan = _Scan.of(case, z, places)
    losses: dict[Chosen, float] = {(): 0.0}
    for part in case.contacts:
        kept = sorted(losses, key=lambda chosen: losses[chosen])[:_PLACES]
        losses = scan.losses([(*chosen, k) for chosen in kept for k in scan.beyond(chosen, part)])
    least = [chosen for chosen in losses if all(losses[chosen] <= losses.get(other, np.inf) for other in _next(chosen))]
    return [scan.start(chosen) for chosen in sorted(least, key=lambda chosen: losses[chosen])[:_BEST]]


def _next(chosen: Chosen) -> list[Chosen]:
    """With one of the places moved by one."""
    return [(*chosen[:i], chosen[i] + step, *chosen[i + 1 :]) for i in range(len(chosen)) for step in (-1, 1)]


@attrs.frozen(eq=False)
class _Scan:
    """Candidate places, ``grid (m,)`` on ``tubes (m,)``, and the loss to second order by all numbers together.

    Those are the numbers of unknown loads other than contacts, and behind them three of a force at every place.
    """

    case: Case
    grid: Array
    tubes: NDArray[np.intp]
    others: int
    matrix: Array
    gradient: Array

    @classmethod
    def of(cls, case: Case, z: Array, places: Array) -> _Scan:
        """About base moments without the unknown loads."""
        every = sorted({case.contact(part).tube for part in case.contacts})
        tubes = np.repeat(np.array(every, dtype=np.intp), _PLACES)
        grid = np.concatenate([(np.arange(_PLACES) + 0.5) / _PLACES * case.ends.of(tube) for tube in every])
        misfit, by_sought, by_forces = _linearized(case, _model(case, grid, tubes), z, places, 3 * len(grid))
        others = np.ones(by_sought.shape[1], dtype=bool)
        for part in case.contacts:
            others[part] = False
        slopes = np.hstack((by_sought[:, others], by_forces))
        weighted = case.search.blocks.weights(misfit)[1][:, None] * slopes
        matrix, gradient = slopes.T @ weighted, weighted.T @ misfit
        k = int(others.sum())
        matrix[:k, :k] += case.search.sought.prior_information[np.ix_(others, others)]
        return cls(case, grid, tubes, k, matrix, gradient)

    def beyond(self, chosen: Chosen, part: slice) -> list[int]:
        """Places where a contact can be, behind those chosen already: the order of contacts on one tube means nothing.

        Of those beyond its bounds the ones next to them: a start is brought inside.
        """
        tube, sought, at = self.case.contact(part).tube, self.case.search.sought, part.stop - 1
        before = [k for k in chosen if self.tubes[k] == tube]
        off = np.abs(self.grid - np.clip(self.grid, sought.lower[at], sought.upper[at]))
        there = (self.tubes == tube) & (off <= 0.5 * self.case.ends.of(tube) / _PLACES)
        return [int(k) for k in np.flatnonzero(there) if not before or k > before[-1]]

    def losses(self, sets: Sequence[Chosen]) -> dict[Chosen, float]:
        """What is left of the loss, less what it is without the loads, with forces at the chosen places at their best.

        Every set holds as many places, those of the first contacts in their order.
        """
        from scipy.linalg import block_diag

        chosen = np.array(sets, dtype=np.intp)
        forces = (self.others + 3 * chosen[:, :, None] + np.arange(3)).reshape(len(sets), -1)
        rows = np.hstack((np.tile(np.arange(self.others), (len(sets), 1)), forces))
        matrices, pulls = self.matrix[rows[:, :, None], rows[:, None, :]], self.gradient[rows]
        parts = self.case.contacts[: chosen.shape[1]]
        turn = np.asarray(
            block_diag(np.eye(self.others), *(self.case.contact(part).resultant[:, :-1] for part in parts))
        )
        matrices, pulls = turn.T @ matrices @ turn, pulls @ turn
        sought, start = self.case.search.sought, self.others
        for part in parts:
            forces_of = slice(part.start, part.stop - 1)
            own = slice(start, start := start + forces_of.stop - forces_of.start)
            known = sought.prior_information[forces_of, forces_of]
            matrices[:, own, own] += known
            pulls[:, own] -= known @ sought.prior_mean[forces_of]
        scale = np.sqrt(np.maximum(np.diagonal(matrices, axis1=1, axis2=2), 1e-300))
        matrices = matrices / (scale[:, :, None] * scale[:, None, :]) + _RIDGE * np.eye(turn.shape[1])
        pulls = pulls / scale
        won = -0.5 * np.einsum("ij,ij->i", pulls, np.linalg.solve(matrices, pulls[:, :, None])[:, :, 0])
        return dict(zip(sets, won.tolist(), strict=True))

    def start(self, chosen: Chosen) -> Array:
        """The numbers sought, with the contacts at their places."""
        found = self.case.start
        for part, k in zip(self.case.contacts, chosen, strict=True):
            found[part] = 0.0
            found[part.stop - 1] = self.grid[k]
        return found


def _model(case: Case, grid: Array, tubes: NDArray[np.intp]) -> LoadedModel:
    """With a force, zero, at every place behind the loads that are there; kept for cases of equal places."""
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
    """Misfits and their slopes by the numbers sought and by those of the forces, the robot kept in equilibrium."""
    from scipy.linalg import block_diag

    mixing = case.search.sought.mixing
    turn = np.asarray(block_diag(mixing, np.eye(count)))
    here = case.search.linearized(model, z, np.append(mixing @ case.start, np.zeros(count)), turn, places)
    known = mixing.shape[1]
    return here.settled, here.reduced[:, :known], here.reduced[:, known:]
