"""Point wrench: a force and a moment at a point of a tube."""

from __future__ import annotations

import attrs

from ..checks import ARRAY_EQ, Array, Entry, described, unchecked
from . import place
from .wrench import FRAME, Wrench


@attrs.frozen
class PointWrench(Wrench):
    """A force and a moment at a point of a named tube.

    Parameters
    ----------
    force, moment
        ``(3,)``, N and N m. An axial moment twists the named tube alone.
    arc_length
        ``s`` from the entry point, m; ``None``: the named tube's distal end, wherever it is.
    tube
        Index of the tube that carries the load, 0 the innermost.
    frame
        ``"world"``: force and moment keep their direction ("dead load"). ``"body"``: they are given in the named tube's
        material frame and turn with it ("follower load"). A body load has no potential.

    Examples
    --------
    >>> PointWrench(force=[0.0, 0.5, 0.0]).tube
    0
    """

    kind = "point"
    entries = described(force=Entry("N", (3,)), moment=Entry("N m", (3,)), **place.POINT, frame=FRAME)
    force: Array = attrs.field(default=(0.0, 0.0, 0.0), converter=unchecked, eq=ARRAY_EQ, hash=False)
    moment: Array = attrs.field(default=(0.0, 0.0, 0.0), converter=unchecked, eq=ARRAY_EQ, hash=False)
    arc_length: float | None = attrs.field(default=None, converter=unchecked)
    tube: int = attrs.field(default=0, converter=unchecked)
    frame: str = attrs.field(default="world", converter=unchecked)
