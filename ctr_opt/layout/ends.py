"""Ends of tubes, and the tube at an arc length.

Lengths and translations are decimal numbers, so ends that are meant to coincide differ by rounding. One rule decides
which ends coincide, for numbers, arrays, symbols and compiled code: sorted, an end within ``SAME_POINT`` of the
robot's length of the one before it is the same point. A chain of such ends becomes its largest end. Another break
point is at a tube's end if it is that close to it. A tube that ends at a point still exists there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, reduce
from math import inf
from typing import Any

import attrs
import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..robot.robot import Robot

SAME_POINT = 1e-12  # of the robot's length: closer points are one point


@attrs.frozen(eq=False, slots=False)
class Ends:
    """Ends of the tubes, m, from the entry point; ends that differ by rounding are made equal.

    Examples
    --------
    >>> ends = Ends.at([0.1, 0.1 - 1e-17, 0.06])
    >>> ends.length, ends.innermost(), ends.innermost(0.06)
    (0.1, 0, 0)
    >>> ends.snap([0.03, 0.06 + 1e-16]).tolist()
    [0.03, 0.06]
    """

    points: tuple[float, ...]
    length: float

    @classmethod
    def at(cls, ends: Sequence[float]) -> Ends:
        """Make ends from computed ones: a chain becomes its largest end, ends at the entry become zero.

        It does the same as :func:`chained` for one robot; sorting is faster.
        """
        slack = SAME_POINT * max(ends)
        snapped, last, before = {}, 0.0, inf
        for end in sorted(ends, reverse=True):
            if before - end > slack:
                last = 0.0 if 0.0 < end <= slack else end
            snapped[end], before = last, end
        return cls(tuple([snapped[end] for end in ends]), snapped[max(ends)])

    @classmethod
    def of_robot(cls, robot: Robot, translations: Array) -> Ends:
        """Make the ends of a robot at these ``translations (tubes,)``, m."""
        return cls.at(_computed(robot, translations))

    @classmethod
    def tube_at_tip(cls, robot: Robot, translations: Array) -> int:
        """Find the innermost tube at a robot's tip: a fast ``of_robot(...).innermost()`` for control loops."""
        ends = _computed(robot, translations)
        last = max(ends)
        near = last - SAME_POINT * last
        for end in ends:
            if end >= near and end is not last:
                return cls.at(ends).innermost()
        return ends.index(last)

    @property
    def slack(self) -> float:
        """Distance within which points coincide, m."""
        return SAME_POINT * self.length

    @cached_property
    def array(self) -> Array:
        """The ends ``(tubes,)``."""
        values = np.array(self.points)
        values.setflags(write=False)
        return values

    def of(self, tube: int | None) -> float:
        """Return the end of a tube, or of the robot for None."""
        return self.length if tube is None else self.points[tube]

    def snap(self, s: Any) -> Array:
        """Move arc lengths ``s`` that coincide with a tube's end exactly there."""
        near = np.abs(np.asarray(s)[..., None] - self.array) <= self.slack
        return np.asarray(np.where(near.any(axis=-1), self.array[near.argmax(axis=-1)], s))

    def reaches(self, tube: int | None, s: float) -> bool:
        """Whether a tube (None: any) exists at ``s``; its end belongs to it."""
        return s <= self.of(tube) + self.slack

    def innermost(self, s: float | None = None) -> int:
        """Find the innermost tube at ``s``; at the tip for None or an ``s`` beyond it."""
        if s is None or s >= self.length:
            return self.points.index(self.length)
        return next(i for i in range(len(self.points)) if self.reaches(i, s))

    def innermost_along(self, s: Array) -> NDArray[np.intp]:
        """Find the innermost tubes at arc lengths ``s (k,)``."""
        return innermost(self.array, s)


def _computed(robot: Robot, translations: Array) -> list[float]:
    return [tube.length + shift for tube, shift in zip(robot.tubes, translations.tolist(), strict=True)]


# -- many robots, and symbols ------------------------------------------------------------------------------------------


def chained(ends: Array) -> Array:
    """Make coinciding ends of tubes ``(..., tubes)`` equal."""
    slack = SAME_POINT * ends.max(axis=-1)
    return np.stack(_chained(list(np.moveaxis(ends, -1, 0)), slack, np.maximum, np.where), axis=-1)


def chained_symbols(ends: Sequence[Any], slack: float) -> list[Any]:
    """Make coinciding ends of tubes equal, as expressions; for comparisons."""
    return _chained([ca.SX(end) for end in ends], slack, ca.fmax, ca.if_else)


def _chained(ends: Sequence[Any], slack: Any, larger: Callable[..., Any], choose: Callable[..., Any]) -> list[Any]:
    """Replace each end by the largest end close to it, repeatedly; a chain has at most one link per other end."""
    last = list(ends)
    for _ in ends[1:]:
        last = [reduce(larger, [choose(end - s <= slack, end, s) for end in ends]) for s in last]
    return last


def innermost(ends: Array, s: Any = np.inf) -> NDArray[np.intp]:
    """Find the innermost tubes at ``s (...)``, at most the tip, for :func:`chained` ``ends (..., tubes)``."""
    length = ends.max(axis=-1)
    return np.asarray(np.argmax(ends >= (np.minimum(s, length) - SAME_POINT * length)[..., None], axis=-1))


def outermost_at_tip(ends: Array) -> NDArray[np.intp]:
    """Find the outermost tubes that end at the tip, for :func:`chained` ``ends (..., tubes)``."""
    return np.asarray(ends.shape[-1] - 1 - innermost(ends[..., ::-1]))


def first_at_tip(ends: Sequence[Any]) -> list[Any]:
    """Weights ``(tubes,)`` of :func:`chained_symbols`: one for the first that is the largest, zero for all others."""
    length, taken, weights = reduce(ca.fmax, ends), ca.SX(0), []
    for end in ends:
        weights.append(ca.logic_and(1 - taken, end == length))
        taken = ca.logic_or(taken, weights[-1])
    return weights
