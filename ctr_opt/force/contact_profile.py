"""Where a contact can be: the least loss with it held at places along its tube, one by one (profile likelihood)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import attrs
import numpy as np

from ..checks import Array
from ..estimation.chi_square import quantile
from .case import Case
from .search import State

LEVEL = 0.95
_PLACES = 33  # along the tube
_EDGE = 1e-4  # of the length: how closely ends of intervals are found
_ARRIVED = 1e-2  # standard deviations of the forces: the loss is then right to 1e-4
_SAME = 1e-3  # of losses: the same solution
_FAR = 1e6  # excess loss of a place where nothing is found

Interval: TypeAlias = tuple[float, float]


@attrs.frozen(eq=False)
class Profile:
    """The best states with the contact whose numbers are ``part`` at places along its tube, in their order."""

    case: Case
    part: slice
    states: list[State]

    @classmethod
    def of(cls, case: Case, part: slice, known: Sequence[State], resting: State) -> Profile:
        """Away from states that are ``known``, every place starting from the one next to it.

        Where that leads nowhere the start is the robot without the unknown loads, ``resting``.
        """
        at = part.stop - 1
        sought = case.search.sought
        grid = np.linspace(sought.lower[at], sought.upper[at], _PLACES)
        best = {_place(state, at): state for state in known}
        for state in known or [resting]:
            for way in (grid[grid > state.x[at]], grid[grid < state.x[at]][::-1]):
                _walk(case, at, state, way, resting, best)
        return cls(case, part, [best[s] for s in sorted(best)])

    def least(self) -> State:
        """Of least loss."""
        return min(self.states, key=lambda state: state.cost)

    def within(self, level: float) -> list[Interval]:
        """Intervals, m, that hold the place with this probability: the excess loss is below half of chi-square's.

        That is chi-square's quantile with one degree of freedom, as the loss is half the sum of squares.
        """
        at, least, reach = self.part.stop - 1, self.least().cost, float(np.sqrt(quantile(level, 1)))

        def beyond(state: State | None) -> float:
            return float(np.sqrt(2.0 * (_FAR if state is None else max(state.cost - least, 0.0)))) - reach

        found: list[Interval] = []
        start: float | None = None
        for k, state in enumerate(self.states):
            s = _place(state, at)
            if beyond(state) <= 0.0 and start is None:
                start = s if k == 0 else self._edge(state, self.states[k - 1], beyond)
            if beyond(state) > 0.0 and start is not None:
                found.append((start, self._edge(self.states[k - 1], state, beyond)))
                start = None
        return found if start is None else [*found, (start, _place(self.states[-1], at))]

    def _edge(self, inside: State, outside: State, beyond: Callable[[State | None], float]) -> float:
        """The place between two states where the loss leaves what is likely."""
        from scipy.optimize import brentq

        at = self.part.stop - 1
        known = {_place(state, at): state for state in (inside, outside)}

        def here(s: float) -> float:
            return beyond(known[s] if s in known else _held(self.case, at, s, inside))

        a, b = known
        return float(brentq(here, a, b, xtol=_EDGE * self.case.search.length))


def _place(state: State, at: int) -> float:
    return float(state.x[at])


def _walk(case: Case, at: int, state: State, way: Array, resting: State, best: dict[float, State]) -> None:
    """From place to place, keeping what is better than the ``best``, until where another walk has been."""
    for s in way.tolist():
        found = _held(case, at, s, state) or _held(case, at, s, resting)
        if found is None:
            continue
        state = found
        if s in best and abs(found.cost - best[s].cost) < _SAME:
            return
        if s not in best or found.cost < best[s].cost:
            best[s] = found


def _held(case: Case, at: int, s: float, start: State) -> State | None:
    """The least loss with number ``at`` of those sought being ``s``."""
    sought, x = case.search.sought, start.x.copy()
    lower, upper = sought.lower.copy(), sought.upper.copy()
    x[at] = lower[at] = upper[at] = s
    held = attrs.evolve(sought, lower=lower, upper=upper)
    return attrs.evolve(case.search, sought=held, arrived=_ARRIVED).solve(start.z, x, start.places)
