"""A table of shapes as seen from the entry, and from which of them the way to a target looks short."""

from __future__ import annotations

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..forward.equilibrium import Equilibrium
from ..forward.problem import ForwardProblem
from .limits import Allowed
from .targets import LENGTH, Target

_RANKED = 200  # of the shapes, those with the nearest tips: by the way of their joints
_LEFT = 1e-3  # squared: what is left of a misfit counts as much as a way of the joints that is so many times longer
_BEYOND = 10.0  # squared, of the way: how much more it counts where it leads beyond limits


@attrs.frozen(eq=False)
class Table:
    """Joints ``(k, 2 tubes)``, poses of the tips ``(k, 4, 4)``, Jacobians ``(k, 6, 2 tubes)``, zero if not known."""

    joints: Array
    poses: Array
    jacobians: Array

    @classmethod
    def of(cls, forward: ForwardProblem, joints: Array) -> Table:
        """The free shapes of those joints whose cold solve is stable."""
        rotations, translations = np.hsplit(joints, 2)
        shapes = forward.solve_many((rotations, translations), chained=False)
        stable = [k for k, shape in enumerate(shapes) if shape.converged and shape.is_stable]
        base, size = forward.robot.base_pose, joints.shape[1]
        poses = np.array([shapes[k].tip_pose for k in stable]).reshape(-1, 4, 4)
        found = [_jacobian(shapes[k], forward.compiles) for k in stable]
        jacobians = np.kron(np.eye(2), base[:3, :3].T) @ np.array(found).reshape(-1, 6, size)
        return cls(joints[stable], np.linalg.inv(base) @ poses, jacobians)

    def toward(self, target: Target, allowed: Allowed, weights: Array, reference: Array) -> Array:
        """Joints of shapes from which the way to a target, as seen from the entry, looks short, the shortest first.

        The way is that of the joints by the linear model, from each of the shapes with the nearest tips when turned
        about the entry's axis as a whole.
        """
        near, turns = self._nearest(target)
        about = _about(turns)
        poses, jacobians = self.poses[near], self.jacobians[near]
        missing = target.position - np.einsum("kij,kj->ki", about, poses[:, :3, 3])
        misfit = np.hstack((missing / LENGTH, target.turns_from(about @ poses[:, :3, :3])))
        rates = np.concatenate((about @ jacobians[:, :3] / LENGTH, target.counted @ about @ jacobians[:, 3:]), axis=1)
        steps, left = _ways(rates / weights, misfit)
        joints = self._turned(near, turns, allowed, reference)
        beyond = allowed.beyond(joints + steps / weights, weights)
        lengths = (steps**2).sum(axis=1) + (left**2).sum(axis=1) / _LEFT + _BEYOND * (beyond**2).sum(axis=1)
        return np.asarray(joints[np.argsort(lengths)])

    def _nearest(self, target: Target) -> tuple[NDArray[np.intp], Array]:
        """Which shapes have the nearest tips when turned about the entry's axis as a whole, and their turns."""
        axes = target.axes.shape[1]
        scale = np.array([1.0 / LENGTH, *[1.0 / np.sqrt(max(axes - 1, 1))] * axes])  # chords squared, as angles squared
        own = scale * np.concatenate((self.poses[:, :3, 3:], self.poses[:, :3, 3 - axes : 3]), axis=2)
        wanted = scale * np.column_stack((target.position, target.axes))
        (x, y, z), (u, v, w) = np.moveaxis(own, 1, 0), wanted
        along, across = x @ u + y @ v, x @ v - y @ u
        chords = (own**2).sum(axis=(1, 2)) - 2.0 * (np.hypot(along, across) + z @ w)
        near = np.argsort(chords)[:_RANKED]
        return near, np.arctan2(across[near], along[near])

    def _turned(self, which: NDArray[np.intp], turns: Array, allowed: Allowed, reference: Array) -> Array:
        """Joints of the robot turned as a whole, and by full turns within limits to come near a reference."""
        joints, tubes = self.joints[which].copy(), len(reference) // 2
        angles = joints[:, :tubes] + turns[:, None]
        joints[:, :tubes] = allowed.unwound(angles, reference[:tubes])
        return np.asarray(joints)


def _jacobian(shape: Equilibrium, fast: bool) -> Array:
    """Where it is known at once."""
    if fast and not shape.one_sided:
        return shape.jacobian()
    return np.zeros((6, 2 * len(shape.robot.tubes)))


def _about(turns: Array) -> Array:
    """Rotations about the entry's axis, ``(k, 3, 3)``."""
    c, s, zero = np.cos(turns), np.sin(turns), np.zeros_like(turns)
    return np.moveaxis(np.array([[c, -s, zero], [s, c, zero], [zero, zero, zero + 1.0]]), 2, 0)


def _ways(rates: Array, misfits: Array) -> tuple[Array, Array]:
    """Steps ``(k, 2 tubes)`` that linear models take, damped, and what they leave of the misfits."""
    back = np.swapaxes(rates, 1, 2)
    normal = rates @ back + _LEFT * np.eye(misfits.shape[1])
    steps = back @ np.linalg.solve(normal, misfits[:, :, None])
    return steps[:, :, 0], misfits - (rates @ steps)[:, :, 0]
