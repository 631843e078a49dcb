"""Where the tip is wanted: a position, a position and an axis, or a pose; and how far a shape is from it."""

from __future__ import annotations

from math import atan2, sqrt
from typing import Any

import attrs
import numpy as np

from ..checks import Array, array, rigid
from ..errors import DefinitionError
from ..forward.equilibrium import Equilibrium

LENGTH = 0.02
"""m: a distance that counts as much as an angle of one radian, of joints unless said otherwise, and of the tip."""


@attrs.frozen(eq=False)
class Target:
    """Position ``(3,)``, m, and the axes of the tip's frame that are wanted: none ``(3, 0)``, z ``(3, 1)``, or all."""

    position: Array
    axes: Array

    @classmethod
    def of(cls, position: Any, axis: Any, pose: Any) -> Target:
        """From what a user gave: a position, a position and an axis, or a pose, also in the place of a position."""
        if np.shape(position) == (4, 4):
            position, pose = None, position
        if (position is None) == (pose is None):
            raise DefinitionError("give target_position, with or without target_axis, or target_pose, and not both")
        if pose is not None:
            if axis is not None:
                raise DefinitionError("target_axis belongs to target_position: target_pose has an axis of its own")
            given = rigid(pose, "target_pose")
            return cls(given[:3, 3], given[:3, :3])
        point = array(position, "target_position", (3,), unit="m")
        return cls(point, np.zeros((3, 0)) if axis is None else _unit(array(axis, "target_axis", (3,)))[:, None])

    @property
    def turns(self) -> bool:
        """Whether directions are wanted, too."""
        return bool(self.axes.size)

    def toward(self, other: Target, part: float) -> Target:
        """The target at a part of the way to another of the same kind, turned about one axis."""
        turn = _turn_between(self.axes, other.axes) if self.turns else np.zeros(3)
        return Target(self.position + part * (other.position - self.position), rotation(part * turn) @ self.axes)

    def at(self, equilibrium: Equilibrium) -> Target:
        """The target of the same kind that a shape has reached."""
        return Target(equilibrium.tip_position, equilibrium.tip_pose[:3, 3 - self.axes.shape[1] : 3])

    @property
    def counted(self) -> Array:
        """The part of a turn ``(3,)`` in the world that counts, as a projection: across an axis, all, or none."""
        if self.axes.shape[1] == 1:
            return np.eye(3) - self.axes @ self.axes.T
        return np.eye(3) if self.turns else np.zeros((3, 3))

    def turns_from(self, frames: Array) -> Array:
        """Rotation vectors ``(k, 3)`` that take many frames ``(k, 3, 3)`` to the axes, but for those of half a turn."""
        if not self.turns:
            return np.zeros((len(frames), 3))
        own = frames[:, :, 3 - self.axes.shape[1] :]
        alike = (own * self.axes).sum(axis=(1, 2))
        across = np.cross(own, self.axes, axisa=1, axisb=0).sum(axis=1)
        if self.axes.shape[1] == 3:
            alike, across = 0.5 * (alike - 1.0), 0.5 * across
        sines = np.linalg.norm(across, axis=1)
        angles = np.arctan2(sines, alike)
        return np.asarray(across * (angles / np.maximum(sines, 1e-12))[:, None])

    def seen_from(self, pose: Array) -> Target:
        """The target in the axes of a pose."""
        turned = pose[:3, :3].T
        return Target(turned @ (self.position - pose[:3, 3]), turned @ self.axes)

    def errors(self, equilibrium: Equilibrium) -> tuple[float, float]:
        """Distance of the tip, m, and angle of its axis or frame, rad, from the target."""
        return errors_of(self.misfit(equilibrium))

    def misfit(self, equilibrium: Equilibrium) -> Array:
        """How the tip must move and turn to the target, distances over ``LENGTH``: 3, 5 or 6 numbers."""
        missing = (self.position - equilibrium.tip_position) / LENGTH
        if not self.turns:
            return missing
        return np.concatenate((missing, self._seen(equilibrium) @ self._turn(equilibrium)))

    def rates(self, equilibrium: Equilibrium) -> Array:
        """How the tip so moves and turns with rotations (rad) and translations (m), ``(3, 5 or 6, 2 tubes)``."""
        jacobian = equilibrium.jacobian()
        moved = jacobian[:3] / LENGTH
        return np.vstack((moved, self._seen(equilibrium) @ jacobian[3:])) if self.turns else moved

    def _seen(self, equilibrium: Equilibrium) -> Array:
        """The world directions about which turns count: two across the axis, or all."""
        if self.axes.shape[1] == 3:
            return np.eye(3)
        return np.asarray(equilibrium.tip_pose[:3, :2].T)

    def _turn(self, equilibrium: Equilibrium) -> Array:
        frame = equilibrium.tip_pose[:3, :3]
        return _turn_between(frame if self.axes.shape[1] == 3 else frame[:, 2:], self.axes)


def errors_of(misfit: Array) -> tuple[float, float]:
    """Distance, m, and angle, rad, of a misfit."""
    missing, turn = misfit[:3], misfit[3:]
    return LENGTH * sqrt(missing @ missing), sqrt(turn @ turn)


def rotation(turn: Array) -> Array:
    """The rotation matrix of a rotation vector."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(turn).as_matrix())


def _turn_between(start: Array, end: Array) -> Array:
    """The shortest rotation vector that takes an axis ``(3, 1)`` or a frame ``(3, 3)`` to another."""
    return _from_axis_to(start[:, 0], end[:, 0]) if start.shape[1] == 1 else _vector_of(end @ start.T)


def _vector_of(turned: Array) -> Array:
    """The rotation vector of a rotation matrix; nearly half a turn, its axis is that of the symmetric part."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = turned.tolist()
    doubled = np.array([zy - yz, xz - zx, yx - xy])  # by the sine
    size, cosine = sqrt(doubled @ doubled), 0.5 * (xx + yy + zz - 1.0)
    angle = atan2(0.5 * size, cosine)
    if cosine > -0.9:
        return doubled * (angle / size if size > 0.0 else 0.5)
    symmetric = turned + turned.T - 2.0 * cosine * np.eye(3)
    axis = symmetric[:, np.argmax(np.diagonal(symmetric))]
    return np.asarray(np.copysign(angle, axis @ doubled) / sqrt(axis @ axis) * axis)


def _from_axis_to(start: Array, end: Array) -> Array:
    (x, y, z), (u, v, w) = start.tolist(), end.tolist()
    across = np.array([y * w - z * v, z * u - x * w, x * v - y * u])
    sine, cosine = sqrt(across @ across), float(start @ end)
    if sine < 1e-12 and cosine < 0.0:  # the other way: about any axis across
        return np.pi * _unit(np.cross(start, np.eye(3)[np.argmin(np.abs(start))]))
    return across * (atan2(sine, cosine) / sine if sine > 0.0 else 1.0)


def _unit(vector: Array) -> Array:
    size = float(np.linalg.norm(vector))
    if size == 0.0:
        raise DefinitionError("target_axis is zero: it must be a direction")
    return np.asarray(vector / size)
