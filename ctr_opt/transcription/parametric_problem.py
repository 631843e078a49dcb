"""The boundary-value problem and its results as CasADi functions of the unknowns and of parameters."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any

import attrs
import casadi as ca
import numpy as np

from ..checks import Array
from ..errors import DefinitionError
from ..layout.configuration import Configuration
from ..layout.ordering import ENTRY, Key, Order, Side, given_order, sorted_order
from ..layout.parametric import Parametric
from ..layout.parametric_columns import ParametricColumns, fractions_of
from ..loads.resolution import called
from ..mechanics.law import straight_hamiltonian
from ..mechanics.state import slices
from ..robot.names import NamedNumber
from .shooting import ShootingFunctions, shooting_functions

PROBE: Key = ("probe", 0)
_STILL = 1e-9  # m per unit of a parameter: break points that move less relative to each other stay together


class ParametricProblem:
    """A configuration with chosen parameters as symbols.

    ``probes`` are arc lengths of requested values, on a tube or (None) on the robot. With ``from_left`` values are
    taken before anything that acts or ends there; with ``retreating`` behind what is drawn back from there.
    """

    def __init__(
        self,
        configuration: Configuration,
        chosen: Sequence[NamedNumber],
        integrator: str,
        probes: Sequence[tuple[float, int | None]] = (),
        *,
        from_left: bool = False,
        retreating: bool = False,
        clip: bool = False,
    ) -> None:
        self.configuration = configuration
        self.chosen = list(chosen)
        self.integrator = integrator
        self.from_left, self.retreating = from_left, retreating
        self.theta = ca.SX.sym("theta", sum(parameter.size for parameter in self.chosen))
        self.parts = slices({parameter.name: parameter.size for parameter in self.chosen})
        values = {name: self.theta[part] for name, part in self.parts.items()}
        self.parametric = Parametric(configuration, values, probes, clip)

    @property
    def nominal(self) -> Array:
        """The present values of the parameters, in succession."""
        return np.concatenate([np.zeros(0), *(parameter.value.ravel() for parameter in self.chosen)])

    @property
    def functions(self) -> ShootingFunctions:
        """The symbolic functions, shared by all problems of this kind."""
        return shooting_functions(self.configuration.tube_count, self.integrator, self.configuration.kind)

    # -- the order of break points ---------------------------------------------------------------------------------

    @cached_property
    def _groups(self) -> list[list[Key]]:
        """Break points in groups that coincide."""
        nominal = self.parametric.nominal
        keys = sorted((key for key in nominal if not self._behind(key)), key=lambda key: nominal[key])
        groups: list[list[Key]] = []
        slack = self.configuration.ends.slack
        for key in keys:
            if groups and nominal[key] - nominal[groups[-1][-1]] <= slack:
                groups[-1].append(key)
            else:
                groups.append([key])
        return groups

    @staticmethod
    def _behind(key: Key) -> bool:
        return bool(key[0] == "tube" and key[2] == 0)

    @cached_property
    def _velocities(self) -> dict[Key, Array]:
        """The derivatives of all break points by the parameters."""
        points = ca.vertcat(*(ca.SX(value) for value in self.parametric.points.values()))
        slopes = ca.Function("slopes", [self.theta], [ca.jacobian(points, self.theta)])(self.nominal).full()
        return dict(zip(self.parametric.points, slopes, strict=True))

    def kinked(self, column: int) -> bool:
        """Whether a parameter moves coinciding break points apart."""
        velocities = self._velocities
        spreads = [np.ptp([velocities[key][column] for key in group]) for group in self._groups]
        return float(max(spreads)) > _STILL

    def keys(self, column: int, sign: float) -> tuple[Key, ...]:
        """The order of the break points when a parameter grows (``sign = 1``) or shrinks a little."""
        listed = {key: k for k, key in enumerate(self.parametric.points)}
        velocities = self._velocities

        def rank(key: Key) -> tuple[float, int]:
            if key == PROBE and self.from_left:
                return 0.0 if self.retreating else -np.inf, -1
            return round(sign * float(velocities[key][column]) / _STILL), listed[key]

        bases = [key for key in listed if self._behind(key)]
        ordered = [key for group in self._groups for key in sorted(group, key=rank)]
        ends = [key for key in ordered if key in self._tube_ends]
        ordered.remove(ends[-1])
        return (*bases, *ordered, ends[-1])  # a load at the end of the longest tube never comes to lie beyond

    @property
    def _tube_ends(self) -> set[Key]:
        return {self.parametric.tube_end(i) for i in range(self.parametric.tubes)}

    def given(self, keys: Sequence[Key]) -> Order:
        """The order of break points with the given keys."""
        return given_order(self.parametric.points, list(keys))

    def sorted(self) -> Order:
        """The order that is sorted inside the function, by the values of the parameters."""
        of, slack = self.parametric, self.configuration.ends.slack
        return sorted_order(of.points, [key for key in of.points if self._behind(key)], of.chained_ends, slack)

    def innermost(self, s: float | None, column: int, sign: float) -> int:
        """The innermost tube at a fixed arc length, or at the tip, when a parameter grows or shrinks a little.

        If all tubes are drawn back from there, it is the tube that is there now.
        """
        ends, tubes = self.configuration.ends, range(self.parametric.tubes)
        paces = [sign * float(self._velocities[self.parametric.tube_end(i)][column]) for i in tubes]
        at = ends.length if s is None else s
        pace = max(paces[i] for i in tubes if ends.points[i] == at) if s is None else 0.0
        there = (i for i in tubes if (ends.points[i] > at or (ends.points[i] == at and paces[i] >= pace - _STILL)))
        return next(there, ends.innermost(s))

    def pushes(self, i: int, order: Order) -> tuple[list[Side], ca.Function]:
        """Sides whose Hamiltonians push on a tube's base, and the function ``(theta, tau_i(0)) -> weights``.

        Behind the weights the function has the Hamiltonian of the tube alone, held straight right behind the entry
        point: the force on the whole part there, as the sum over its break points telescopes.
        """
        torque, shapes, points = ca.SX.sym("torque"), self.parametric.shapes[i], self.parametric.points
        ranks = {("tube", i, j): order.ranks["tube", i, j] for j in range(1, len(shapes) + 1)}
        slack = self.configuration.ends.slack
        ahead = {key: float(rank > 0) if isinstance(rank, int) else points[key] > slack for key, rank in ranks.items()}
        jumps = [sum(ahead[key] * order.at(key, k) for key in ranks) for k in range(order.sections + 1)]
        signed = {side: jumps[side[0]] if side[1] else -jumps[side[0]] for side in order.every_side if side[0]}
        weights = {side: weight for side, weight in signed.items() if not (isinstance(weight, float) and weight == 0.0)}
        preset = self._preset(*shapes[0])
        for key, rows in shapes[1:]:
            preset = ca.if_else(ahead[key], preset, self._preset(key, rows))
        behind = straight_hamiltonian(torque, preset, self.parametric.stiffness.of_tube(i))
        return list(weights), ca.Function("pushes", [self.theta, torque], [ca.vertcat(*weights.values()), behind])

    def _preset(self, key: Key, rows: Sequence[Any]) -> Any:
        """The preset curvature ``u*`` at the entry point, of the piece that begins at a break point."""
        preset = ca.SX.zeros(3)
        for d, row in enumerate(rows):
            preset += row * (0.0 - self.parametric.points[key]) ** d
        return preset


@attrs.frozen(eq=False)
class Swept:
    """A parametric problem swept on a mesh at symbols ``z`` and ``theta``: states at the positions, and the residual.

    ``right (size, positions)`` are the states behind the positions, ``left`` those before them, from the second on;
    ``weights (positions, marks)`` are one at a mark, mostly a probe; ``sides (2 sections, asked)`` are those
    of :meth:`Order.sides <ctr_opt.layout.ordering.Order.sides>`.
    """

    z: Any
    theta: Any
    right: Any
    left: Any
    residual: Any
    columns: Any
    slopes: Any
    begins: Any
    entry: Any
    straightening_energy: Any
    locals: dict[tuple[int, int], Any]
    weights: Any
    sides: Any


class Discretized:
    """A parametric problem on a mesh: every section cut at ``fractions[section]``.

    ``around``: positions and sides (0 left, 1 right) at which the data of the equations are needed. ``marks``: break
    points whose positions are given by weights; default: the probes. ``sides``: pairs of a break point and the end of a
    tube, for values that jump.
    """

    def __init__(
        self,
        problem: ParametricProblem,
        order: Order,
        fractions: Sequence[Array],
        around: Sequence[tuple[int, int]] = (),
        *,
        integrals: bool = False,
        marks: Sequence[Key] | None = None,
        sides: Sequence[tuple[Key, Key]] = (),
    ) -> None:
        self.problem = problem
        self.order = order
        functions = problem.functions
        self.kind = problem.configuration.kind
        data = ParametricColumns(problem.parametric, order, self.kind)
        self.steps = [
            (section, float(low), float(high)) for section, cuts in enumerate(fractions) for low, high in pairwise(cuts)
        ]
        self.ends = np.cumsum([0, *(len(cuts) - 1 for cuts in fractions)])
        nodes = functions.integrator.nodes
        columns = ca.horzcat(*(data.step(*step, nodes) for step in self.steps))
        self.around = list(around)
        total = functions.columns.total_force(columns, functions.integrator.weights)
        slopes = ca.horzcat(*(data.slopes(*step, nodes) for step in self.steps)) if integrals else ca.SX(0, 1)
        local = [self._local(data, *place) for place in self.around]
        probes = [key for key in order.ranks if key[0] == "probe"] if marks is None else marks
        weights = [ca.vertcat(*(order.at(key, k) for k in range(order.sections + 1))) for key in probes]
        energy = data.straightening_energy if integrals else ca.SX(0)
        slack = problem.configuration.ends.slack
        beside = [order.sides(*pair, slack) for pair in sides]
        outputs = [columns, data.entry(total), slopes, energy, ca.horzcat(*local)]
        self.data = self._function(data, [*outputs, ca.horzcat(*weights), ca.horzcat(*beside)])

    @staticmethod
    def _local(data: ParametricColumns, position: int, side: int) -> Any:
        section, fraction = (position, 0.0) if side else (position - 1, 1.0)
        return data.step(section, fraction, fraction, np.zeros(1), jump=False)

    def _function(self, data: ParametricColumns, outputs: list[Any]) -> ca.Function:
        """The data as a function of the parameters; loads given as functions keep their present values."""
        theta, samples = self.problem.theta, data.samples
        if samples:
            places = ca.vertcat(*(sample.places.T for sample in samples))
            moved = ca.Function("places", [theta], [places, ca.densify(ca.jacobian(places, theta))])
            at, slopes = (value.full() for value in moved(self.problem.nominal))
            if np.any(np.abs(slopes) > _STILL):
                raise DefinitionError(
                    "a load is given as a function of s, but break points move within it, so its derivative by s is "
                    "needed and unknown: give the load as a table, (s, values), or as an ExpressionLoad"
                )
            functions = [sample.function for sample in samples for _ in range(sample.places.numel())]
            values = [called(function, float(s), "load") for function, s in zip(functions, at[:, 0], strict=True)]
            symbols = ca.vertcat(*(ca.vec(sample.value) for sample in samples))
            outputs = ca.substitute([ca.SX(out) for out in outputs], [symbols], [ca.SX(ca.DM(np.concatenate(values)))])
        return ca.Function("data", [theta], outputs)

    def sweep(self, z: Any, entry: Any, columns: Any) -> tuple[Any, Any, Any]:
        """The states behind the entry point, and behind and before the end of every step."""
        functions = self.problem.functions
        start, _ = functions.start(z, entry)
        return start, *functions.step.mapaccum("sweep", len(self.steps))(start, columns)

    def swept(self, z: Any, theta: Any) -> Swept:
        """The states and the residual at MX symbols."""
        functions = self.problem.functions
        columns, entry, slopes, energy, around, weights, sides = self.data(theta)
        start, after, before = self.sweep(z, entry, columns)
        begins = ca.horzcat(start, after)
        right, left = begins[:, self.ends.tolist()], before[:, (self.ends[1:] - 1).tolist()]
        residual, begins = begins[functions.tip_rows, len(self.steps)], begins[:, : len(self.steps)]
        local = {place: around[:, k] for k, place in enumerate(self.around)}
        return Swept(z, theta, right, left, residual, columns, slopes, begins, entry, energy, local, weights, sides)


def at_nominal(problem: ParametricProblem, keys: Sequence[Key], mesh: Array) -> list[Array]:
    """The fractions at which a mesh of the present configuration cuts the sections of an order."""
    front = list(keys)[list(keys).index(ENTRY) :]
    nominal = problem.parametric.nominal
    slack = problem.configuration.ends.slack
    return [fractions_of(mesh, nominal[a], nominal[b], slack) for a, b in pairwise(front)]
