"""Where else a search may start: random stable shapes of the free robot, those from which the way is short first."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from ..checks import Array
from ..forward.equilibrium import Equilibrium
from ..forward.problem import ForwardProblem
from ..robot.actuation import Actuation
from .limits import Allowed
from .search import Point, Search
from .table import Table

_SHAPES, _SHAPES_SLOW = 2000, 30  # by compiled code, and where each takes a tenth of a second
_SEED = 2010


class Starts:
    """Where searches start: home, and random actuations whose free shapes are stable, solved once.

    A free robot may be turned about the entry's axis as a whole: each shape stands for all that it so becomes.
    """

    def __init__(self, forward: ForwardProblem, allowed: Allowed, home: Array) -> None:
        self._forward, self._allowed, self._home = forward, allowed, home

    @cached_property
    def table(self) -> Table:
        """The random shapes."""
        count = _SHAPES if self._forward.compiles else _SHAPES_SLOW
        return Table.of(self._forward, self._allowed.drawn(self._home, count, np.random.default_rng(_SEED)))

    def points(self, search: Search, initial: Equilibrium | None, reference: Array, most: int) -> Iterator[Point]:
        """At most so many shapes under the loads of a search: the initial one or home, then those near the target."""
        if initial is None:
            first = self._at(search, search.allowed.nearest(self._home, search.weights))
        else:
            first = loaded(search, initial)
        if first is not None:
            yield Point(first, search.target)
        if most > 1:
            wanted = search.target.seen_from(self._forward.robot.base_pose)
            for joints in self.table.toward(wanted, search.allowed, search.weights, reference)[: most - 1]:
                shape = self._at(search, search.allowed.nearest(joints, search.weights))
                if shape is not None:
                    yield Point(shape, search.target)

    def _at(self, search: Search, joints: Array) -> Equilibrium | None:
        found = self._forward.solve(Actuation(*np.split(joints, 2)), search.loads, throw=False)
        return found if found.converged else None


def loaded(search: Search, initial: Equilibrium) -> Equilibrium | None:
    """A shape as it becomes under the loads of a search; None where it snaps."""
    if initial.loads == search.loads:
        return initial
    found = search.forward.solve(initial.actuation, search.loads, initial, throw=False)
    return found if found.converged and found.is_stable is not False else None
