"""Sensors on tubes: their poses in the tube's material frame, unknown or zero, and their predicted poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np

from ..checks import Array
from ..layout.observables import Observable, Observed, ObservedList
from ..robot.names import euler_rates

Mounting: TypeAlias = "tuple[Array, Array]"
"""Pose of a sensor in a tube's frame: translation ``(3,)``, m, and XYZ Euler angles ``(3,)``, rad."""


def names_of(observables: Sequence[Observable]) -> tuple[str, ...]:
    """Names of the sensors whose poses are observed."""
    return tuple(dict.fromkeys(one.sensor for one in observables if one.sensor is not None))


def sensed(
    observables: Sequence[Observable], values: ObservedList, mountings: Mapping[str, Mounting]
) -> list[Observed]:
    """Predicted values with sensor poses replacing the frames of the tubes that carry them.

    The slopes gain six columns for each sensor, by its translation and its angles.
    """
    starts = {name: 6 * k for k, name in enumerate(mountings)}
    seen = []
    for k, one in enumerate(observables):
        value = values[k]
        more = np.zeros((*value.slopes.shape[:-1], 6 * len(mountings)))
        if one.sensor is not None:
            start = starts[one.sensor]
            value, more[..., start : start + 6] = _mounted(value, *mountings[one.sensor])
        seen.append(Observed(value.value, np.concatenate((value.slopes, more), axis=-1)))
    return seen


def _mounted(carrier: Observed, translation: Array, angles: Array) -> tuple[Observed, Array]:
    """Poses of a sensor on a frame, and their six rates by its translation and angles."""
    from scipy.spatial.transform import Rotation

    frames, slopes = carrier.value[:, :, :3], carrier.slopes
    arms, turned = frames @ translation, frames @ Rotation.from_euler("XYZ", angles).as_matrix()
    poses = np.concatenate((turned, (carrier.value[:, :, 3] + arms)[..., None]), axis=2)
    moved = slopes[:, :3] + np.cross(slopes[:, 3:], arms[..., None], axis=1)
    rates = np.zeros((len(frames), 6, 6))
    rates[:, :3, :3], rates[:, 3:, 3:] = frames, turned @ euler_rates(angles)
    return Observed(poses, np.concatenate((moved, slopes[:, 3:]), axis=1)), rates
