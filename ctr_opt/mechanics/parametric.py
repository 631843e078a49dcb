"""A robot under loads with parameters for numbers: what ``sections.Configuration`` says, symbolically.

Stiffnesses, preset curvatures, break points and loads are expressions of the parameters that are asked for and plain
numbers elsewhere; which section they belong to is told by an ``Order``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

import attrs
import casadi as ca
import numpy as np

from ..robot import tube as formulas
from ..robot.fields import ExpressionLoad, PotentialLoad
from ..robot.loads import DistributedLoad, Load, LoadTable, PointWrench
from ..robot.parameters import Parameter, parameters
from ..robot.precurvature import PolynomialCurvature, SampledCurvature, along_arc_length
from ..robot.weights import DistributedMass, Gravity, PointMass
from .loading import Field
from .ordering import AHEAD, ENTRY, PASSED, Key, Order
from .sections import Configuration

_SAME_POINT = 1e-12  # of the length


@attrs.frozen(eq=False)
class Density:
    """A load per arc length: ``rows[j] + slopes[j] (s - arc_length[j])`` behind the knot ``j``; or a ``function`` of numbers."""

    knots: list[Key] = attrs.field(factory=list)
    arc_length: list[float] = attrs.field(factory=list)
    rows: list[Any] = attrs.field(factory=list)
    slopes: list[Any] = attrs.field(factory=list)
    function: Any = None


@attrs.frozen(eq=False)
class Push:
    """A load of given direction: at the point ``start``, where there is no ``end``, or between two break points."""

    start: Key
    end: Key | None
    tube: int
    body: bool
    force: Any
    moment: Any


@attrs.frozen(eq=False)
class FieldPush:
    """A load given as an expression, likewise."""

    start: Key
    end: Key | None
    field: Field
    factor: Any


class Parametric:
    """The configuration with the ``values`` of some parameters, columns of symbols, in the place of its own.

    ``probes`` are arc lengths that are to be break points. Where the order is not known, ``clip`` keeps every break
    point on its tube.
    """

    def __init__(
        self, configuration: Configuration, values: Mapping[str, Any], probes: Sequence[float] = (), clip: bool = False
    ) -> None:
        self.configuration = configuration
        self.tubes = configuration.tube_count
        self._values = values
        self._clip = clip
        self._known: dict[str, Parameter] = parameters(
            configuration.robot, configuration.actuation, configuration.loads
        )
        self._within: list[Any] = []  # what must not be negative: how far loads are from the ends of their tubes
        self.points: dict[Key, Any] = {ENTRY: 0.0}
        self.nominal: dict[Key, float] = {ENTRY: 0.0}
        self.translations = [self._at("translations", i) for i in range(self.tubes)]
        self.shapes = [self._shape(i) for i in range(self.tubes)]
        self.gravity = sum(
            (self._vector(f"loads[{k}].acceleration") for k, load in self._loads if isinstance(load, Gravity)),
            ca.DM.zeros(3),
        )
        self.pushes: list[Push] = []
        self.fields: list[FieldPush] = []
        for k, load in self._loads:
            self._place(k, load)
        self._fix_others()
        for k, s in enumerate(probes):
            self._add(("probe", k), s, s, self.length)

    # -- values ----------------------------------------------------------------------------------------------------

    @property
    def _loads(self) -> list[tuple[int, Load]]:
        return list(enumerate(self.configuration.loads))

    def _at(self, name: str, k: int = 0) -> Any:
        if name in self._values:
            return self._values[name][k]
        return float(self._known[name].value.flat[k])

    def _vector(self, name: str) -> Any:
        return self._rows(name)[0]

    def _rows(self, name: str) -> list[Any]:
        """The rows of three of a parameter, as columns."""
        if name in self._values:
            return [self._values[name][3 * k : 3 * k + 3] for k in range(self._values[name].shape[0] // 3)]
        return [ca.DM(row) for row in self._known[name].value.reshape(-1, 3)]

    @cached_property
    def bending_stiffness(self) -> list[Any]:
        """``EI`` of the tubes, N m^2."""
        return [self._stiffness(i, "bending_stiffness") for i in range(self.tubes)]

    @cached_property
    def torsional_stiffness(self) -> list[Any]:
        """``GJ`` of the tubes, N m^2."""
        return [self._stiffness(i, "torsional_stiffness") for i in range(self.tubes)]

    def _stiffness(self, i: int, field: str) -> Any:
        tube, name = self.configuration.robot.tubes[i], f"tubes[{i}]."
        if name + field in self._values or field in tube.given_stiffnesses:
            return self._at(name + field)
        area = formulas.second_moment(self._at(name + "outer_diameter"), self._at(name + "inner_diameter"))
        if field == "bending_stiffness":
            return self._at(name + "youngs_modulus") * area
        if tube.shear_modulus is not None:
            return formulas.torsional_stiffness(self._at(name + "shear_modulus"), area)
        shear = formulas.shear_modulus(self._at(name + "youngs_modulus"), self._at(name + "poisson_ratio"))
        return formulas.torsional_stiffness(shear, area)

    @property
    def base(self) -> tuple[Any, Any, Any]:
        """Rotations; translation and angles of the entry point relative to the robot's base pose."""
        rotations = ca.vertcat(*(self._at("rotations", i) for i in range(self.tubes)))
        return rotations, self._vector("base.translation"), self._vector("base.rotation")

    # -- preset curvatures -----------------------------------------------------------------------------------------

    def _shape(self, i: int) -> list[tuple[Key, list[Any]]]:
        """The pieces of a tube: the break point where each begins, and coefficients of powers of ``s`` from there."""
        tube = self.configuration.robot.tubes[i]
        starts, pieces, end = list(tube.shape.breaks), [], self.translations[i]
        self._add(("tube", i, 0), end, self.configuration.translations[i])
        for k, piece in enumerate(tube.precurvature):
            name = f"tubes[{i}].precurvature[{k}]"
            stretch = self._at(f"{name}.length") / piece.length
            for width, rows in _polynomials(piece, name, stretch, self):
                pieces.append((("tube", i, len(pieces)), rows))
                end = end + width
                nominal = float(self.configuration.translations[i] + starts[len(pieces)])
                self._add(("tube", i, len(pieces)), end, nominal)
        return pieces

    def tube_end(self, i: int) -> Key:
        """The break point where a tube ends."""
        return ("tube", i, len(self.shapes[i]))

    @property
    def length(self) -> Any:
        """The largest tube end."""
        length, *ends = (self.points[self.tube_end(i)] for i in range(self.tubes))
        for end in ends:
            length = ca.if_else(length < end, end, length)
        return length

    @property
    def margin(self) -> Any:
        """How far the robot is from what it cannot be, m: loads beyond their tubes, tubes drawn out or in too far."""
        ends = [self.points[self.tube_end(i)] for i in range(self.tubes)]
        margins = [*self._within, *ends, *(-beta for beta in self.translations)]
        least = margins[0]
        for each in margins[1:]:
            least = ca.fmin(least, each)
        return least

    def present(self, order: Order, i: int, section: int) -> Any:
        """One if a tube exists in a section."""
        return 1.0 - order.passed(self.tube_end(i), section)

    def precurvature(self, order: Order, i: int, section: int) -> tuple[Any, list[Any]]:
        """``u*_i`` in a section: from where it is counted, and the coefficients of powers; zero past the tube's end."""
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
        """Energy of holding curved parts straight behind the entry point, J."""
        energy = ca.SX(0)
        for low, high, rows in self._pieces_behind(order, i):
            for d, row in enumerate(rows):
                for e, other in enumerate(rows):
                    power = d + e + 1
                    energy += ca.dot(row[:2], other[:2]) * (high**power - low**power) / power
        return 0.5 * self.bending_stiffness[i] * energy

    def _pieces_behind(self, order: Order, i: int) -> Iterator[tuple[Any, Any, list[Any]]]:
        """The parts of a tube's pieces behind the entry point: where they begin and end in the piece, coefficients."""
        for j, (key, rows) in enumerate(self.shapes[i]):
            rank = order.ranks[key]
            if not (isinstance(rank, int) and rank >= 0):
                start = self.points[key]
                yield order.behind[key] - start, order.behind["tube", i, j + 1] - start, rows

    # -- loads -----------------------------------------------------------------------------------------------------

    def _add(self, key: Key, value: Any, nominal: float, end: Any = None) -> Key:
        """A break point, which is kept in front of the ``end`` of what carries it."""
        if self._clip and end is not None:
            value = ca.if_else(value < end, value, end)
        self.points[key] = value
        self.nominal[key] = float(nominal)
        return key

    def _point(self, k: int, field: str, nominal: float | None, tube: int) -> Key:
        """The break point where a load acts, begins or ends."""
        name = f"loads[{k}].{field}"
        if nominal is None:
            return self.tube_end(tube)
        if nominal == 0.0 and name not in self._values:
            return ENTRY
        end, value = self.points[self.tube_end(tube)], self._at(name)
        self._within.append(end - value)
        return self._add(("load", k, field), value, min(nominal, float(self.configuration.tube_ends[tube])), end)

    def _place(self, k: int, load: Load) -> None:
        name = f"loads[{k}]"
        if isinstance(load, Gravity):
            self._place_weights(k)
            return
        spread = isinstance(load, (DistributedLoad, DistributedMass)) or getattr(load, "distributed", False)
        start = self._point(k, "start", load.start or 0.0, load.tube) if spread else None
        end = self._point(k, "end" if spread else "arc_length", load.end if spread else load.arc_length, load.tube)
        begin, stop = (end, None) if start is None else (start, end)
        if isinstance(load, (PotentialLoad, ExpressionLoad)):
            if load.factor != 0.0:
                self.fields.append(FieldPush(begin, stop, Field.of(load), self._at(f"{name}.factor")))
            return
        if isinstance(load, (PointMass, DistributedMass)):
            field = "mass" if isinstance(load, PointMass) else "mass_per_length"
            force, none = self._at(f"{name}.{field}") * self.gravity, ca.DM.zeros(3)
            constant = (force, none) if stop is None else (Density(rows=[force]), Density(rows=[none]))
            self.pushes.append(Push(begin, stop, load.tube, False, *constant))
            return
        body = load.frame == "body"
        if isinstance(load, PointWrench):
            both = self._vector(f"{name}.force"), self._vector(f"{name}.moment")
        else:
            both = self._density(k, load, "force", end), self._density(k, load, "moment", end)
        self.pushes.append(Push(begin, stop, load.tube, body, *both))

    def _place_weights(self, k: int) -> None:
        acceleration = self._vector(f"loads[{k}].acceleration")
        for i, tube in enumerate(self.configuration.robot.tubes):
            name = f"tubes[{i}]."
            if tube.density > 0.0 or name + "density" in self._values:
                area = formulas.cross_section(self._at(name + "outer_diameter"), self._at(name + "inner_diameter"))
                weight = Density(rows=[self._at(name + "density") * area * acceleration])
                self.pushes.append(Push(ENTRY, self.tube_end(i), i, False, weight, Density(rows=[ca.DM.zeros(3)])))

    def _density(self, k: int, load: DistributedLoad, field: str, end: Key) -> Density:
        value, name = getattr(load, field), f"loads[{k}].{field}"
        if callable(value) and not isinstance(value, LoadTable):
            return Density(function=value)
        rows = self._rows(name)
        if not isinstance(value, LoadTable):
            return Density(rows=rows)
        steps = np.diff(value.arc_length)
        slopes = [(b - a) / float(h) for a, b, h in zip(rows, rows[1:], steps, strict=False)]
        knots: list[Key] = []
        for m, s in enumerate(value.arc_length.tolist()):
            if not self._clip and not load.start <= s <= self.nominal[end]:
                knots.append(PASSED if s < load.start else AHEAD)
            else:
                knots.append(self._add(("knot", k, field, m), s, s, self.points[self.tube_end(load.tube)]))
        return Density(knots, value.arc_length.tolist(), rows, slopes)

    def _fix_others(self) -> None:
        """Break points of the configuration by which loads given as functions are resolved stay where they are."""
        known = np.array(list(self.nominal.values()))
        for k, s in enumerate(self.configuration.break_points):
            if np.abs(known - s).min() > _SAME_POINT * self.configuration.length:
                self._add(("fixed", k), float(s), float(s), self.length)


def _polynomials(piece: Any, name: str, stretch: Any, of: Parametric) -> list[tuple[Any, list[Any]]]:
    """Lengths of the polynomials that a piece consists of, and their coefficients."""
    length = stretch * piece.length
    if isinstance(piece, SampledCurvature):
        widths = [stretch * float(width) for width in np.diff(piece.arc_length)]
        samples = ca.horzcat(*of._rows(f"{name}.curvature")).T
        return [
            (width, [(ca.DM(row).T @ samples).T / stretch**d for d, row in enumerate(basis)])
            for width, basis in zip(widths, piece.basis().transpose(1, 0, 2), strict=True)
        ]
    if isinstance(piece, PolynomialCurvature):
        return [(length, along_arc_length(of._rows(f"{name}.coefficients"), length))]
    return [(length, of._rows(f"{name}.curvature") if hasattr(piece, "curvature") else [ca.DM.zeros(3)])]
