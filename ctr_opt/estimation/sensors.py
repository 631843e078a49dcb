"""Sensors on tubes: their poses in the tube's material frame, unknown or zero, and what they show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np

from ..checks import Array
from .compiled_model import euler_rates
from .measurements.kind import Prediction, Request

Mounting: TypeAlias = "tuple[Array, Array]"
"""A sensor in a tube's frame: translation ``(3,)``, m, and XYZ Euler angles ``(3,)``, rad."""


def names_of(requests: Sequence[Request]) -> tuple[str, ...]:
    """The sensors whose poses are requested."""
    return tuple(dict.fromkeys(each.sensor for each in requests if each.sensor is not None))


def sensed(
    requests: Sequence[Request], found: Sequence[Prediction], mountings: Mapping[str, Mounting]
) -> list[Prediction]:
    """Predictions with the poses of sensors in the place of the tubes' frames that carry them.

    Behind the columns of the slopes come six more for each sensor, by its translation and its angles.
    """
    starts = {name: 6 * k for k, name in enumerate(mountings)}
    told = []
    for request, each in zip(requests, found, strict=True):
        shown, more = each, np.zeros((*each.slopes.shape[:-1], 6 * len(mountings)))
        if request.sensor is not None:
            start = starts[request.sensor]
            shown, more[..., start : start + 6] = _mounted(each, *mountings[request.sensor])
        told.append(Prediction(shown.value, np.concatenate((shown.slopes, more), axis=-1)))
    return told


def _mounted(carrier: Prediction, translation: Array, angles: Array) -> tuple[Prediction, Array]:
    """Poses of a sensor on a frame, and their six rates by its translation and angles."""
    from scipy.spatial.transform import Rotation

    frames, slopes = carrier.value[:, :, :3], carrier.slopes
    arms, turned = frames @ translation, frames @ Rotation.from_euler("XYZ", angles).as_matrix()
    poses = np.concatenate((turned, (carrier.value[:, :, 3] + arms)[..., None]), axis=2)
    moved = slopes[:, :3] + np.cross(slopes[:, 3:], arms[..., None], axis=1)
    own = np.zeros((len(frames), 6, 6))
    own[:, :3, :3], own[:, 3:, 3:] = frames, turned @ euler_rates(angles)
    return Prediction(poses, np.concatenate((moved, slopes[:, 3:]), axis=1)), own
