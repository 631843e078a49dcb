"""The data of a step as one dimensionless column of numbers.

The symbolic functions depend on the number of tubes, the number of nodes in a step and the kind of loads. The columns
hold the steps' lengths and the loads, so nothing symbolic is rebuilt between solves. A table gives each datum's size,
its unit, and what it grows with; the rest of this module follows from it.
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
from ..mechanics.boundary import EntryPoint
from ..mechanics.kind import DEAD, Kind
from ..mechanics.law import Stiffness
from ..mechanics.rod import Local
from ..mechanics.state import State, slices
from .configuration import Configuration, Scales
from .load_columns import Datum, LoadColumns


class _Columns:
    """Common part of the columns of steps and of the entry point."""

    tubes: int
    kind: Kind

    def _data(self) -> dict[str, Datum]:
        """The data in order, without loads at a point."""
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
        """Position of each datum in a column."""
        return slices({name: part.size for name, part in self.table.items()})

    @property
    def size(self) -> int:
        """Number of entries in a column."""
        return sum(part.size for part in self.table.values())

    def units(self, scales: Scales) -> dict[str, float]:
        """Factors that make the data dimensionless."""
        return {name: part.unit(scales) for name, part in self.table.items()}

    def factors(self, conservative: float, rest: float, precurvature: float) -> Array:
        """Factor of each entry, given factors of loads with a potential, other loads, and preset curvatures."""
        of = {"conservative": conservative, "rest": rest, "precurvature": precurvature}
        parts = self.table.values()
        return np.concatenate([np.resize([of[name] for name in part.grows] or [1.0], part.size) for part in parts])

    def _filled(self, data: Mapping[str, Any], scales: Scales, count: int) -> Array:
        """Fill columns ``(count, size)`` with data in SI, made dimensionless."""
        columns = np.zeros((count, self.size))
        for name, unit in self.units(scales).items():
            columns[:, self.parts[name]] = data[name] * unit
        return columns

    def point_load(self, column: Any, state: State[Any]) -> tuple[Any, Any]:
        """The force ``(3,)`` and the tubes' moments ``(3, tubes)`` at the end of the step, or at ``s = 0``."""
        return self._point.at(column, self.parts, 0, state)

    def point_energy(self, column: Any, position: Any) -> Any:
        """Potential of the loads at the end of the step, or at ``s = 0``."""
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
        """Pack ``steps (k, 2)`` with data at ``fractions (nodes,)`` into columns ``(size, k)``.

        Point loads act at step ends. ``middle (k,)`` is a point in the section of each step; default: the step's
        middle.
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
        """Append steps of length zero to ``columns`` up to ``count``; they change nothing."""
        extra = count - columns.shape[1]
        if extra == 0:
            return columns
        idle = np.zeros((self.size, extra))
        for name, part in self.table.items():
            if name != "length" and not part.grows:
                idle[self.parts[name]] = columns[self.parts[name], -1:]
        return np.hstack((columns, idle))

    def total_force(self, columns: Any, weights: Array) -> Any:
        """Total force ``(3, 1)`` of all dead loads beyond ``s = 0``; ``weights`` are the nodes' quadrature weights."""
        start = self.parts["force"].start
        density = sum(float(w) * columns[start + 3 * c : start + 3 * c + 3, :] for c, w in enumerate(weights))
        return density @ columns[:1, :].T + columns[self.parts["point_force"], :] @ np.ones((columns.shape[1], 1))

    def local(self, column: Any, node: int, state: State[Any] | None = None) -> Local[Any]:
        """Extract the data at a node from a symbolic column; ``state`` adds the loads that depend on it."""
        parts, n = self.parts, self.tubes
        start = parts["precurvature"].start + 3 * n * node
        return Local(
            Stiffness.of(lambda name: column[parts[name]]),
            column[start : start + 3 * n].reshape((3, n)),
            *self._inner.at(column, parts, node, state),
        )

    def node(self, column: Any, node: int) -> Any:
        """Extract the column of the same step with this node alone."""

        def at_node(part: Datum, at: slice) -> Any:
            width = part.size // self.nodes
            return column[at.start + width * node : at.start + width * (node + 1)] if part.at_nodes else column[at]

        return ca.vertcat(*map(at_node, self.table.values(), self.parts.values()))

    def load_energy(self, column: Any, node: int, position: Any) -> Any:
        """Potential of the loads per arc length at a node."""
        return self._inner.energy(column, self.parts, node, position)


@attrs.frozen(slots=False)
class EntryColumn(_Columns):
    """Order of the data at the entry point: the fields of ``boundary.EntryPoint`` and the point load there."""

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
        """Pack the column ``(size,)``; ``total_force`` of the dead loads beyond ``s = 0`` is dimensionless."""
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

    def entry(self, column: Any) -> EntryPoint[Any]:
        """Extract the entry point's data from a symbolic column."""
        of = {name: column[part] for name, part in self.parts.items()}
        turned = of["rotations"] + of["twist"]
        return EntryPoint(of["position"], of["orientation"], turned, of["compliance"], of["force"])


def existing(stiffness: Stiffness, present: Any) -> dict[str, Any]:
    """Stiffnesses by name, for tubes that are ``present`` (one) or have ended (zero)."""
    values = {name: getattr(stiffness, name) for name in stiffness.names()}
    return {name: value if stiffness.everywhere(name) else present * value for name, value in values.items()}


def _per_length(scales: Scales) -> float:
    return 1.0 / scales.length


def _stiffness(name: str) -> Callable[[Scales], float]:
    return lambda scales: scales.length ** -Stiffness.lengths(name) / scales.stiffness
