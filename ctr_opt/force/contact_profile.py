"""Profile likelihood of a contact's place: the least loss with the contact held at places along its tube."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import attrs
import numpy as np

from ..checks import Array
from ..estimation.chi_square import quantile
from .case import Case
from .search import SearchState

LEVEL = 0.95
_PLACES = 33  # along the tube
_EDGE = 1e-4  # of the length: tolerance of interval ends
_ARRIVED = 1e-2  # standard deviations of the forces: the loss is then accurate to 1e-4
_SAME = 1e-3  # difference of losses below which solutions count as the same
_FAR = 1e6  # excess loss of a place without a solution

Interval: TypeAlias = tuple[float, float]


@attrs.frozen(eq=False)
class Profile:
    """The best states with one contact, whose numbers are ``part``, at places along its tube in ascending order."""

    case: Case
    part: slice
    states: list[SearchState]

    @classmethod
    def of(cls, case: Case, part: slice, known: Sequence[SearchState], resting: SearchState) -> Profile:
        """Walk away from ``known`` states; the search at each place starts from the neighbouring place.

        If that search fails, it starts from ``resting``, the robot without the unknown loads.
        """
        at = part.stop - 1
        unknowns = case.search.unknowns
        grid = np.linspace(unknowns.lower[at], unknowns.upper[at], _PLACES)
        best = {_place(state, at): state for state in known}
        for state in known or [resting]:
            for way in (grid[grid > state.x[at]], grid[grid < state.x[at]][::-1]):
                _walk(case, at, state, way, resting, best)
        return cls(case, part, [best[s] for s in sorted(best)])

    def least(self) -> SearchState:
        """The state of least loss."""
        return min(self.states, key=lambda state: state.cost)

    def within(self, level: float) -> list[Interval]:
        """Intervals, m, that contain the place with probability ``level``.

        Inside them the excess loss is below half the quantile of chi-square with one degree of freedom, as the loss is
        half the sum of squares.
        """
        at, least, reach = self.part.stop - 1, self.least().cost, float(np.sqrt(quantile(level, 1)))

        def beyond(state: SearchState | None) -> float:
            return float(np.sqrt(2.0 * (_FAR if state is None else max(state.cost - least, 0.0)))) - reach

        intervals: list[Interval] = []
        start: float | None = None
        for k, state in enumerate(self.states):
            s = _place(state, at)
            if beyond(state) <= 0.0 and start is None:
                start = s if k == 0 else self._edge(state, self.states[k - 1], beyond)
            if beyond(state) > 0.0 and start is not None:
                intervals.append((start, self._edge(self.states[k - 1], state, beyond)))
                start = None
        return intervals if start is None else [*intervals, (start, _place(self.states[-1], at))]

    def _edge(self, inside: SearchState, outside: SearchState, beyond: Callable[[SearchState | None], float]) -> float:
        """The place between two states where the excess loss crosses its threshold."""
        from scipy.optimize import brentq

        at = self.part.stop - 1
        known = {_place(state, at): state for state in (inside, outside)}

        def here(s: float) -> float:
            return beyond(known[s] if s in known else _held(self.case, at, s, inside))

        a, b = known
        return float(brentq(here, a, b, xtol=_EDGE * self.case.search.length))


def _place(state: SearchState, at: int) -> float:
    return float(state.x[at])


def _walk(
    case: Case, at: int, state: SearchState, way: Array, resting: SearchState, best: dict[float, SearchState]
) -> None:
    """Walk from place to place and keep better states in ``best``; stop where an earlier walk found the same."""
    for s in way.tolist():
        here = _held(case, at, s, state) or _held(case, at, s, resting)
        if here is None:
            continue
        state = here
        if s in best and abs(here.cost - best[s].cost) < _SAME:
            return
        if s not in best or here.cost < best[s].cost:
            best[s] = here


def _held(case: Case, at: int, s: float, start: SearchState) -> SearchState | None:
    """The state of least loss with the unknown number ``at`` held at ``s``."""
    unknowns, x = case.search.unknowns, start.x.copy()
    lower, upper = unknowns.lower.copy(), unknowns.upper.copy()
    x[at] = lower[at] = upper[at] = s
    held = attrs.evolve(unknowns, lower=lower, upper=upper)
    return attrs.evolve(case.search, unknowns=held, arrived=_ARRIVED).solve(start.z, x, start.places)
