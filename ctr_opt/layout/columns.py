"""The data of a step as one dimensionless column of numbers.

The symbolic functions know the number of tubes, of nodes in a step and the kind of loads; how many steps there are,
where they lie and what acts there is in the columns, so that nothing symbolic is rebuilt between solves.
"""

from __future__ import annotations

from functools import cached_property
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
from .load_columns import LoadColumns


@attrs.frozen
class StepColumns:
    """Order of the data of a step with ``nodes`` interior nodes for ``tubes`` tubes and a kind of loads."""

    tubes: int
    nodes: int
    kind: Kind = DEAD

    @cached_property
    def _inner(self) -> LoadColumns:
        return LoadColumns(self.tubes, self.nodes, self.kind)

    @cached_property
    def _point(self) -> LoadColumns:
        return LoadColumns(self.tubes, 1, self.kind, "point_")

    @cached_property
    def parts(self) -> dict[str, slice]:
        """Where each datum stands in a column."""
        n, c = self.tubes, self.nodes
        own = {"length": 1, **dict.fromkeys(Stiffness.names(), n), "precurvature": 3 * n * c}
        return slices({**own, **self._inner.sizes, **self._point.sizes})

    @property
    def size(self) -> int:
        """Entries of a column."""
        return int(max(part.stop for part in self.parts.values()))

    def pack(self, configuration: Configuration, steps: Array, fractions: Array, middle: Array | None = None) -> Array:
        """Columns ``(size, k)`` for ``steps (k, 2)`` with data at ``fractions (nodes,)``; point loads act at step ends.

        ``middle (k,)`` is a point of the section that each step lies in, where its own middle does not tell.
        """
        count, scales, fields = len(steps), configuration.scales, self.kind.fields
        nodes = configuration.nodes(steps, fractions, middle, fields)
        places = steps[:, :1] + fractions * np.diff(steps)
        present = configuration.present(steps.mean(axis=1) if middle is None else middle)
        own = {
            "length": np.diff(steps),
            **existing(configuration.stiffness, present),
            "precurvature": nodes.precurvature.reshape(count, -1),
        }
        units = self.units(scales)
        data = {
            **{name: part * units[name] for name, part in own.items()},
            **self._inner.pack(nodes.loads, places, scales, scales.length),
            **self._point.pack(configuration.jumps(steps[:, 1], fields), steps[:, 1:], scales, 1.0),
        }
        columns = np.zeros((count, self.size))
        for name, part in self.parts.items():
            columns[:, part] = data[name]
        return columns.T.copy()

    def units(self, scales: Scales) -> dict[str, float]:
        """By what the parts are multiplied to be dimensionless."""
        stiffness = {name: scales.length ** -Stiffness.lengths(name) / scales.stiffness for name in Stiffness.names()}
        loads = self._inner.units(scales, scales.length) | self._point.units(scales, 1.0)
        return {"length": 1.0 / scales.length, **stiffness, "precurvature": scales.length, **loads}

    def pad(self, columns: Array, count: int) -> Array:
        """``columns`` with steps of length zero appended up to ``count``, which change nothing."""
        extra = count - columns.shape[1]
        if extra == 0:
            return columns
        idle = np.zeros((self.size, extra))
        for name, part in self.parts.items():
            if name in Stiffness.names() or name.endswith(("unit", "place", "numbers")):
                idle[part] = columns[part, -1:]
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

    def point_load(self, column: Any, state: State[Any]) -> tuple[Any, Any]:
        """The force ``(3,)`` and the tubes' moments ``(3, tubes)`` at the end of the step."""
        return self._point.at(column, self.parts, 0, state)

    def node(self, column: Any, node: int) -> Any:
        """The data at a node as a column of the same step with that node alone."""
        parts, width = self.parts, {name: size // self.nodes for name, size in self._inner.sizes.items()}
        width |= {"precurvature": 3 * self.tubes, "unit": 0, "numbers": 0}

        def own(name: str, part: slice) -> Any:
            size = width.get(name, 0)
            return column[part.start + size * node : part.start + size * (node + 1)] if size else column[part]

        return ca.vertcat(*(own(name, part) for name, part in parts.items()))

    def load_energy(self, column: Any, node: int, position: Any) -> Any:
        """The loads' potential per arc length at a node."""
        return self._inner.energy(column, self.parts, node, position)

    def point_energy(self, column: Any, position: Any) -> Any:
        """The potential of the loads at the end of the step."""
        return self._point.energy(column, self.parts, 0, position)

    def factors(self, conservative: float, rest: float, precurvature: float) -> Array:
        """By what each entry is multiplied when loads with and without a potential and preset curvatures are."""
        inner = self._inner.factors(self.parts, conservative, rest)
        point = self._point.factors(self.parts, conservative, rest)
        return _factors(self.parts, {**inner, **point, "precurvature": precurvature})


@attrs.frozen
class EntryColumn:
    """Order of the data at the entry point: those of ``mechanics.boundary.Entry``, and the point load there."""

    tubes: int
    kind: Kind = DEAD

    @cached_property
    def _point(self) -> LoadColumns:
        return LoadColumns(self.tubes, 1, self.kind, "point_")

    @cached_property
    def parts(self) -> dict[str, slice]:
        """Where each datum stands."""
        n = self.tubes
        own = {"position": 3, "orientation": 4, "rotations": n, "twist": n, "compliance": n, "force": 3}
        return slices({**own, **self._point.sizes})

    @property
    def size(self) -> int:
        """Entries of the column."""
        return int(max(part.stop for part in self.parts.values()))

    def pack(self, configuration: Configuration, total_force: Array) -> Array:
        """The column ``(size,)``; ``total_force`` is that of the dead loads behind ``s = 0``, dimensionless."""
        scales, pose, start = configuration.scales, configuration.robot.base_pose, np.zeros(1)
        point = self._point.pack(configuration.jumps(start, self.kind.fields), start[:, None], scales, 1.0)
        units = self.units(scales)
        data = {
            "position": pose[:3, 3] * units["position"],
            "orientation": configuration.robot.base_quaternion,
            "rotations": configuration.actuation.rotations,
            "twist": configuration.transmission_twist,
            "compliance": configuration.transmission_compliance * units["compliance"],
            "force": total_force.ravel() + point["point_force"][0],
            **{name: part[0] for name, part in point.items()},
        }
        column = np.zeros(self.size)
        for name, part in self.parts.items():
            column[part] = data[name]
        return column

    def units(self, scales: Scales) -> dict[str, float]:
        """By what the parts are multiplied to be dimensionless; the total force is so already."""
        own = {"position": 1.0 / scales.length, "orientation": 1.0, "rotations": 1.0, "twist": 1.0, "force": 1.0}
        return {**own, "compliance": scales.moment, **self._point.units(scales, 1.0)}

    def entry(self, column: Any) -> Entry[Any]:
        """The entry point's data out of a symbolic column."""
        parts = self.parts
        return Entry(
            column[parts["position"]],
            column[parts["orientation"]],
            column[parts["rotations"]] + column[parts["twist"]],
            column[parts["compliance"]],
            column[parts["force"]],
        )

    def point_load(self, column: Any, state: State[Any]) -> tuple[Any, Any]:
        """The force and the tubes' moments that act at ``s = 0``."""
        return self._point.at(column, self.parts, 0, state)

    def point_energy(self, column: Any, position: Any) -> Any:
        """The potential of the loads at ``s = 0``."""
        return self._point.energy(column, self.parts, 0, position)

    def factors(self, conservative: float, rest: float, precurvature: float) -> Array:
        """By what each entry is multiplied when loads with and without a potential and preset curvatures are."""
        point = self._point.factors(self.parts, conservative, rest)
        return _factors(self.parts, {**point, "force": conservative, "twist": precurvature})


def existing(stiffness: Stiffness, present: Any) -> dict[str, Any]:
    """Stiffnesses by name where tubes are ``present`` (one) or have ended (zero)."""
    values = {name: getattr(stiffness, name) for name in stiffness.names()}
    return {name: value if stiffness.everywhere(name) else present * value for name, value in values.items()}


def _factors(parts: dict[str, slice], of: dict[str, Any]) -> Array:
    factors = np.ones(max(part.stop for part in parts.values()))
    for name, factor in of.items():
        factors[parts[name]] = factor
    return factors
