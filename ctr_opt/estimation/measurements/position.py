"""Measured positions of backbone points at known arc lengths."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Any

import attrs

from ...checks import ARRAY_EQ, Array, Entry, Table, array, dimensions, unchecked
from ...errors import DefinitionError
from ...layout.observables import Observable, ObservedList, Place
from .kind import POINTS, Measurement, distances, places, sensor_name, vector_sigma


@lru_cache
def _poses(where: tuple[Place, ...], sensor: str | None) -> tuple[Observable, ...]:
    """Poses at places; all measurements at the same places share one object."""
    return tuple(Observable("pose", place, sensor=sensor, frame=0 if sensor is None else None) for place in where)


@attrs.frozen(eq=False, slots=False)
class PositionMeasurement(Measurement):
    """Measured positions of backbone points at known places.

    Parameters
    ----------
    arc_length
        One place or a list of places: an arc length from the entry point, m; ``None``, the tip; or ``Distal(tube)``,
        that tube's end. Tip and ends move with unknown translations and offsets.
    position
        Measured point ``(3,)``, m, world frame; ``(k, 3)`` for k places.
    sigma
        Standard deviation, m: a number, one for each axis ``(3,)``, or covariances ``(3, 3)`` or ``(k, 3, 3)``. None:
        the noise level is estimated from the residuals.
    sensor
        Name of the sensor, if the point belongs to a sensor on a tube at one place. The sensor is fixed to the material
        frame of the innermost tube there, or of the tube that ends there. The parameters
        ``"sensors.<name>.translation"`` and ``"sensors.<name>.rotation"`` (see :class:`Parameter`) are its pose in that
        frame, zero unless they are estimated.

    Examples
    --------
    >>> PositionMeasurement(None, [0.01, 0.0, 0.12], sigma=0.5e-3).shape
    (1, 3)
    """

    arc_length: tuple[Place, ...] = attrs.field(converter=places)
    position: Array = attrs.field(eq=ARRAY_EQ, converter=unchecked)
    sigma: Any = None
    sensor: str | None = attrs.field(default=None, converter=sensor_name)

    parts = (POINTS,)

    def _check(self) -> None:
        points = array(self.position, "position", (None,) * dimensions(self.position), unit="m")
        if points.shape not in ((3,), (len(self.arc_length), 3)) or (points.ndim == 1 and len(self.arc_length) != 1):
            raise DefinitionError(
                f"position has shape {points.shape}, but must have shape ({len(self.arc_length)}, 3), a row for each "
                "arc length"
            )
        if self.sensor is not None and len(self.arc_length) != 1:
            raise DefinitionError(
                f"sensor = {self.sensor!r} must be at one place; give a measurement for each of {len(self.arc_length)}"
            )
        object.__setattr__(self, "position", points.reshape(-1, 3))

    @property
    def observables(self) -> tuple[Observable, ...]:
        """The poses at these places."""
        return _poses(self.arc_length, self.sensor)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of points, and three coordinates."""
        return len(self.arc_length), 3

    @classmethod
    def tables(cls) -> tuple[Table, ...]:
        """The file table of the tip's position."""
        entries = {"position": Entry("m", (3,)), "sigma": vector_sigma("m")}
        return (Table("tip_position", entries, partial(cls, None)),)

    @staticmethod
    def compare(measured: Sequence[PositionMeasurement], values: ObservedList) -> tuple[Array, Array]:
        """Predicted minus measured positions, and derivatives."""
        return distances(measured, values)
