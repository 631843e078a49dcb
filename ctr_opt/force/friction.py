"""A contact with Coulomb friction: its force inside the cone, or on the surface if the free estimate is outside.

On the surface the force is ``a (n + mu (cos phi t1 + sin phi t2))`` with ``a >= 0``. Each ``phi`` is a search
for a force along a given direction. The ``phi`` of least loss is chosen.
"""

from __future__ import annotations

import attrs
import numpy as np

from ..checks import Array
from .case import Case
from .search import SearchState

_DIRECTIONS = 12  # around the cone, before the best is refined
_ANGLE = 1e-7  # rad
_ROUNDING = 1e-9  # of characteristic forces


def within_cone(case: Case, state: SearchState) -> SearchState | None:
    """The state if its force is in the friction cone, else the best one on the surface; None if that fails."""
    for part, unknown in zip(case.numbered.parts, case.numbered.unknown, strict=True):
        if unknown.cone is not None:
            cone = _ContactCone.of(case, part, *unknown.cone)
            return state if cone.holds(state) else cone.surface(state)
    return state


@attrs.frozen(eq=False)
class _ContactCone:
    """The friction cone of one contact, whose force is ``part`` of the unknown numbers."""

    case: Case
    part: slice
    friction: float
    normal: Array
    across: Array

    @classmethod
    def of(cls, case: Case, part: slice, normal: Array, friction: float) -> _ContactCone:
        return cls(case, part, friction, normal, np.linalg.svd(normal[None])[2][1:].T)

    def holds(self, state: SearchState) -> bool:
        """Whether the force is inside the cone."""
        force = state.x[self.part]
        push = float(self.normal @ force)
        slack = _ROUNDING * self.case.search.unknowns.scale[self.part.start]
        return bool(np.linalg.norm(self.across.T @ force) <= self.friction * push + slack)

    def surface(self, start: SearchState) -> SearchState | None:
        """The state of least loss on the surface, with its free directions."""
        from scipy.optimize import minimize_scalar

        tried: dict[float, SearchState] = {}
        near = start

        def loss(angle: float) -> float:
            nonlocal near
            state = self._along(angle, near)
            if state is None:
                return np.inf
            tried[angle] = near = state
            return state.cost

        step = 2.0 * np.pi / _DIRECTIONS
        first = float(np.arctan2(*(self.across.T @ start.x[self.part])[::-1]))
        best = min((first + step * k for k in range(_DIRECTIONS)), key=loss)
        near = tried.get(best, start)
        minimize_scalar(loss, bounds=(best - step, best + step), method="bounded", options={"xatol": _ANGLE})
        if not tried:
            return None
        angle = min(tried, key=lambda angle: tried[angle].cost)
        return attrs.evolve(tried[angle], tangent=self._tangent(angle, tried[angle]))

    def _along(self, angle: float, start: SearchState) -> SearchState | None:
        """The state of least loss with the force along one line of the surface."""
        search, turn = self.case.search, self._reduction(self._direction(angle))
        unknowns, k = search.unknowns, self.part.start
        information = turn.T @ unknowns.prior_information @ turn
        mean = np.linalg.lstsq(information, turn.T @ unknowns.prior_information @ unknowns.prior_mean)[0]
        kept = np.delete(np.arange(len(turn)), [k + 1, k + 2])
        lower = unknowns.lower[kept].copy()
        lower[k] = 0.0
        reduced = attrs.evolve(
            unknowns,
            mixing=unknowns.mixing @ turn,
            scale=unknowns.scale[kept],
            prior_mean=np.asarray(mean, dtype=np.float64),
            prior_information=information,
            lower=lower,
            upper=unknowns.upper[kept],
            at_places=unknowns.at_places[kept],
        )
        x = np.asarray(np.linalg.lstsq(turn, start.x)[0], dtype=np.float64)
        state = attrs.evolve(search, unknowns=reduced).solve(start.z, x, start.places)
        return None if state is None else search.at(state.z, turn @ state.x, state.places, state.e)

    def _direction(self, angle: float) -> Array:
        return np.asarray(self.normal + self.friction * (self.across @ [np.cos(angle), np.sin(angle)]))

    def _reduction(self, direction: Array) -> Array:
        """Matrix from numbers with one force size along a direction to all unknown numbers."""
        count, k = len(self.case.numbered.labels), self.part.start
        turn = np.delete(np.eye(count), [k + 1, k + 2], axis=1)
        turn[self.part, k] = direction
        return turn

    def _tangent(self, angle: float, state: SearchState) -> Array:
        """Free directions: along the surface and of all other numbers; at the apex of the other numbers only."""
        push, k = float(self.normal @ state.x[self.part]), self.part.start
        turn = self._reduction(self._direction(angle))
        if push <= 0.0:
            return np.delete(turn, k, axis=1)
        around = np.zeros((len(turn), 1))
        around[self.part, 0] = push * self.friction * (self.across @ [-np.sin(angle), np.cos(angle)])
        return np.hstack((turn, around)) if self.friction > 0.0 else turn
