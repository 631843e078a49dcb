"""Distributed wrench: a force and a moment per arc length on an interval of a tube."""

from __future__ import annotations

import attrs
import numpy as np

from ..checks import described, unchecked
from . import place
from .density import DENSITY_EQ, Density, DensityEntry
from .wrench import FRAME, Wrench


@attrs.frozen
class DistributedLoad(Wrench):
    """A force and a moment per arc length on a named tube.

    Parameters
    ----------
    force, moment
        N/m and N m/m: a constant ``(3,)``; a pair ``(s (k,), values (k, 3))``, interpolated linearly and zero
        outside; or a function ``s -> (3,)``. Features of a function that are narrower than a thousandth of the
        interval may be missed. The moment about the backbone's tangent twists the named tube alone.
    start, end
        ``s`` from the entry point, m; ``end=None``: the named tube's distal end.
    tube
        Index of the tube that carries the load, 0 the innermost.
    frame
        ``"world"`` or ``"body"``, as in :class:`PointWrench`.

    Raises
    ------
    DefinitionError
        A value has the wrong shape or range, or ``end`` is not above ``start``.

    Examples
    --------
    >>> DistributedLoad(force=[-2.0, 0.0, 0.0], start=0.01).end is None
    True
    """

    kind = "distributed"
    entries = described(force=DensityEntry("N/m", (3,)), moment=DensityEntry("N m/m", (3,)), **place.SPAN, frame=FRAME)
    csv = 7, {"force": (0, slice(1, 4)), "moment": (0, slice(4, 7))}
    force: Density = attrs.field(default=np.zeros(3), converter=unchecked, eq=DENSITY_EQ, hash=False)
    moment: Density = attrs.field(default=np.zeros(3), converter=unchecked, eq=DENSITY_EQ, hash=False)
    start: float = attrs.field(default=0.0, converter=unchecked)
    end: float | None = attrs.field(default=None, converter=unchecked)
    tube: int = attrs.field(default=0, converter=unchecked)
    frame: str = attrs.field(default="world", converter=unchecked)

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        place.check_interval(self.start, self.end)
