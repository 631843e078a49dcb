"""Gravity, and the masses it acts on."""

from __future__ import annotations

from typing import Any, ClassVar

import attrs

from ..checks import ARRAY_EQ, Array, array, number
from . import places
from .kind import Conservative, Numbered


def _acceleration(value: Any) -> Array:
    return array(value, "acceleration", (3,), unit="m/s^2")


def _mass(value: Any) -> float:
    return number(value, "mass", least=0.0, unit="kg")


def _mass_per_length(value: Any) -> float:
    return number(value, "mass_per_length", least=0.0, unit="kg/m")


class _Mass(Numbered, Conservative):
    """A mass, which acts only under a gravity."""

    __slots__ = ()

    def idle(self, pulled: bool) -> str:
        """Why its numbers do not act."""
        return "" if pulled else "there is no Gravity"


@attrs.frozen
class Gravity(Numbered, Conservative):
    """Gravity: acts on every tube by its density, and on all masses.

    Parameters
    ----------
    acceleration
        ``(3,)``, m/s^2, world frame.

    Examples
    --------
    >>> Gravity([0.0, 0.0, -9.81]).acceleration
    array([ 0.  ,  0.  , -9.81])
    """

    pulls: ClassVar[bool] = True
    units: ClassVar[dict[str, str]] = {"acceleration": "m/s^2"}
    acceleration: Array = attrs.field(converter=_acceleration, eq=ARRAY_EQ, hash=False)

    def times(self, factor: float) -> Gravity:
        """The load multiplied."""
        return Gravity(factor * self.acceleration)


@attrs.frozen
class PointMass(_Mass):
    """A mass fixed at a point of a tube; acts only under a :class:`Gravity`.

    Parameters
    ----------
    mass
        kg.
    arc_length
        ``s`` from the entry point, m; ``None``: the tube's distal end.
    tube
        Index of the tube, 0 the innermost.

    Examples
    --------
    >>> PointMass(0.002, arc_length=0.1).mass
    0.002
    """

    units: ClassVar[dict[str, str]] = {"mass": "kg", "arc_length": "m"}
    mass: float = attrs.field(converter=_mass)
    arc_length: float | None = attrs.field(default=None, converter=places.arc_length)
    tube: int = attrs.field(default=0, converter=places.tube)

    def times(self, factor: float) -> PointMass:
        """The load multiplied."""
        return attrs.evolve(self, mass=factor * self.mass)


@attrs.frozen
class DistributedMass(_Mass):
    """A mass per arc length on a tube; acts only under a :class:`Gravity`.

    Parameters
    ----------
    mass_per_length
        kg/m.
    start, end
        ``s`` from the entry point, m; ``end=None``: the tube's distal end.
    tube
        Index of the tube, 0 the innermost.

    Examples
    --------
    >>> DistributedMass(0.3, start=0.01).end is None
    True
    """

    units: ClassVar[dict[str, str]] = {"mass_per_length": "kg/m", "start": "m", "end": "m"}
    mass_per_length: float = attrs.field(converter=_mass_per_length)
    start: float = attrs.field(default=0.0, converter=places.start)
    end: float | None = attrs.field(default=None, converter=places.end)
    tube: int = attrs.field(default=0, converter=places.tube)

    def __attrs_post_init__(self) -> None:
        places.check_interval(self.start, self.end)

    def times(self, factor: float) -> DistributedMass:
        """The load multiplied."""
        return attrs.evolve(self, mass_per_length=factor * self.mass_per_length)
