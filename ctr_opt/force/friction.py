"""A contact with Coulomb friction: its force inside the cone, or on its surface where the free answer is outside.

On the surface the force is ``a (n + mu (cos phi t1 + sin phi t2))`` with ``a >= 0``: for every ``phi`` the search is
one of a force along a given direction, and of all ``phi`` that of the least loss is taken.
"""

from __future__ import annotations

import attrs
import numpy as np

from ..checks import Array
from .case import Case
from .search import State

_DIRECTIONS = 12  # around the cone, before the best is refined
_ANGLE = 1e-7  # rad
_ROUNDING = 1e-9  # of characteristic forces


def within_cone(case: Case, state: State) -> State | None:
    """The state, or that of least loss on the cone of the contact with friction; None where none is found."""
    for part, unknown in zip(case.numbered.parts, case.numbered.unknown, strict=True):
        if unknown.cone is not None:
            cone = _Cone.of(case, part, *unknown.cone)
            return state if cone.holds(state) else cone.surface(state)
    return state


@attrs.frozen(eq=False)
class _Cone:
    """The cone of one contact, whose force is ``part`` of the numbers sought: normal, and two directions across it."""

    case: Case
    part: slice
    friction: float
    normal: Array
    across: Array

    @classmethod
    def of(cls, case: Case, part: slice, normal: Array, friction: float) -> _Cone:
        return cls(case, part, friction, normal, np.linalg.svd(normal[None])[2][1:].T)

    def holds(self, state: State) -> bool:
        """Whether the force is inside."""
        force = state.x[self.part]
        push = float(self.normal @ force)
        slack = _ROUNDING * self.case.search.sought.scale[self.part.start]
        return bool(np.linalg.norm(self.across.T @ force) <= self.friction * push + slack)

    def surface(self, start: State) -> State | None:
        """The least loss on the surface, with the directions in which the numbers may move there."""
        from scipy.optimize import minimize_scalar

        tried: dict[float, State] = {}
        near = start

        def loss(angle: float) -> float:
            nonlocal near
            found = self._along(angle, near)
            if found is None:
                return np.inf
            tried[angle] = near = found
            return found.cost

        step = 2.0 * np.pi / _DIRECTIONS
        first = float(np.arctan2(*(self.across.T @ start.x[self.part])[::-1]))
        best = min((first + step * k for k in range(_DIRECTIONS)), key=loss)
        near = tried.get(best, start)
        minimize_scalar(loss, bounds=(best - step, best + step), method="bounded", options={"xatol": _ANGLE})
        if not tried:
            return None
        angle = min(tried, key=lambda each: tried[each].cost)
        return attrs.evolve(tried[angle], tangent=self._tangent(angle, tried[angle]))

    def _along(self, angle: float, start: State) -> State | None:
        """The least loss with a force along one line of the surface."""
        search, turn = self.case.search, self._reduction(self._direction(angle))
        sought, k = search.sought, self.part.start
        information = turn.T @ sought.prior_information @ turn
        mean = np.linalg.lstsq(information, turn.T @ sought.prior_information @ sought.prior_mean)[0]
        kept = np.delete(np.arange(len(turn)), [k + 1, k + 2])
        lower = sought.lower[kept].copy()
        lower[k] = 0.0
        reduced = attrs.evolve(
            sought,
            mixing=sought.mixing @ turn,
            scale=sought.scale[kept],
            prior_mean=np.asarray(mean, dtype=np.float64),
            prior_information=information,
            lower=lower,
            upper=sought.upper[kept],
            at_places=sought.at_places[kept],
        )
        x = np.asarray(np.linalg.lstsq(turn, start.x)[0], dtype=np.float64)
        found = attrs.evolve(search, sought=reduced).solve(start.z, x, start.places)
        return None if found is None else search.at(found.z, turn @ found.x, found.places, found.e)

    def _direction(self, angle: float) -> Array:
        return np.asarray(self.normal + self.friction * (self.across @ [np.cos(angle), np.sin(angle)]))

    def _reduction(self, direction: Array) -> Array:
        """All numbers, by those with one in the place of the force: its size along the direction."""
        count, k = len(self.case.numbered.labels), self.part.start
        turn = np.delete(np.eye(count), [k + 1, k + 2], axis=1)
        turn[self.part, k] = direction
        return turn

    def _tangent(self, angle: float, state: State) -> Array:
        """Directions on the surface, and of all other numbers; at the cone's apex of those alone."""
        push, k = float(self.normal @ state.x[self.part]), self.part.start
        turn = self._reduction(self._direction(angle))
        if push <= 0.0:
            return np.delete(turn, k, axis=1)
        around = np.zeros((len(turn), 1))
        around[self.part, 0] = push * self.friction * (self.across @ [-np.sin(angle), np.cos(angle)])
        return np.hstack((turn, around)) if self.friction > 0.0 else turn
