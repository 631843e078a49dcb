"""The data of a step as one dimensionless column of numbers.

The symbolic functions know the number of tubes and of nodes in a step; how many steps there are, where they lie and
what acts there is in the columns, so that nothing symbolic is rebuilt between solves.
"""

from __future__ import annotations

from typing import Any

import attrs
import numpy as np

from ..mechanics.boundary import Entry
from ..mechanics.rod import Local
from ..mechanics.sections import Configuration
from ..mechanics.state import slices
from ..robot.checks import Array


@attrs.frozen
class StepColumns:
    """Order of the data of a step with ``nodes`` interior nodes for ``tubes`` tubes."""

    tubes: int
    nodes: int

    @property
    def parts(self) -> dict[str, slice]:
        """Where each datum stands in a column."""
        n, c = self.tubes, self.nodes
        sizes = {
            "length": 1,
            "bending_stiffness": n,
            "torsional_stiffness": n,
            "precurvature": 3 * n * c,
            "force": 3 * c,
            "moment": 3 * n * c,
            "point_force": 3,
            "point_moment": 3 * n,
        }
        return slices(sizes)

    @property
    def size(self) -> int:
        """Entries of a column."""
        return int(self.parts["point_moment"].stop)

    def pack(self, configuration: Configuration, steps: Array, fractions: Array, middle: Array | None = None) -> Array:
        """Columns ``(size, k)`` for ``steps (k, 2)`` with data at ``fractions (nodes,)``; point loads act at step ends.

        ``middle (k,)`` is a point of the section that each step lies in, where its own middle does not tell.
        """
        count, parts, scales = len(steps), self.parts, configuration.scales
        nodes = configuration.nodes(steps, fractions, middle)
        point_force, point_moment = configuration.jumps(steps[:, 1])
        present = configuration.present(steps.mean(axis=1) if middle is None else middle)
        columns = np.zeros((count, self.size))
        columns[:, parts["length"]] = np.diff(steps) / scales.length
        columns[:, parts["bending_stiffness"]] = present * configuration.bending_stiffness / scales.stiffness
        columns[:, parts["torsional_stiffness"]] = configuration.torsional_stiffness / scales.stiffness
        columns[:, parts["precurvature"]] = nodes.precurvature.reshape(count, -1) * scales.length
        columns[:, parts["force"]] = nodes.force.reshape(count, -1) * (scales.length / scales.force)
        columns[:, parts["moment"]] = nodes.moment.reshape(count, -1) * (scales.length / scales.moment)
        columns[:, parts["point_force"]] = point_force / scales.force
        columns[:, parts["point_moment"]] = point_moment.reshape(count, -1) / scales.moment
        return columns.T.copy()

    def pad(self, columns: Array, count: int) -> Array:
        """``columns`` with steps of length zero appended up to ``count``, which change nothing."""
        extra = count - columns.shape[1]
        if extra == 0:
            return columns
        idle = np.zeros((self.size, extra))
        for name in ("bending_stiffness", "torsional_stiffness"):
            idle[self.parts[name]] = columns[self.parts[name], -1:]
        return np.hstack((columns, idle))

    def local(self, column: Any, node: int) -> Local[Any]:
        """The data at a node, out of a symbolic column."""
        parts, n = self.parts, self.tubes

        def at(name: str, width: int) -> Any:
            start = parts[name].start + 3 * width * node
            return column[start : start + 3 * width].reshape((3, width))

        return Local(
            column[parts["bending_stiffness"]],
            column[parts["torsional_stiffness"]],
            at("precurvature", n),
            at("force", 1),
            at("moment", n),
        )

    def point_load(self, column: Any) -> tuple[Any, Any]:
        """The force ``(3,)`` and the tubes' moments ``(3, tubes)`` at the end of the step."""
        return column[self.parts["point_force"]], column[self.parts["point_moment"]].reshape((3, self.tubes))

    def factors(self, force: float, moment: float, precurvature: float) -> Array:
        """By what each entry of a column is multiplied when all forces, moments and preset curvatures are."""
        return _factors(self.parts, {"force": force, "moment": moment, "precurvature": precurvature})


@attrs.frozen
class EntryColumn:
    """Order of the data at the entry point: those of ``mechanics.boundary.Entry``, and the point load there."""

    tubes: int

    @property
    def parts(self) -> dict[str, slice]:
        """Where each datum stands."""
        n = self.tubes
        sizes = {
            "position": 3,
            "orientation": 4,
            "rotations": n,
            "twist": n,
            "compliance": n,
            "force": 3,
            "point_force": 3,
            "point_moment": 3 * n,
        }
        return slices(sizes)

    @property
    def size(self) -> int:
        """Entries of the column."""
        return int(self.parts["point_moment"].stop)

    def pack(self, configuration: Configuration, total_force: Array) -> Array:
        """The column ``(size,)``; ``total_force`` is that of all loads behind ``s = 0``, dimensionless."""
        from scipy.spatial.transform import Rotation

        parts, scales = self.parts, configuration.scales
        pose = configuration.robot.base_pose
        point_force, point_moment = configuration.jumps(np.zeros(1))
        column = np.zeros(self.size)
        column[parts["position"]] = pose[:3, 3] / scales.length
        column[parts["orientation"]] = np.roll(Rotation.from_matrix(pose[:3, :3]).as_quat(), 1)
        column[parts["rotations"]] = configuration.actuation.rotations
        column[parts["twist"]] = configuration.transmission_twist
        column[parts["compliance"]] = configuration.transmission_compliance * scales.moment
        column[parts["point_force"]] = point_force[0] / scales.force
        column[parts["point_moment"]] = point_moment[0].reshape(-1) / scales.moment
        column[parts["force"]] = total_force + column[parts["point_force"]]
        return column

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

    def point_load(self, column: Any) -> tuple[Any, Any]:
        """The force and the tubes' moments that act at ``s = 0``."""
        return column[self.parts["point_force"]], column[self.parts["point_moment"]].reshape((3, self.tubes))

    def factors(self, force: float, moment: float, precurvature: float) -> Array:
        """By what each entry is multiplied when all forces, moments and preset curvatures are."""
        return _factors(self.parts, {"force": force, "moment": moment, "twist": precurvature})


def _factors(parts: dict[str, slice], of: dict[str, float]) -> Array:
    factors = np.ones(max(part.stop for part in parts.values()))
    for name, part in parts.items():
        factors[part] = of.get(name.removeprefix("point_"), 1.0)
    return factors
