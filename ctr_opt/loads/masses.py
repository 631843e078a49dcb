"""Masses on tubes, at a point and per arc length; they act only under gravity."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import attrs

from ..checks import Entry, described, unchecked
from . import place
from .kind import Load, Number, Push


class _Mass(Load):
    """Base of masses, which act only under a :class:`Gravity`."""

    __slots__ = ()

    tube: int

    def lowered(self, number: Number, gravity: Any, masses: Sequence[Any]) -> Iterator[Push]:  # noqa: ARG002
        """Yield the mass's weight."""
        yield Push(self.tube, self.places, number(self.amounts[0]) * gravity)

    def idle(self, pulled: bool) -> str:
        """Why the mass has no weight; empty if it has."""
        return "" if pulled else "there is no Gravity"


@attrs.frozen
class PointMass(_Mass):
    """A mass fixed at a point of a tube. It acts only under a :class:`Gravity`.

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

    kind = "point_mass"
    entries = described(mass=Entry("kg", least=0.0), **place.POINT)
    mass: float = attrs.field(converter=unchecked)
    arc_length: float | None = attrs.field(default=None, converter=unchecked)
    tube: int = attrs.field(default=0, converter=unchecked)


@attrs.frozen
class DistributedMass(_Mass):
    """A mass per arc length on a tube. It acts only under a :class:`Gravity`.

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

    kind = "distributed_mass"
    entries = described(mass_per_length=Entry("kg/m", least=0.0), **place.SPAN)
    mass_per_length: float = attrs.field(converter=unchecked)
    start: float = attrs.field(default=0.0, converter=unchecked)
    end: float | None = attrs.field(default=None, converter=unchecked)
    tube: int = attrs.field(default=0, converter=unchecked)

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        place.check_interval(self.start, self.end)
