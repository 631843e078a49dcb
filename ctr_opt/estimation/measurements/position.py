"""Measured positions of backbone points at known places."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Any

import attrs
import numpy as np

from ...checks import ARRAY_EQ, Array, Entry, Table, array, given
from ...errors import DefinitionError
from ...layout.observables import Observable, ObservedList, Place
from .kind import POINTS, Measurement, distances, places, sensor_name, vector_sigma


@lru_cache
def _poses(where: tuple[Place, ...], sensor: str | None) -> tuple[Observable, ...]:
    """Poses: one object for all measurements at the same places."""
    return tuple(Observable("pose", place, sensor=sensor, frame=0 if sensor is None else None) for place in where)


@attrs.frozen(eq=False, slots=False)
class PositionMeasurement(Measurement):
    """Measured positions of backbone points.

    Parameters
    ----------
    arc_length
        Where: an arc length from the entry point, m; ``None``, the tip; ``Distal(tube)``, that tube's end (both move
        when translations or offsets are unknown); or a list of such places.
    position
        ``(3,)``, m, world frame; ``(k, 3)`` for k places.
    sigma
        Standard deviation, m: a number, one for each axis ``(3,)``, or covariances ``(3, 3)`` or ``(k, 3, 3)``. None:
        the noise level is unknown and estimated from the residuals.
    sensor
        A name, if the point is a sensor's, fixed to the material frame of a tube at one place (of the innermost that
        is there, or of the one that ends there). Its pose in that frame: ``"sensors.<name>.translation"`` and
        ``"sensors.<name>.rotation"`` of :class:`Parameter`, zero where they are not estimated.

    Examples
    --------
    >>> PositionMeasurement(None, [0.01, 0.0, 0.12], sigma=0.5e-3).shape
    (1, 3)
    """

    arc_length: tuple[Place, ...] = attrs.field(converter=places)
    position: Array = attrs.field(eq=ARRAY_EQ, converter=given)
    sigma: Any = None
    sensor: str | None = attrs.field(default=None, converter=sensor_name)

    parts = (POINTS,)

    def _check(self) -> None:
        points = array(self.position, "position", (None,) * np.ndim(self.position), unit="m")
        if points.shape not in ((3,), (len(self.arc_length), 3)) or (points.ndim == 1 and len(self.arc_length) != 1):
            raise DefinitionError(
                f"position has shape {points.shape}, but must have shape ({len(self.arc_length)}, 3), a row for each "
                "arc length"
            )
        if self.sensor is not None and len(self.arc_length) != 1:
            raise DefinitionError(
                f"sensor = {self.sensor!r} must be at one place: give a measurement for each of {len(self.arc_length)}"
            )
        object.__setattr__(self, "position", points.reshape(-1, 3))

    @property
    def observables(self) -> tuple[Observable, ...]:
        """Poses at the places."""
        return _poses(self.arc_length, self.sensor)

    @property
    def shape(self) -> tuple[int, int]:
        """Points, and three coordinates."""
        return len(self.arc_length), 3

    @classmethod
    def tables(cls) -> tuple[Table, ...]:
        """Of the tip."""
        entries = {"position": Entry("m", (3,)), "sigma": vector_sigma("m")}
        return (Table("tip_position", entries, partial(cls, None)),)

    @staticmethod
    def compare(measured: Sequence[PositionMeasurement], values: ObservedList) -> tuple[Array, Array]:
        """Distances to the points, and derivatives."""
        return distances(measured, values)
