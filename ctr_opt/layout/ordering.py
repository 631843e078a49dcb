"""The order of break points along the arc length: which of them have been passed where.

A section lies between two positions of the order, and may have no length. With a given order the answers are numbers;
sorted by expressions they are symbols, zero or one, and the order is then part of the function.

An expression cannot be moved in a list by its value, but its position can be counted. The rank of a break point is the
number of those that come before it, a sum of comparisons, ``rank_b = sum_a [s_a < s_b]``. What stands at a position is
a sum that picks it, ``place_k = sum_b [rank_b = k] s_b``, and a point has been passed where ``rank_b <= k``.
Comparisons have no derivative: derivatives of places and data are those in the present order. Ranks must differ where
points coincide, so that the list breaks ties. So that rounding breaks none, points are compared by the least of those
that are the same point, which is one number for all of them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import reduce
from itertools import pairwise
from typing import Any, TypeAlias

import attrs
import casadi as ca

Key: TypeAlias = tuple[Any, ...]
"""What a break point belongs to: ``("tube", i, j)``, the end of its piece ``j``; ``("load", k, field)``; and so on."""

ENTRY: Key = ("entry",)
"""The break point ``s = 0``."""

Side: TypeAlias = tuple[int, int]
"""A position among the break points, and 0 before it or 1 behind it."""

PASSED: Key = ("passed",)
AHEAD: Key = ("ahead",)
"""Break points that lie before all others and behind them, wherever these are."""


@attrs.frozen(eq=False)
class Order:
    """Break points in their order.

    Attributes
    ----------
    places
        ``s`` of the positions, the first of them 0, the last one the length.
    ranks
        The position of every break point; negative (or the first) behind the entry point.
    behind
        ``s`` of a break point as far as it is behind the entry point, zero in front of it.
    """

    places: list[Any]
    ranks: Mapping[Key, Any]
    behind: Mapping[Key, Any]

    @property
    def sections(self) -> int:
        """How many sections there are."""
        return len(self.places) - 1

    @property
    def every_side(self) -> list[Side]:
        """Behind the starts of all sections, then before their ends."""
        return [(k, 1) for k in range(self.sections)] + [(k + 1, 0) for k in range(self.sections)]

    def passed(self, key: Key, position: int) -> Any:
        """One if the break point is at the position or before it."""
        if key in (PASSED, AHEAD):
            return float(key == PASSED)
        rank = self.ranks[key]
        return float(rank <= position) if isinstance(rank, int) else rank <= position

    def at(self, key: Key, position: int) -> Any:
        """One if the break point is the one of the position."""
        rank = self.ranks[key]
        return float(rank == position) if isinstance(rank, int) else rank == position

    def sides(self, key: Key, end: Key, slack: float) -> Any:
        """Weights ``(2 sections,)`` of every side, one where values at a break point are to be taken.

        It is the start of the section behind all that coincides with the point, or where ``end`` is reached, the end of
        the section before all that does.
        """
        s, stop = (sum(self.at(each, k) * place for k, place in enumerate(self.places)) for each in (key, end))
        starts = [(a <= s + slack) * (b > s + slack) for a, b in pairwise(self.places)]
        ends = [(a < s - slack) * (b >= s - slack) for a, b in pairwise(self.places)]
        reached = stop <= s + slack
        return ca.vertcat(*(each * (1 - reached) for each in starts), *(each * reached for each in ends))

    def within(self, start: Key, end: Key, section: int) -> Any:
        """One if the section lies between two break points."""
        return self.passed(start, section) * (1.0 - self.passed(end, section))


def given_order(points: Mapping[Key, Any], keys: list[Key]) -> Order:
    """The order of ``keys``, those before the entry point behind it."""
    front = keys[keys.index(ENTRY) :]
    ranks = {key: front.index(key) if key in front else -1 for key in keys}
    places = [0.0, *(points[key] for key in front[1:])]
    return Order(places, ranks, {key: points[key] if rank < 0 else 0.0 for key, rank in ranks.items()})


def sorted_order(points: Mapping[Key, Any], behind: Collection[Key], ends: Mapping[Key, Any], slack: float) -> Order:
    """The order of the points by the values of their expressions, which are equal within a ``slack``.

    The tubes' ``ends`` are compared by these values, made equal where they are one point. Those of ``behind`` never
    come in front of the entry point. Of equal ones the tubes' own come last, the innermost's first, so that no section
    lies behind the robot's end, and compiled code has the same order.
    """
    keys = [key for key in points if key != ENTRY and key not in behind]
    keys = [ENTRY, *sorted(keys, key=lambda key: key[0] == "tube")]
    where, near = (
        {key: ca.if_else(of[key] > slack, of[key], 0) for key in keys[1:]} | {ENTRY: ca.SX(0)}
        for of in (points, {**points, **ends})
    )
    least = {b: reduce(ca.fmin, [ca.if_else(near[a] < s - slack, s, near[a]) for a in keys]) for b, s in near.items()}
    ranks: dict[Key, Any] = dict.fromkeys(behind, -1) | {ENTRY: 0}
    for j, b in enumerate(keys[1:], 1):
        earlier = [least[a] <= least[b] for a in keys[:j]]
        ranks[b] = sum([*earlier, *(least[a] < least[b] for a in keys[j + 1 :])], ca.SX(0))
    places: list[Any] = [0.0]
    places += [sum(((ranks[key] == k) * where[key] for key in keys[1:]), ca.SX(0)) for k in range(1, len(keys))]
    return Order(places, ranks, {key: points[key] - where.get(key, 0.0) for key in points})
