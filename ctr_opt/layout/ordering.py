"""Order of break points along the arc length: which points have been passed at each position.

A section lies between two positions of the order, and may have no length. For a given order the answers are numbers.
For an order sorted by expressions they are symbols, zero or one, and the order is part of the function.

An expression cannot be moved in a list by its value, but its position can be counted. The rank of a break point is the
number of points that come before it, a sum of comparisons, ``rank_b = sum_a [s_a < s_b]``. A sum picks the point at a
position, ``place_k = sum_b [rank_b = k] s_b``, and a point has been passed if ``rank_b <= k``. Comparisons have no
derivative, so derivatives of places and data are those in the present order. Ranks of coinciding points must differ:
the order of the list breaks ties. To keep rounding from breaking them, coinciding points are all compared by the least
of their values.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import reduce
from itertools import pairwise
from typing import Any, TypeAlias

import attrs
import casadi as ca

Key: TypeAlias = tuple[Any, ...]
"""Name of a break point: ``("tube", i, j)``, the end of piece ``j``; ``("load", k, field)``; and so on."""

ENTRY: Key = ("entry",)
"""The break point ``s = 0``."""

Side: TypeAlias = tuple[int, int]
"""A position among the break points, with 0 before it or 1 behind it."""

PASSED: Key = ("passed",)
AHEAD: Key = ("ahead",)
"""Break points that always lie before all others, and behind all others."""


@attrs.frozen(eq=False)
class Order:
    """Ordered break points.

    Attributes
    ----------
    places
        ``s`` of the positions; the first is 0, the last is the length.
    ranks
        Position of every break point; negative (or the first) behind the entry point.
    behind
        ``s`` of every break point behind the entry point, zero for one in front of it.
    """

    places: list[Any]
    ranks: Mapping[Key, Any]
    behind: Mapping[Key, Any]

    @property
    def sections(self) -> int:
        """Number of sections."""
        return len(self.places) - 1

    @property
    def every_side(self) -> list[Side]:
        """All sides: behind the starts of the sections, then before their ends."""
        return [(k, 1) for k in range(self.sections)] + [(k + 1, 0) for k in range(self.sections)]

    def passed(self, key: Key, position: int) -> Any:
        """Return one if the break point is at the position or before it."""
        if key in (PASSED, AHEAD):
            return float(key == PASSED)
        rank = self.ranks[key]
        return float(rank <= position) if isinstance(rank, int) else rank <= position

    def at(self, key: Key, position: int) -> Any:
        """Return one if the break point is at the position."""
        rank = self.ranks[key]
        return float(rank == position) if isinstance(rank, int) else rank == position

    def sides(self, key: Key, end: Key, slack: float) -> Any:
        """Weights ``(2 sections,)`` of every side: one for the side where values at a break point are taken.

        It is the start of the section behind all points that coincide with it. If ``end`` is reached, it is the end of
        the section before all of them.
        """
        s, stop = (sum(self.at(point, k) * place for k, place in enumerate(self.places)) for point in (key, end))
        starts = [(a <= s + slack) * (b > s + slack) for a, b in pairwise(self.places)]
        ends = [(a < s - slack) * (b >= s - slack) for a, b in pairwise(self.places)]
        reached = stop <= s + slack
        return ca.vertcat(*(start * (1 - reached) for start in starts), *(end * reached for end in ends))

    def within(self, start: Key, end: Key, section: int) -> Any:
        """Return one if the section lies between two break points."""
        return self.passed(start, section) * (1.0 - self.passed(end, section))


def given_order(points: Mapping[Key, Any], keys: list[Key]) -> Order:
    """Make the order of ``keys``; points listed before the entry point lie behind it."""
    front = keys[keys.index(ENTRY) :]
    ranks = {key: front.index(key) if key in front else -1 for key in keys}
    places = [0.0, *(points[key] for key in front[1:])]
    return Order(places, ranks, {key: points[key] if rank < 0 else 0.0 for key, rank in ranks.items()})


def sorted_order(points: Mapping[Key, Any], behind: Collection[Key], ends: Mapping[Key, Any], slack: float) -> Order:
    """Sort points by the values of their expressions, which are equal within a ``slack``.

    The values ``ends`` of the tubes' ends, equal for coinciding ends, are used in comparisons. Points in ``behind``
    never come in front of the entry point. Among equal points those of tubes come last, the innermost tube's first. No
    section then lies behind the robot's end, and compiled code has the same order.
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
