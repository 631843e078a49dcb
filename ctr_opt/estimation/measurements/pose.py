"""A measured pose of a tube's material frame, or of a sensor on it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import attrs
import numpy as np

from ...checks import Array, Entry, Table, described, unchecked
from ...errors import DefinitionError
from ...layout.observables import Distal, Observable, ObservedList, Place
from .kind import DIRECTIONS, POINTS, Measurement, place, sensor_name, six, vector_sigma


@attrs.frozen(eq=False, slots=False)
class PoseMeasurement(Measurement):
    """A measured pose of a tube's material frame, such as that of an electromagnetic sensor.

    Parameters
    ----------
    arc_length
        One place, as in :class:`PositionMeasurement`.
    pose
        Homogeneous matrix ``(4, 4)``, m, world frame.
    sigma
        Standard deviations ``(6,)`` of position (m) and rotation (rad, about the world's axes), or a covariance
        ``(6, 6)``. None: the noise level is estimated from the residuals.
    tube
        Number of the tube whose frame was measured. None: the innermost tube at this place.
    sensor
        Name of the sensor, if the pose is that of a sensor on the tube, as in :class:`PositionMeasurement`.

    Examples
    --------
    >>> import numpy as np
    >>> PoseMeasurement(None, np.eye(4), sigma=[1e-3] * 3 + [0.01] * 3).shape
    (1, 6)
    """

    arc_length: tuple[Place, ...] = attrs.field(converter=place)
    pose: Array = attrs.field(converter=unchecked)
    sigma: Any = None
    tube: int | None = attrs.field(default=None, converter=unchecked)
    sensor: str | None = attrs.field(default=None, converter=sensor_name)

    entries = described(pose=Entry("1", (4, 4)), tube=Entry("tube", optional=True))
    one_unit = False
    parts = (POINTS, DIRECTIONS)

    def _check(self) -> None:
        if np.abs(self.pose[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-6:
            raise DefinitionError(f"pose: the last row {self.pose[3].tolist()} must be [0, 0, 0, 1]")
        frame = self.pose[:3, :3]
        if np.abs(frame.T @ frame - np.eye(3)).max() > 1e-6 or np.linalg.det(frame) < 0.0:
            raise DefinitionError("pose: the upper left 3 x 3 block is not a rotation matrix (allowed deviation: 1e-6)")

    @property
    def observables(self) -> tuple[Observable, ...]:
        """The pose of the tube's frame or of the sensor."""
        return (Observable("pose", self.arc_length[0], self.tube, self.sensor),)

    @property
    def shape(self) -> tuple[int, int]:
        """One block of six numbers."""
        return 1, 6

    @classmethod
    def tables(cls) -> tuple[Table, ...]:
        """The file table of a pose at a tube's end."""
        entries = {
            **cls.in_files(),
            "position_sigma": vector_sigma("m"),
            "rotation_sigma": vector_sigma("rad"),
        }
        return (Table("tip_pose", entries, _at_end),)

    @staticmethod
    def compare(measured: Sequence[PoseMeasurement], values: ObservedList) -> tuple[Array, Array]:
        """Difference of positions, and the rotation vector from the measured to the predicted frame."""
        from scipy.spatial.transform import Rotation

        value, slopes = values[0].value, values[0].slopes
        poses = np.array([measurement.pose for measurement in measured])
        turned = Rotation.from_matrix(value[:, :, :3] @ np.swapaxes(poses[:, :3, :3], 1, 2)).as_rotvec()
        rates = np.concatenate((slopes[:, :3], inverse_left_jacobian(turned) @ slopes[:, 3:]), axis=1)
        return np.hstack((value[:, :, 3] - poses[:, :3, 3], turned))[:, None], rates[:, None]


def inverse_left_jacobian(vectors: Array) -> Array:
    """Matrices from angular velocities to rates of rotation vectors ``(E, 3)``: ``d log(R)``, ``dR = hat(w) R``."""
    angle = np.linalg.norm(vectors, axis=1)
    small = angle < 1e-4  # the series' next term is below 1e-18
    safe = np.where(small, 1.0, angle)
    factor = np.where(small, 1.0 / 12.0 + angle**2 / 720.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)
    hat = np.swapaxes(np.cross(vectors[:, None], np.eye(3)), 1, 2)
    return np.asarray(np.eye(3) - 0.5 * hat + factor[:, None, None] * hat @ hat)


def _at_end(pose: Any, position_sigma: Any, rotation_sigma: Any, tube: int | None = None) -> Measurement:
    return PoseMeasurement(None if tube is None else Distal(tube), pose, six(position_sigma, rotation_sigma), tube)
