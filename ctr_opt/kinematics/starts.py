"""Where else a search may start: random stable shapes of the free robot, the nearest to a target first."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import islice

import numpy as np

from ..equilibrium import Equilibrium
from ..forward import ForwardProblem
from ..robot.actuation import Actuation
from ..robot.checks import Array
from .limits import Allowed
from .search import Point, Search
from .targets import LENGTH, Target

_SHAPES, _SHAPES_SLOW = 1000, 30  # by compiled code, and where each takes a tenth of a second
_SEED = 2010


class Starts:
    """Where searches start: home, and random actuations whose free shapes are stable, solved once.

    A free robot may be turned about the entry's axis as a whole: each shape stands for all that it so becomes.
    """

    def __init__(self, forward: ForwardProblem, allowed: Allowed, home: Array) -> None:
        self._forward, self._allowed, self._home = forward, allowed, home

    @cached_property
    def table(self) -> tuple[Array, Array]:
        """Joints ``(k, 2 tubes)``, and the tips' poses as seen from the entry ``(k, 4, 4)``."""
        count = _SHAPES if self._forward.compiles else _SHAPES_SLOW
        joints = self._allowed.drawn(self._home, count, np.random.default_rng(_SEED))
        rotations, translations = np.hsplit(joints, 2)
        shapes = self._forward.solve_many((rotations, translations), chained=False)
        stable = [k for k, shape in enumerate(shapes) if shape.converged and shape.is_stable]
        poses = np.array([shapes[k].tip_pose for k in stable]).reshape(-1, 4, 4)
        return joints[stable], np.linalg.inv(self._forward.robot.base_pose) @ poses

    def points(self, search: Search, initial: Equilibrium | None, reference: Array, most: int) -> Iterator[Point]:
        """At most so many shapes under the loads of a search: the initial one or home, then those near the target."""
        if initial is None:
            first = self._at(search, search.allowed.nearest(self._home, search.weights))
        else:
            first = loaded(search, initial)
        if first is not None:
            yield Point(first, search.target)
        for joints in islice(self._near(search, reference), most - 1):
            shape = self._at(search, joints)
            if shape is not None:
                yield Point(shape, search.target)

    def _at(self, search: Search, joints: Array) -> Equilibrium | None:
        found = self._forward.solve(Actuation(*np.split(joints, 2)), search.loads, throw=False)
        return found if found.converged else None

    def _near(self, search: Search, reference: Array) -> Iterator[Array]:
        """Allowed joints, those first whose free tip is nearest to the target; rotations near those of a reference."""
        joints, poses = self.table
        tubes = joints.shape[1] // 2
        wanted = search.target.seen_from(self._forward.robot.base_pose)
        turns = np.arctan2(*wanted.position[1::-1]) - np.arctan2(poses[:, 1, 3], poses[:, 0, 3])
        for k in np.argsort(_apart(wanted, poses, turns)):
            own = joints[k].copy()
            own[:tubes] += turns[k]
            own[:tubes] -= 2.0 * np.pi * np.round((own[:tubes] - reference[:tubes]) / (2.0 * np.pi))
            yield search.allowed.nearest(own, search.weights)


def loaded(search: Search, initial: Equilibrium) -> Equilibrium | None:
    """A shape as it becomes under the loads of a search; None where it snaps."""
    if initial.loads == search.loads:
        return initial
    found = search.forward.solve(initial.actuation, search.loads, initial, throw=False)
    return found if found.converged and found.is_stable is not False else None


def _apart(wanted: Target, poses: Array, turns: Array) -> Array:
    """How far tips are from a target, each turned about the entry's axis; angles as lengths."""
    c, s, zero = np.cos(turns), np.sin(turns), np.zeros_like(turns)
    about = np.moveaxis(np.array([[c, -s, zero], [s, c, zero], [zero, zero, zero + 1.0]]), 2, 0)
    positions = np.einsum("kij,kj->ki", about, poses[:, :3, 3])
    distances = np.linalg.norm(positions - wanted.position, axis=1)
    if not wanted.turns:
        return np.asarray(distances)
    frames = about @ poses[:, :3, :3]
    own = frames[:, :, 3 - wanted.axes.shape[1] :]
    alike = (own * wanted.axes).sum(axis=(1, 2))
    cosine = alike if wanted.axes.shape[1] == 1 else 0.5 * (alike - 1.0)
    return np.asarray(np.hypot(distances, LENGTH * np.arccos(np.clip(cosine, -1.0, 1.0))))
