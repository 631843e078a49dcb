"""A wrench per arc length on an interval of a tube."""

from __future__ import annotations

from typing import Any, ClassVar

import attrs
import numpy as np

from . import place
from .density import DENSITY_EQ, Density, density
from .wrench import Wrench, frame


def _force(value: Any) -> Density:
    return density(value, "force", "N/m")


def _moment(value: Any) -> Density:
    return density(value, "moment", "N m/m")


@attrs.frozen
class DistributedLoad(Wrench):
    """A force and a moment per arc length on a named tube.

    Parameters
    ----------
    force, moment
        N/m and N m/m: constant ``(3,)``; or a pair ``(s (k,), values (k, 3))``, interpolated
        linearly and zero outside; or a function ``s -> (3,)``, of which
        features narrower than a thousandth of the interval may be missed. The moment about
        the backbone's tangent twists the named tube alone.
    start, end
        ``s`` from the entry point, m; ``end=None``: the named tube's distal end.
    tube
        Index of the tube that carries it, 0 the innermost.
    frame
        ``"world"`` or ``"body"``, as in :class:`PointWrench`.

    Examples
    --------
    >>> DistributedLoad(force=[-2.0, 0.0, 0.0], start=0.01).end is None
    True
    """

    units: ClassVar[dict[str, str]] = {"force": "N/m", "moment": "N m/m", "start": "m", "end": "m"}
    force: Density = attrs.field(default=np.zeros(3), converter=_force, eq=DENSITY_EQ, hash=False)
    moment: Density = attrs.field(default=np.zeros(3), converter=_moment, eq=DENSITY_EQ, hash=False)
    start: float = attrs.field(default=0.0, converter=place.start)
    end: float | None = attrs.field(default=None, converter=place.end)
    tube: int = attrs.field(default=0, converter=place.tube)
    frame: str = attrs.field(default="world", converter=frame)

    def __attrs_post_init__(self) -> None:
        place.check_interval(self.start, self.end)
