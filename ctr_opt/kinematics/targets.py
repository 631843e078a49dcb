"""Targets of the tip: a position, a position and an axis, or a pose; and the distance of a shape from them."""

from __future__ import annotations

from math import atan2, sqrt
from typing import Any

import attrs
import numpy as np

from ..checks import Array, array, dimensions, direction, rigid
from ..errors import DefinitionError
from ..forward.equilibrium import Equilibrium

LENGTH = 0.02
"""Distance, m, that counts as much as one radian, for the tip and, by default, for the joints."""

_FIELDS = ("target_position", "target_axis", "target_pose")
_HALF_TURN, _OPPOSITE = 0.4, 1e-12  # sines of angles near pi: below them, the symmetric part gives the axis


@attrs.frozen(eq=False)
class Target:
    """Target position ``(3,)``, m, and target axes of the tip's frame: none ``(3, 0)``, z ``(3, 1)``, or all."""

    position: Array
    axes: Array

    @classmethod
    def of(cls, position: Any, axis: Any, pose: Any, fields: tuple[str, str, str] = _FIELDS) -> Target:
        """Make a target from a position, with or without an axis, or from a pose; errors name ``fields``."""
        if dimensions(position) == 2 and np.shape(position) == (4, 4):
            position, pose = None, position
        if (position is None) == (pose is None):
            raise DefinitionError("give either target_position, with or without target_axis, or target_pose, not both")
        if pose is not None:
            if axis is not None:
                raise DefinitionError("target_axis must be given with target_position: target_pose contains an axis")
            matrix = rigid(pose, fields[2])
            return cls(matrix[:3, 3], matrix[:3, :3])
        point = array(position, fields[0], (3,), unit="m")
        return cls(point, np.zeros((3, 0)) if axis is None else direction(axis, fields[1])[:, None])

    @property
    def turns(self) -> bool:
        """Whether the target includes directions."""
        return bool(self.axes.size)

    def toward(self, other: Target, part: float) -> Target:
        """Interpolate to another target of the same kind, turning about one axis; ``part`` is 0 to 1."""
        turn = _turn_between(self.axes, other.axes) if self.turns else np.zeros(3)
        return Target(self.position + part * (other.position - self.position), rotation(part * turn) @ self.axes)

    def at(self, equilibrium: Equilibrium) -> Target:
        """Return the target of the same kind that a shape has reached."""
        return Target(equilibrium.tip_position, equilibrium.tip_pose[:3, 3 - self.axes.shape[1] : 3])

    @property
    def counted(self) -> Array:
        """Projection ``(3, 3)`` onto turns that count, in the world: across one axis, all, or none."""
        if self.axes.shape[1] == 1:
            return np.eye(3) - self.axes @ self.axes.T
        return np.eye(3) if self.turns else np.zeros((3, 3))

    def turns_from(self, frames: Array) -> Array:
        """Rotation vectors ``(k, 3)`` from frames ``(k, 3, 3)`` to the axes; not valid for half a turn."""
        if not self.turns:
            return np.zeros((len(frames), 3))
        reached = frames[:, :, 3 - self.axes.shape[1] :]
        alike = (reached * self.axes).sum(axis=(1, 2))
        across = np.cross(reached, self.axes, axisa=1, axisb=0).sum(axis=1)
        if self.axes.shape[1] == 3:
            alike, across = 0.5 * (alike - 1.0), 0.5 * across
        sines = np.linalg.norm(across, axis=1)
        angles = np.arctan2(sines, alike)
        return np.asarray(across * (angles / np.maximum(sines, 1e-12))[:, None])

    def seen_from(self, pose: Array) -> Target:
        """Express the target in the axes of a pose."""
        turned = pose[:3, :3].T
        return Target(turned @ (self.position - pose[:3, 3]), turned @ self.axes)

    def misfit(self, equilibrium: Equilibrium) -> Array:
        """Motion and turn of the tip to the target, distances over ``LENGTH``: 3, 5 or 6 numbers."""
        missing = (self.position - equilibrium.tip_position) / LENGTH
        if not self.turns:
            return missing
        reached = equilibrium.tip_pose[:3, 3 - self.axes.shape[1] : 3]
        return np.concatenate((missing, self._seen(equilibrium) @ _turn_between(reached, self.axes)))

    def rates(self, equilibrium: Equilibrium) -> Array:
        """Derivatives of motion and turn by rotations (rad) and translations (m), ``(3, 5 or 6, 2 tubes)``."""
        jacobian = equilibrium.jacobian()
        moved = jacobian[:3] / LENGTH
        return np.vstack((moved, self._seen(equilibrium) @ jacobian[3:])) if self.turns else moved

    def _seen(self, equilibrium: Equilibrium) -> Array:
        """World directions about which turns count: two across the axis, or all."""
        if self.axes.shape[1] == 3:
            return np.eye(3)
        return np.asarray(equilibrium.tip_pose[:3, :2].T)


def rotation(turn: Array) -> Array:
    """Rotation matrices ``(..., 3, 3)`` of rotation vectors ``(..., 3)``."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(turn).as_matrix())


def _turn_between(start: Array, end: Array) -> Array:
    """Shortest rotation vector that takes an axis ``(3, 1)`` or a frame ``(3, 3)`` to another.

    The axial vector and the trace of ``end start^T`` sum the cross and the dot products of the axes. For single axes
    they are ``sin a`` and ``cos`` of the turn by an angle about ``a``, for frames ``2 sin a`` and ``1 + 2 cos``. Near
    half a turn the sine no longer determines ``a``. The symmetric part less ``cos I`` does: for frames it is
    ``(1 - cos) a a^T``. For an axis and its opposite it is ``I - start start^T``, and half a turn about any of its
    columns leads from one to the other.
    """
    turned, framed = end @ start.T, start.shape[1] == 3
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = turned.tolist()
    across, cosine = np.array([zy - yz, xz - zx, yx - xy]), xx + yy + zz
    if framed:
        across, cosine = 0.5 * across, 0.5 * (cosine - 1.0)
    sine = sqrt(across @ across)
    angle = atan2(sine, cosine)
    if cosine > 0.0 or sine > (_HALF_TURN if framed else _OPPOSITE):
        return across * (angle / sine if sine > 0.0 else 1.0)
    symmetric = turned + turned.T - 2.0 * cosine * np.eye(3)
    axis = symmetric[:, np.argmax(np.diagonal(symmetric))]
    return np.asarray(np.copysign(angle, axis @ across) / sqrt(axis @ axis) * axis)
