"""Starts of searches: random stable shapes of the free robot, ordered by the length of the way to the target."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..forward.equilibrium import Equilibrium
from ..forward.problem import ForwardProblem
from ..robot.actuation import actuation_of
from .limits import Allowed
from .search import Point, TipSearch
from .targets import LENGTH, Target, rotation

_SHAPES, _SHAPES_SLOW = 2000, 30  # with compiled code, and without, where each takes a tenth of a second
_SEED = 2010
_RANKED = 200  # number of shapes, those with the nearest tips, that are ranked by the way of their joints
_LEFT = 1e-3  # squared misfit left by a step that counts as much as a squared way of the joints of one
_BEYOND = 10.0  # weight of the squared way beyond limits, relative to the rest of the way


class Starts:
    """Starts of searches: home, and random actuations whose free shapes are stable, solved once.

    A free robot may be turned about the entry's axis as a whole, so each shape represents all its turned copies.
    """

    def __init__(self, forward: ForwardProblem, allowed: Allowed, home: Array) -> None:
        self._forward, self._allowed, self._home = forward, allowed, home

    @cached_property
    def table(self) -> ShapeTable:
        """Table of the random shapes, solved at the first use."""
        count = _SHAPES if self._forward.compiles else _SHAPES_SLOW
        return ShapeTable.of(self._forward, self._allowed.drawn(self._home, count, np.random.default_rng(_SEED)))

    def points(self, search: TipSearch, initial: Equilibrium | None, reference: Array, most: int) -> Iterator[Point]:
        """Yield at most ``most`` shapes under a search's loads: the initial one or home, then some near the target."""
        for shape in self._shapes(search, initial, reference, most):
            if shape is not None:
                yield Point(shape, search.target)

    def _shapes(
        self, search: TipSearch, initial: Equilibrium | None, reference: Array, most: int
    ) -> Iterator[Equilibrium | None]:
        yield self._solved(search, self._home) if initial is None else loaded(search, initial)
        if most > 1:
            wanted = search.target.seen_from(self._forward.robot.base_pose)
            for joints in self.table.toward(wanted, search.allowed, search.weights, reference)[: most - 1]:
                yield self._solved(search, joints)

    def _solved(self, search: TipSearch, joints: Array) -> Equilibrium | None:
        allowed = search.allowed.nearest(joints, search.weights)
        shape = self._forward.solve(actuation_of(allowed), search.loads, throw=False)
        return shape if shape.converged else None


def loaded(search: TipSearch, initial: Equilibrium) -> Equilibrium | None:
    """Load a shape with the loads of a search; None if it snaps."""
    if initial.loads == search.loads:
        return initial
    shape = search.forward.solve(initial.actuation, search.loads, initial, throw=False)
    return shape if shape.converged and shape.is_stable is not False else None


@attrs.frozen(eq=False)
class ShapeTable:
    """Shapes in the frame of the entry, ranked by the way to a target.

    Shapes are joints ``(k, 2 tubes)``, poses of the tips ``(k, 4, 4)`` and Jacobians ``(k, 6, 2 tubes)``, zero if
    unknown.
    """

    joints: Array
    poses: Array
    jacobians: Array

    @classmethod
    def of(cls, forward: ForwardProblem, joints: Array) -> ShapeTable:
        """Solve the free shapes of ``joints`` and keep the stable ones."""
        rotations, translations = np.hsplit(joints, 2)
        shapes = forward.solve_many((rotations, translations), chained=False)
        stable = [k for k, shape in enumerate(shapes) if shape.converged and shape.is_stable]
        base, jacobians = forward.robot.base_pose, np.zeros((len(stable), 6, joints.shape[1]))
        poses = np.array([shapes[k].tip_pose for k in stable]).reshape(-1, 4, 4)
        for jacobian, k in zip(jacobians, stable, strict=True):
            if forward.compiles:  # known at once
                jacobian[:] = shapes[k].jacobian()
        return cls(joints[stable], np.linalg.inv(base) @ poses, np.kron(np.eye(2), base[:3, :3].T) @ jacobians)

    def toward(self, target: Target, allowed: Allowed, weights: Array, reference: Array) -> Array:
        """Joints of shapes near a target (in the entry's frame), the one with the shortest way first.

        Each shape is first turned about the entry's axis as a whole so that its tip is nearest to the target. Its
        angles are shifted by full turns toward ``reference`` within limits. A linear model then gives the way of the
        joints for the shapes with the nearest tips.
        """
        near, turns = self._nearest(target)
        about = rotation(np.multiply.outer(turns, [0.0, 0.0, 1.0]))
        poses, jacobians = self.poses[near], self.jacobians[near]
        missing = target.position - np.einsum("kij,kj->ki", about, poses[:, :3, 3])
        misfit = np.hstack((missing / LENGTH, target.turns_from(about @ poses[:, :3, :3])))
        rates = np.concatenate((about @ jacobians[:, :3] / LENGTH, target.counted @ about @ jacobians[:, 3:]), axis=1)
        steps, left = _ways(rates / weights, misfit)
        joints, tubes = self.joints[near].copy(), len(reference) // 2
        joints[:, :tubes] = allowed.unwound(joints[:, :tubes] + turns[:, None], reference[:tubes])
        beyond = allowed.beyond(joints + steps / weights, weights)
        lengths = (steps**2).sum(axis=1) + (left**2).sum(axis=1) / _LEFT + _BEYOND * (beyond**2).sum(axis=1)
        return np.asarray(joints[np.argsort(lengths)])

    def _nearest(self, target: Target) -> tuple[NDArray[np.intp], Array]:
        """Find the shapes with the nearest tips when turned about the entry's axis as a whole, and their turns."""
        axes = target.axes.shape[1]
        scale = np.array([1.0 / LENGTH, *[1.0 / np.sqrt(max(axes - 1, 1))] * axes])  # chords squared, as angles squared
        placed = scale * np.concatenate((self.poses[:, :3, 3:], self.poses[:, :3, 3 - axes : 3]), axis=2)
        wanted = scale * np.column_stack((target.position, target.axes))
        (x, y, z), (u, v, w) = np.moveaxis(placed, 1, 0), wanted
        along, across = x @ u + y @ v, x @ v - y @ u
        chords = (placed**2).sum(axis=(1, 2)) - 2.0 * (np.hypot(along, across) + z @ w)
        near = np.argsort(chords)[:_RANKED]
        return near, np.arctan2(across[near], along[near])


def _ways(rates: Array, misfits: Array) -> tuple[Array, Array]:
    """Damped steps ``(k, 2 tubes)`` of linear models, and the misfits that remain after them."""
    back = np.swapaxes(rates, 1, 2)
    normal = rates @ back + _LEFT * np.eye(misfits.shape[1])
    steps = back @ np.linalg.solve(normal, misfits[:, :, None])
    return steps[:, :, 0], misfits - (rates @ steps)[:, :, 0]
