"""Where the tip is wanted: a position, a position and an axis, or a pose; and how far a shape is from it."""

from __future__ import annotations

from math import atan2, sqrt
from typing import Any

import attrs
import numpy as np

from ..checks import Array, array, direction, rigid
from ..errors import DefinitionError
from ..forward.equilibrium import Equilibrium

LENGTH = 0.02
"""m: a distance that counts as much as an angle of one radian, of joints unless said otherwise, and of the tip."""

_FIELDS = ("target_position", "target_axis", "target_pose")
_HALF_TURN, _OPPOSITE = 0.4, 1e-12  # sines of angles near pi: below, the axis is that of the symmetric part


@attrs.frozen(eq=False)
class Target:
    """Position ``(3,)``, m, and the axes of the tip's frame that are wanted: none ``(3, 0)``, z ``(3, 1)``, or all."""

    position: Array
    axes: Array

    @classmethod
    def of(cls, position: Any, axis: Any, pose: Any, fields: tuple[str, str, str] = _FIELDS) -> Target:
        """From a position, with or without an axis, or a pose, also in its place; errors name ``fields``."""
        if np.shape(position) == (4, 4):
            position, pose = None, position
        if (position is None) == (pose is None):
            raise DefinitionError("give target_position, with or without target_axis, or target_pose, and not both")
        if pose is not None:
            if axis is not None:
                raise DefinitionError("target_axis belongs to target_position: target_pose has an axis of its own")
            given = rigid(pose, fields[2])
            return cls(given[:3, 3], given[:3, :3])
        point = array(position, fields[0], (3,), unit="m")
        return cls(point, np.zeros((3, 0)) if axis is None else direction(axis, fields[1])[:, None])

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
        reached = frames[:, :, 3 - self.axes.shape[1] :]
        alike = (reached * self.axes).sum(axis=(1, 2))
        across = np.cross(reached, self.axes, axisa=1, axisb=0).sum(axis=1)
        if self.axes.shape[1] == 3:
            alike, across = 0.5 * (alike - 1.0), 0.5 * across
        sines = np.linalg.norm(across, axis=1)
        angles = np.arctan2(sines, alike)
        return np.asarray(across * (angles / np.maximum(sines, 1e-12))[:, None])

    def seen_from(self, pose: Array) -> Target:
        """The target in the axes of a pose."""
        turned = pose[:3, :3].T
        return Target(turned @ (self.position - pose[:3, 3]), turned @ self.axes)

    def misfit(self, equilibrium: Equilibrium) -> Array:
        """How the tip must move and turn to the target, distances over ``LENGTH``: 3, 5 or 6 numbers."""
        missing = (self.position - equilibrium.tip_position) / LENGTH
        if not self.turns:
            return missing
        reached = equilibrium.tip_pose[:3, 3 - self.axes.shape[1] : 3]
        return np.concatenate((missing, self._seen(equilibrium) @ _turn_between(reached, self.axes)))

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


def rotation(turn: Array) -> Array:
    """Rotation matrices ``(..., 3, 3)`` of rotation vectors ``(..., 3)``."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(turn).as_matrix())


def _turn_between(start: Array, end: Array) -> Array:
    """The shortest rotation vector that takes an axis ``(3, 1)`` or a frame ``(3, 3)`` to another.

    The axial vector and the trace of ``end start^T`` sum the cross and the dot products of the axes. For single axes
    they are ``sin a`` and ``cos`` of the turn by an angle about ``a``, for frames ``2 sin a`` and ``1 + 2 cos``. Near
    half a turn the sine loses ``a``, and the symmetric part less ``cos I`` has it: for frames ``(1 - cos) a a^T``. For
    an axis and its opposite it is ``I - start start^T``: about each of its columns half a turn leads there.
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
