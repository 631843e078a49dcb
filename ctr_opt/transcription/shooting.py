"""Single shooting: the boundary residual as a function of the unknown moments at the entry point.

Unknown ``z = (m_xy(0), tau_i(0))``, residual ``(m_xy, tau_i)`` behind the tip; where loads depend on the shape also
``n(0)``, less the dead loads, and ``n`` behind the tip. The step is written once, in SX, for a number of tubes, an
integrator and a kind of loads; sweeps over the robot are a ``mapaccum`` of it over columns of data, built once for
each of a few step counts.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property
from typing import Any, Self

import attrs
import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..layout.columns import EntryColumn, StepColumns
from ..layout.configuration import Configuration
from ..mechanics import boundary, rod
from ..mechanics.kind import Kind, built_once, shared_by_kind
from ..mechanics.so3 import rotation_matrix
from ..mechanics.state import State
from .integrators import runge_kutta
from .nlp import padded


class ShootingFunctions:
    """The CasADi functions for a number of tubes, an integrator and a kind of loads, built when first needed."""

    def __init__(self, tubes: int, integrator: str, kind: Kind) -> None:
        self.tubes = tubes
        self.integrator = runge_kutta(integrator)
        self.columns = StepColumns(tubes, len(self.integrator.nodes), kind)
        self.entry = EntryColumn(tubes, kind)
        self.tip_rows = boundary.tip_rows(tubes, kind.live)
        self.unknowns = len(self.tip_rows)  # number of unknowns at the entry: m_xy, tau_i and, if loads are live, n
        z = ca.SX.sym("z", self.unknowns)
        entry = ca.SX.sym("entry", self.entry.size)
        start = self._start(z, entry)
        self.start = ca.Function("start", [z, entry], [start, ca.jacobian(start, z)], ["z", "entry"], ["x", "dx_dz"])
        x, column = ca.SX.sym("x", State.size(tubes)), ca.SX.sym("column", self.columns.size)
        state = State.split(x, tubes)
        single = StepColumns(tubes, 1, kind)
        local_column = ca.SX.sym("column", single.size)
        local = single.local(local_column, 0, state)
        bent, twisted = rod.curvature(state, local)
        moments = ca.vertcat(*rod.tube_moments(state.angles, bent, twisted, local))
        energy = rod.elastic_density(state.angles, bent, twisted, local)
        self.local = ca.Function("local", [x, local_column], [bent, twisted, moments, energy])
        self.rates = ca.Function("rates", [x, local_column], [rod.rates(state, local).joined()])
        behind = boundary.jump(state, *self.columns.point_load(column, state)).joined()
        self.jumped = ca.Function("jumped", [x, column], [behind])
        before = self.integrated(self.rates, x, column)
        results = [self.jumped(before, column), before]
        self.step = ca.Function("step", [x, column], results, ["x", "column"], ["after", "before"])

    def integrated(self, rates: ca.Function, x: Any, column: Any) -> Any:
        """Integrate ``x`` over a step with the function ``rates`` of ``(x, column of one node)``."""
        return self.integrator.step(lambda inner, j: rates(inner, self.columns.node(column, j)), x, column[0])

    @built_once
    def linear_step(self, directions: int) -> ca.Function:
        """The function ``(x and directions, column) -> (state behind the step, directions there)``."""
        size = State.size(self.tubes)
        both, column = ca.SX.sym("both", size, 1 + directions), ca.SX.sym("column", self.columns.size)

        def with_directions(function: ca.Function) -> ca.Function:
            x, data = ca.SX.sym("x", size), ca.SX.sym("data", function.size1_in(1))
            seeds = ca.SX.sym("seeds", size, directions)
            value = function(x, data)
            both = ca.horzcat(value, ca.jtimes(value, x, seeds))
            return ca.Function("linear", [ca.horzcat(x, seeds), data], [both], {"cse": True})

        rates, jumped = with_directions(self.rates), with_directions(self.jumped)
        results = [jumped(self.integrated(rates, both, column), column)]
        return ca.Function("linear_step", [both, column], results)

    def _entered(self, z: Any, entry: Any) -> State[Any]:
        tubes = self.tubes
        force = z[2 + tubes :] if self.unknowns > 2 + tubes else ca.SX.zeros(3)
        return boundary.entry_state(z[:2], z[2 : 2 + tubes], force, self.entry.entry(entry))

    def _start(self, z: Any, entry: Any) -> Any:
        state = self._entered(z, entry)
        return boundary.jump(state, *self.entry.point_load(entry, state)).joined()

    @cached_property
    def support(self) -> ca.Function:
        """The function ``(z, entry) -> (n, m)``: load on the entry point, with loads at ``s = 0``; world frame."""
        z, entry = ca.SX.sym("z", self.unknowns), ca.SX.sym("entry", self.entry.size)
        state = self._entered(z, entry)
        moment = ca.vertcat(state.bending, ca.sum1(state.torsion))
        return ca.Function("support", [z, entry], [state.force, rotation_matrix(state.orientation) @ moment])

    def _swept(self, count: int) -> tuple[Any, Any, Any]:
        """Symbols of the unknowns, the entry and the columns of ``count`` steps."""
        z, entry = ca.MX.sym("z", self.unknowns), ca.MX.sym("entry", self.entry.size)
        return z, entry, ca.MX.sym("columns", self.columns.size, count)

    @built_once
    def sweep(self, count: int) -> ca.Function:
        """The function ``(z, entry, columns) -> (start, states behind each step, states before its point load)``."""
        z, entry, columns = self._swept(count)
        start, _ = self.start(z, entry)
        after, before = self.step.mapaccum("sweep", count)(start, columns)
        return ca.Function("sweep", [z, entry, columns], [start, after, before])

    @built_once
    def linearized(self, count: int) -> ca.Function:
        """The function ``(z, entry, columns) -> (residual, its Jacobian)``."""
        z, entry, columns = self._swept(count)
        start, slope = self.start(z, entry)
        sweep = self.linear_step(self.unknowns).mapaccum("linear_sweep", count)
        everything = sweep(ca.horzcat(start, slope), columns)
        last = everything[:, -(1 + self.unknowns) :]
        rows = last[self.tip_rows, :]
        return ca.Function("linearized", [z, entry, columns], [rows[:, 0], rows[:, 1:]])

    @built_once
    def _map(self, name: str, count: int) -> ca.Function:
        function: ca.Function = getattr(self, name)
        return function.map(count)

    def many(self, name: str, states: Array, columns: Array) -> tuple[Array, ...]:
        """Evaluate the function ``name`` of ``(state, column)`` at many points at once, ``(size, k)`` each."""
        points = states.shape[1]
        count = padded(points)
        results = self._map(name, count)(extended(states, count), extended(columns, count))
        return tuple(result.full()[:, :points] for result in (results if isinstance(results, tuple) else (results,)))

    @built_once
    def _carry(self, width: int, count: int) -> ca.Function:
        size = State.size(self.tubes)
        directions, x, gap = ca.SX.sym("directions", size, width), ca.SX.sym("x", size), ca.SX.sym("gap", size)
        column = ca.SX.sym("column", self.columns.size)
        carried = self.linear_step(width)(ca.horzcat(x, directions), column)[:, 1:]
        carried[:, -1] += gap
        return ca.Function("carry", [directions, x, column, gap], [carried]).mapaccum("carry", count)

    def carry(self, first: Array, states: Array, columns: Array, gaps: Array) -> list[Array]:
        """Carry ``first (size, 6 + tubes)`` along by the linearized steps from ``states (size, k)``.

        The last column collects the ``gaps (size, k)`` on the way. One matrix for each node, ``k + 1`` in all.
        """
        steps, width = states.shape[1], first.shape[1]
        count = padded(steps)
        longer = [extended(values, count) for values in (states, columns, gaps)]
        carried = self._carry(width, count)(first, *longer).full()[:, : steps * width]
        return [first, *np.split(carried, steps, axis=1)]


shooting_functions = shared_by_kind(ShootingFunctions, most=64)
"""The functions for ``(tubes, integrator, kind)``, shared by all problems."""


def extended(values: Array, count: int) -> Array:
    """Repeat the last column of ``values (size, k)`` up to ``count`` columns: many times as fast as ``numpy.pad``."""
    return values[:, np.minimum(np.arange(count), values.shape[1] - 1)]


def cut(mesh: Array, parts: NDArray[np.intp]) -> Array:
    """Cut every step of a mesh into its number of ``parts (steps,)``."""
    first = np.repeat(np.cumsum(parts) - parts, parts)
    fraction = (np.arange(parts.sum()) - first) / np.repeat(parts, parts)
    starts = np.repeat(mesh[:, 0], parts) + fraction * np.repeat(mesh[:, 1] - mesh[:, 0], parts)
    return np.column_stack((starts, np.append(starts[1:], mesh[-1, 1])))


@attrs.frozen(eq=False)
class NodeStates:
    """Dimensionless states: ``right (size, k)`` where steps begin, ``left`` where they end, and behind the ``tip``."""

    right: Array
    left: Array
    tip: Array


class OnMesh:
    """A configuration on a mesh as numbers for symbolic functions: columns of its steps and of the entry point.

    ``data`` has the nodes of a step and their weights; steps of length zero are appended up to ``steps``.
    """

    def __init__(self, configuration: Configuration, mesh: Array, functions: Any, data: Any, steps: int) -> None:
        self.configuration = configuration
        self.mesh = mesh
        self._layouts: tuple[StepColumns, EntryColumn] = functions.columns, functions.entry
        columns = functions.columns.pack(configuration, mesh, data.nodes)
        self._columns: Array = functions.columns.pad(columns, steps)
        total = functions.columns.total_force(columns, data.weights)  # its own quadrature: n ends at zero
        self.entry: Array = functions.entry.pack(configuration, total)

    def scaled(self, conservative: float = 1.0, rest: float = 1.0, precurvature: float = 1.0) -> Self:
        """A copy with scaled loads with a potential, other loads, and preset curvatures."""
        scaled, (steps, entry) = copy(self), self._layouts
        scaled._columns = self._columns * steps.factors(conservative, rest, precurvature)[:, None]
        scaled.entry = self.entry * entry.factors(conservative, rest, precurvature)
        return scaled


class Shooting(OnMesh):
    """The boundary-value problem of a configuration on a mesh, ready for numbers; everything is dimensionless.

    ``kind`` may cover more loads than the configuration has.
    """

    def __init__(
        self, configuration: Configuration, mesh: Array, integrator: str = "RK8", kind: Kind | None = None
    ) -> None:
        self.integrator = integrator
        self.kind = configuration.kind if kind is None else kind
        self.functions = shooting_functions(configuration.tube_count, integrator, self.kind)
        super().__init__(configuration, mesh, self.functions, self.functions.integrator, padded(len(mesh)))
        self.unknowns = self.functions.unknowns

    @property
    def columns(self) -> Array:
        """The data of the steps."""
        return self._columns[:, : len(self.mesh)]

    def refined(self, parts: NDArray[np.intp] | None = None) -> Shooting:
        """The problem on a finer mesh, with every step cut in two or into ``parts (steps,)``."""
        parts = np.full(len(self.mesh), 2) if parts is None else parts
        return Shooting(self.configuration, cut(self.mesh, parts), self.integrator, self.kind)

    def advance(self, states: Array, first: int) -> Array:
        """Integrate every other step, beginning with step ``first`` (0 or 1), from the states at their starts."""
        _, before = self.functions.many("step", states, self._columns[:, first : len(self.mesh) : 2])
        return before

    def linearize(self, z: Array) -> tuple[Array, Array]:
        """The residual ``(unknowns,)`` and its exact Jacobian."""
        function = self.functions.linearized(self._columns.shape[1])
        residual, jacobian = function(z, self.entry, self._columns)
        return residual.full()[:, 0], jacobian.full()

    def start(self, z: Array) -> Array:
        """The state right of ``s = 0``."""
        return np.asarray(self.functions.start(z, self.entry)[0].full()[:, 0])

    def sweep(self, z: Array) -> tuple[NodeStates, Array]:
        """The states at the mesh's nodes, and the boundary residual."""
        start, after, before = self.functions.sweep(self._columns.shape[1])(z, self.entry, self._columns)
        right = np.hstack((start.full(), after.full()))
        count = len(self.mesh)
        nodes = NodeStates(right[:, :count], before.full()[:, :count], right[:, count])
        return nodes, nodes.tip[self.functions.tip_rows]
