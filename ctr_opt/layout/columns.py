"""The data of a step as one dimensionless column of numbers.

The symbolic functions know the number of tubes, of nodes in a step and the kind of loads; how many steps there are,
where they lie and what acts there is in the columns, so that nothing symbolic is rebuilt between solves. A table says
of every datum how many numbers it is, in which unit, and with what it grows; all else follows from it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from operator import attrgetter
from typing import Any

import attrs
import casadi as ca
import numpy as np

from ..checks import Array
from ..mechanics.boundary import Entry
from ..mechanics.kind import DEAD, Kind
from ..mechanics.law import Stiffness
from ..mechanics.rod import Local
from ..mechanics.state import State, slices
from .configuration import Configuration, Scales
from .load_columns import Datum, LoadColumns


class _Columns:
    """What the columns of steps and of the entry point have in common."""

    tubes: int
    kind: Kind

    def _data(self) -> dict[str, Datum]:
        """The data but those of loads at a point, in order."""
        raise NotImplementedError

    @cached_property
    def _point(self) -> LoadColumns:
        return LoadColumns(self.tubes, 1, self.kind, "point_")

    @cached_property
    def table(self) -> dict[str, Datum]:
        """The data in order."""
        return self._data() | self._point.table

    @cached_property
    def parts(self) -> dict[str, slice]:
        """Where each datum stands in a column."""
        return slices({name: part.size for name, part in self.table.items()})

    @property
    def size(self) -> int:
        """Entries of a column."""
        return sum(part.size for part in self.table.values())

    def units(self, scales: Scales) -> dict[str, float]:
        """By what the data are multiplied to be dimensionless."""
        return {name: part.unit(scales) for name, part in self.table.items()}

    def factors(self, conservative: float, rest: float, precurvature: float) -> Array:
        """By what each entry is multiplied when loads with and without a potential and preset curvatures are."""
        of = {"conservative": conservative, "rest": rest, "precurvature": precurvature}
        parts = self.table.values()
        return np.concatenate([np.resize([of[name] for name in part.grows] or [1.0], part.size) for part in parts])

    def _filled(self, data: Mapping[str, Any], scales: Scales, count: int) -> Array:
        """Columns ``(count, size)`` of data in SI."""
        columns = np.zeros((count, self.size))
        for name, unit in self.units(scales).items():
            columns[:, self.parts[name]] = data[name] * unit
        return columns

    def point_load(self, column: Any, state: State[Any]) -> tuple[Any, Any]:
        """The force ``(3,)`` and the tubes' moments ``(3, tubes)`` at the end of the step, or at ``s = 0``."""
        return self._point.at(column, self.parts, 0, state)

    def point_energy(self, column: Any, position: Any) -> Any:
        """The potential of the loads there."""
        return self._point.energy(column, self.parts, 0, position)


@attrs.frozen(slots=False)
class StepColumns(_Columns):
    """Order of the data of a step with ``nodes`` interior nodes for ``tubes`` tubes and a kind of loads."""

    tubes: int
    nodes: int
    kind: Kind = DEAD

    @cached_property
    def _inner(self) -> LoadColumns:
        return LoadColumns(self.tubes, self.nodes, self.kind)

    def _data(self) -> dict[str, Datum]:
        curved = Datum(3 * self.tubes * self.nodes, attrgetter("length"), True, ("precurvature",))
        stiffness = {name: Datum(self.tubes, _stiffness(name)) for name in Stiffness.names()}
        return {"length": Datum(1, _per_length), **stiffness, "precurvature": curved, **self._inner.table}

    def pack(self, configuration: Configuration, steps: Array, fractions: Array, middle: Array | None = None) -> Array:
        """Columns ``(size, k)`` for ``steps (k, 2)`` with data at ``fractions (nodes,)``; point loads act at step ends.

        ``middle (k,)`` is a point of the section that each step lies in, where its own middle does not tell.
        """
        scales, fields = configuration.scales, self.kind.fields
        precurvature, loads = configuration.nodes(steps, fractions, middle, fields)
        places = steps[:, :1] + fractions * np.diff(steps)
        present = configuration.present(steps.mean(axis=1) if middle is None else middle)
        data = {
            "length": np.diff(steps),
            **existing(configuration.stiffness, present),
            "precurvature": precurvature.reshape(len(steps), -1),
            **self._inner.values(loads, places, scales),
            **self._point.values(configuration.jumps(steps[:, 1], fields), steps[:, 1:], scales),
        }
        return self._filled(data, scales, len(steps)).T.copy()

    def pad(self, columns: Array, count: int) -> Array:
        """``columns`` with steps of length zero appended up to ``count``, which change nothing."""
        extra = count - columns.shape[1]
        if extra == 0:
            return columns
        idle = np.zeros((self.size, extra))
        for name, part in self.table.items():
            if name != "length" and not part.grows:
                idle[self.parts[name]] = columns[self.parts[name], -1:]
        return np.hstack((columns, idle))

    def total_force(self, columns: Any, weights: Array) -> Any:
        """Of all dead loads behind ``s = 0``, ``(3, 1)``; ``weights`` are the quadrature's of the nodes."""
        start = self.parts["force"].start
        density = sum(float(w) * columns[start + 3 * c : start + 3 * c + 3, :] for c, w in enumerate(weights))
        return density @ columns[:1, :].T + columns[self.parts["point_force"], :] @ np.ones((columns.shape[1], 1))

    def local(self, column: Any, node: int, state: State[Any] | None = None) -> Local[Any]:
        """The data at a node, out of a symbolic column; with ``state``, the loads that depend on it included."""
        parts, n = self.parts, self.tubes
        start = parts["precurvature"].start + 3 * n * node
        return Local(
            Stiffness.of(lambda name: column[parts[name]]),
            column[start : start + 3 * n].reshape((3, n)),
            *self._inner.at(column, parts, node, state),
        )

    def node(self, column: Any, node: int) -> Any:
        """The data at a node as a column of the same step with that node alone."""

        def own(part: Datum, at: slice) -> Any:
            width = part.size // self.nodes
            return column[at.start + width * node : at.start + width * (node + 1)] if part.at_nodes else column[at]

        return ca.vertcat(*map(own, self.table.values(), self.parts.values()))

    def load_energy(self, column: Any, node: int, position: Any) -> Any:
        """The loads' potential per arc length at a node."""
        return self._inner.energy(column, self.parts, node, position)


@attrs.frozen(slots=False)
class EntryColumn(_Columns):
    """Order of the data at the entry point: those of ``mechanics.boundary.Entry``, and the point load there."""

    tubes: int
    kind: Kind = DEAD

    def _data(self) -> dict[str, Datum]:
        n = self.tubes
        return {
            "position": Datum(3, _per_length),
            "orientation": Datum(4),
            "rotations": Datum(n),
            "twist": Datum(n, grows=("precurvature",)),
            "compliance": Datum(n, attrgetter("moment")),
            "force": Datum(3, grows=("conservative",)),  # dimensionless already
        }

    def pack(self, configuration: Configuration, total_force: Array) -> Array:
        """The column ``(size,)``; ``total_force`` is that of the dead loads behind ``s = 0``, dimensionless."""
        scales, robot, start = configuration.scales, configuration.robot, np.zeros(1)
        point = self._point.values(configuration.jumps(start, self.kind.fields), start[:, None], scales)
        data = {
            "position": robot.base_pose[:3, 3],
            "orientation": robot.base_quaternion,
            "rotations": configuration.actuation.rotations,
            "twist": configuration.transmission_twist,
            "compliance": configuration.transmission_compliance,
            "force": total_force.ravel() + point["point_force"][0] * self.units(scales)["point_force"],
            **point,
        }
        return np.asarray(self._filled(data, scales, 1)[0])

    def entry(self, column: Any) -> Entry[Any]:
        """The entry point's data out of a symbolic column."""
        of = {name: column[part] for name, part in self.parts.items()}
        turned = of["rotations"] + of["twist"]
        return Entry(of["position"], of["orientation"], turned, of["compliance"], of["force"])


def existing(stiffness: Stiffness, present: Any) -> dict[str, Any]:
    """Stiffnesses by name where tubes are ``present`` (one) or have ended (zero)."""
    values = {name: getattr(stiffness, name) for name in stiffness.names()}
    return {name: value if stiffness.everywhere(name) else present * value for name, value in values.items()}


def _per_length(scales: Scales) -> float:
    return 1.0 / scales.length


def _stiffness(name: str) -> Callable[[Scales], float]:
    return lambda scales: scales.length ** -Stiffness.lengths(name) / scales.stiffness
