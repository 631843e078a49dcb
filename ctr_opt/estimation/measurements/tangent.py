"""Measured direction of the backbone's tangent or of a sensor's axis."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, partial
from typing import Any

import attrs
import numpy as np

from ...checks import Array, Entry, Table, dimensions, direction
from ...errors import DefinitionError
from ...layout.observables import Observable, ObservedList, Place
from .kind import DIRECTIONS, Measurement, place, sensor_name


def _direction(value: Any) -> Array:
    return direction(value, "direction")


@attrs.frozen(eq=False, slots=False)
class TangentMeasurement(Measurement):
    """A measured direction of the backbone's tangent, such as that of a sensor with five degrees of freedom.

    Parameters
    ----------
    arc_length
        One place, as in :class:`PositionMeasurement`.
    direction
        Vector ``(3,)`` of any length, world frame.
    sigma
        Standard deviation of the angle about every axis across the tangent, rad. None: the noise level is estimated
        from the residuals.
    sensor
        Name of the sensor, if the direction is the z axis of a sensor, as in :class:`PositionMeasurement`.

    Examples
    --------
    >>> TangentMeasurement(None, [0.0, 0.0, 2.0], sigma=0.01).direction.tolist()
    [0.0, 0.0, 1.0]
    """

    arc_length: tuple[Place, ...] = attrs.field(converter=place)
    direction: Array = attrs.field(converter=_direction)
    sigma: float | None = None
    sensor: str | None = attrs.field(default=None, converter=sensor_name)

    parts = (DIRECTIONS,)

    def _check(self) -> None:
        if self.sigma is not None and dimensions(self.sigma):
            raise DefinitionError(f"sigma = {self.sigma!r} must be one number for all axes across the tangent")

    @cached_property
    def _across(self) -> Array:
        """Two axes across the measured direction, ``(2, 3)``."""
        return np.asarray(np.linalg.svd(self.direction[None])[2][1:])

    @property
    def observables(self) -> tuple[Observable, ...]:
        """The pose of the backbone's frame or of the sensor."""
        return (Observable("pose", self.arc_length[0], sensor=self.sensor, frame=0 if self.sensor is None else None),)

    @property
    def shape(self) -> tuple[int, int]:
        """One block of two angles."""
        return 1, 2

    @classmethod
    def tables(cls) -> tuple[Table, ...]:
        """The file table of the tip's direction."""
        entries = {"direction": Entry("1", (3,)), "sigma": Entry("rad")}
        return (Table("tip_direction", entries, partial(cls, None)),)

    @staticmethod
    def compare(measured: Sequence[TangentMeasurement], values: ObservedList) -> tuple[Array, Array]:
        """The predicted tangent across the measured one, scaled to the angle between them, and derivatives."""
        tangent, slopes = values[0].value[:, :, 2], values[0].slopes[:, 3:]
        axes = np.array([measurement._across for measurement in measured])
        direction = np.array([measurement.direction for measurement in measured])[:, None]
        moved = np.cross(slopes, tangent[:, :, None], axis=1)
        across, of_across = (axes @ tangent[..., None])[..., 0], axes @ moved
        along = np.sum(direction[:, 0] * tangent, axis=1)
        sine = np.linalg.norm(across, axis=1)
        near = (sine < 1e-6) & (along > 0.0)  # the angle is the sine, up to its third power
        far = (sine < 1e-6) & ~near  # the opposite direction, half a turn about any axis
        angle, sine = np.arctan2(sine, along), np.maximum(sine, 1e-6)
        unit = np.where(far[:, None], [1.0, 0.0], across / sine[:, None])[:, None]
        of_sine = unit @ of_across
        of_angle = _factors(along) * of_sine - _factors(sine) * (direction @ moved)
        bend = np.swapaxes(unit, 1, 2)
        change = bend * of_angle + _factors(angle / sine) * (of_across - bend * of_sine)
        turned = np.where(near[:, None, None], across[:, None], angle[:, None, None] * unit)
        return turned, np.where(near[:, None, None], of_across, change)[:, None]


def _factors(numbers: Array) -> Array:
    """One number for each experiment, shaped to multiply its matrix."""
    return numbers[:, None, None]
