"""Masses on tubes, at a point and per arc length: they act only under a gravity."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

import attrs

from ..checks import number
from . import place
from .kind import Load, Number, Push


def _mass(value: Any) -> float:
    return number(value, "mass", least=0.0, unit="kg")


def _mass_per_length(value: Any) -> float:
    return number(value, "mass_per_length", least=0.0, unit="kg/m")


class _Mass(Load):
    """A mass, which acts only under a gravity."""

    __slots__ = ()

    tube: int

    def lowered(self, number: Number, gravity: Any, masses: Sequence[Any]) -> Iterator[Push]:  # noqa: ARG002
        """Its weight."""
        yield Push(self.tube, self.places, number(self.amounts[0]) * gravity)

    def idle(self, pulled: bool) -> str:
        """Why no number of it acts."""
        return "" if pulled else "there is no Gravity"


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
    arc_length: float | None = attrs.field(default=None, converter=place.arc_length)
    tube: int = attrs.field(default=0, converter=place.tube)


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
    start: float = attrs.field(default=0.0, converter=place.start)
    end: float | None = attrs.field(default=None, converter=place.end)
    tube: int = attrs.field(default=0, converter=place.tube)

    def __attrs_post_init__(self) -> None:
        place.check_interval(self.start, self.end)
