"""A robot in expressions of parameters, and the break points of its tubes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any

import casadi as ca

from ..mechanics.law import Stiffness, straight_energy_density
from ..robot.names import NamedNumber, parameters
from ..robot.piecewise import gauss
from ..robot.tube import STIFFNESSES
from .configuration import Configuration
from .ends import chained_symbols, first_at_tip
from .ordering import ENTRY, Key, Order


class ParametricRobot:
    """The robot of a configuration in which columns of symbols, ``values``, replace some parameters.

    ``clip`` keeps each break point on its tube, for when the order of break points is not known.
    """

    def __init__(self, configuration: Configuration, values: Mapping[str, Any], clip: bool) -> None:
        self.configuration = configuration
        self.tubes = configuration.tube_count
        self.values = values
        self.clip = clip
        self._known: dict[str, NamedNumber] = parameters(
            configuration.robot, configuration.actuation, configuration.loads
        )
        self.points: dict[Key, Any] = {ENTRY: 0.0}
        self.nominal: dict[Key, float] = {ENTRY: 0.0}
        self.translations = [self.at("translations", i) for i in range(self.tubes)]
        self.shapes = [self._shape(i) for i in range(self.tubes)]

    # -- values ----------------------------------------------------------------------------------------------------

    def at(self, name: str, k: int = 0) -> Any:
        """Return one number of a parameter."""
        if name in self.values:
            return self.values[name][k]
        return float(self._known[name].value.flat[k])

    def vector(self, name: str) -> Any:
        """Return a parameter of three numbers as a column."""
        return self.rows(name)[0]

    def rows(self, name: str) -> list[Any]:
        """Return the rows of three numbers of a parameter as columns."""
        if name in self.values:
            return [self.values[name][3 * k : 3 * k + 3] for k in range(self.values[name].shape[0] // 3)]
        return [ca.DM(row) for row in self._known[name].value.reshape(-1, 3)]

    @cached_property
    def stiffness(self) -> Stiffness:
        """Stiffnesses of the tubes ``(tubes,)``."""
        return Stiffness.of(lambda field: ca.vertcat(*(self._stiffness(i, field) for i in range(self.tubes))))

    def _stiffness(self, i: int, field: str) -> Any:
        tube, prefix = self.configuration.robot.tubes[i], f"tubes[{i}]."
        if prefix + field in self.values or field in tube.given_stiffnesses:
            return self.at(prefix + field)
        return STIFFNESSES[field](lambda name: None if getattr(tube, name) is None else self.at(prefix + name))

    @property
    def base(self) -> tuple[Any, Any, Any]:
        """The rotations, and translation and angles of the entry point relative to the robot's base pose."""
        rotations = ca.vertcat(*(self.at("rotations", i) for i in range(self.tubes)))
        return rotations, self.vector("base.translation"), self.vector("base.rotation")

    # -- preset curvatures -----------------------------------------------------------------------------------------

    def _shape(self, i: int) -> list[tuple[Key, list[Any]]]:
        """Pieces of a tube: the break point where each begins, and coefficients of powers of ``s`` from there."""
        tube = self.configuration.robot.tubes[i]
        starts, end = list(tube.shape.breaks), self.translations[i]
        pieces: list[tuple[Key, list[Any]]] = []
        self.add(("tube", i, 0), end, self.configuration.translations[i])
        for k, piece in enumerate(tube.precurvature):
            name = f"tubes[{i}].precurvature[{k}]"
            stretch = self.at(f"{name}.length") / piece.length
            curvature = self.rows(f"{name}.{piece.rows}") if piece.rows else [ca.DM.zeros(3)]
            for width, rows in piece.parts(curvature, stretch):
                pieces.append((("tube", i, len(pieces)), rows))
                end = end + width
                nominal = float(self.configuration.translations[i] + starts[len(pieces)])
                self.add(("tube", i, len(pieces)), end, nominal)
        return pieces

    def tube_end(self, i: int) -> Key:
        """Name of the break point where a tube ends."""
        return ("tube", i, len(self.shapes[i]))

    @property
    def tube_ends(self) -> list[Any]:
        """Arc lengths of the tubes' ends."""
        return [self.points[self.tube_end(i)] for i in range(self.tubes)]

    @cached_property
    def chained_ends(self) -> dict[Key, Any]:
        """The tubes' ends with coinciding ones made equal, for comparisons."""
        ends = chained_symbols(self.tube_ends, self.configuration.ends.slack)
        return {self.tube_end(i): end for i, end in enumerate(ends)}

    @property
    def length(self) -> Any:
        """Length of the robot: the end of the outermost tube that ends at the tip, which comes last in an order."""
        weights = first_at_tip([*self.chained_ends.values()][::-1])[::-1]
        return sum(weight * end for weight, end in zip(weights, self.tube_ends, strict=True))

    @property
    def tube_at_tip(self) -> Any:
        """Weights ``(tubes,)``: one for the innermost tube that ends at the tip."""
        return ca.vertcat(*first_at_tip([*self.chained_ends.values()]))

    def present(self, order: Order, i: int, section: int) -> Any:
        """Return one if a tube exists in a section."""
        return 1.0 - order.passed(self.tube_end(i), section)

    def precurvature(self, order: Order, i: int, section: int) -> tuple[Any, list[Any]]:
        """Precurvature of a tube in a section: its origin and coefficients of powers; zero past the tube's end."""
        start, rows = 0.0, [ca.SX.zeros(3) for _ in range(max(len(rows) for _, rows in self.shapes[i]))]
        for j, (key, coefficients) in enumerate(self.shapes[i]):
            weight = order.within(key, ("tube", i, j + 1), section)
            if isinstance(weight, float) and weight == 0.0:
                continue
            start += weight * self.points[key]
            for d, row in enumerate(coefficients):
                rows[d] += weight * row
        return start, rows

    def twist_behind(self, order: Order, i: int) -> Any:
        """Integral of ``u*_i,z`` behind the entry point."""
        twist = ca.SX(0)
        for low, high, rows in self._pieces_behind(order, i):
            for d, row in enumerate(rows):
                twist += row[2] * (high ** (d + 1) - low ** (d + 1)) / (d + 1)
        return twist

    def energy_behind(self, order: Order, i: int) -> Any:
        """Energy that holds curved parts of a tube straight behind the entry point, J."""
        energy, stiffness = ca.SX(0), self.stiffness.of_tube(i)
        for low, high, rows in self._pieces_behind(order, i):
            half, middle = 0.5 * (high - low), 0.5 * (high + low)
            for point, weight in zip(*gauss(2 * len(rows)), strict=True):
                place = middle + float(point) * half
                preset = sum(row * place**d for d, row in enumerate(rows))
                energy += float(weight) * half * straight_energy_density(preset, stiffness)
        return energy

    def _pieces_behind(self, order: Order, i: int) -> Iterator[tuple[Any, Any, list[Any]]]:
        """Yield the parts of a tube's pieces behind the entry point: start and end in the piece, and coefficients."""
        for j, (key, rows) in enumerate(self.shapes[i]):
            rank = order.ranks[key]
            if not (isinstance(rank, int) and rank >= 0):
                start = self.points[key]
                yield order.behind[key] - start, order.behind["tube", i, j + 1] - start, rows

    # -- break points ---------------------------------------------------------------------------------------------

    def add(self, key: Key, value: Any, nominal: float, end: Any = None) -> Key:
        """Add a break point, kept in front of the ``end`` of its tube if points are clipped."""
        if self.clip and end is not None:
            value = ca.if_else(value <= end, value, end)
        self.points[key] = value
        self.nominal[key] = float(nominal)
        return key
