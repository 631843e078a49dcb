"""Gravity: the weight of tubes and masses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

import attrs

from ..checks import ARRAY_EQ, Array, Entry, described, unchecked
from .kind import Load, Number, Push


@attrs.frozen
class Gravity(Load):
    """Gravity on the robot: the weight of every tube with a density, and of all masses.

    Parameters
    ----------
    acceleration
        ``(3,)``, m/s^2, world frame.

    Examples
    --------
    >>> Gravity([0.0, 0.0, -9.81]).acceleration
    array([ 0.  ,  0.  , -9.81])
    """

    pulls = "acceleration"
    kind = "gravity"
    entries = described(acceleration=Entry("m/s^2", (3,)))
    start: ClassVar[float] = 0.0
    end: ClassVar[None] = None
    acceleration: Array = attrs.field(converter=unchecked, eq=ARRAY_EQ, hash=False)

    def lowered(self, number: Number, gravity: Any, masses: Sequence[Any]) -> Iterator[Push]:  # noqa: ARG002
        """Yield the weight of each tube with a density, in front of the entry point."""
        for tube, mass in enumerate(masses):
            if mass is not None:
                yield Push(tube, ("start", "end"), mass * number("acceleration"))
