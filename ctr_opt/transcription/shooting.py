"""Single shooting: the boundary residual as a function of the unknown moments at the entry point.

Unknown ``z = (m_xy(0), tau_i(0))``, residual ``(m_xy, tau_i)`` behind the tip. The step is written once, in SX, for
a number of tubes and an integrator; sweeps over the robot are a ``mapaccum`` of it over columns of data, built once
for each of a few step counts.
"""

from __future__ import annotations

from copy import copy
from functools import cache
from typing import Any

import attrs
import casadi as ca
import numpy as np

from ..mechanics import boundary, rod
from ..mechanics.sections import Configuration
from ..mechanics.state import State
from ..robot.checks import Array
from .columns import EntryColumn, StepColumns
from .integrators import RungeKutta, runge_kutta


def padded(count: int) -> int:
    """The next of the step counts that sweeps are built for: 4, 6, 8, 12, 16, 24, 32, 48, ..."""
    size = 4
    while size < count:
        size = size * 3 // 2 if size & (size - 1) == 0 else size * 4 // 3
    return size


class ShootingFunctions:
    """The CasADi functions for a number of tubes and an integrator, built when first needed."""

    def __init__(self, tubes: int, integrator: RungeKutta) -> None:
        self.tubes = tubes
        self.integrator = integrator
        self.columns = StepColumns(tubes, len(integrator.nodes))
        self.entry = EntryColumn(tubes)
        self.unknowns = 2 + tubes
        self._sweeps: dict[int, ca.Function] = {}
        self._maps: dict[tuple[str, int], ca.Function] = {}
        self._linearized: dict[int, ca.Function] = {}
        x = ca.SX.sym("x", State.size(tubes))
        column = ca.SX.sym("column", self.columns.size)
        before, after = self._step(x, column)
        self.step = ca.Function("step", [x, column], [after, before], ["x", "column"], ["after", "before"])
        seeds = ca.SX.sym("seeds", State.size(tubes), self.unknowns)
        moved = ca.jtimes(after, x, seeds)
        self._linear_step = ca.Function(
            "linear_step",
            [ca.horzcat(x, seeds), column],
            [ca.horzcat(after, moved)],
            ["x", "column"],
            ["after"],
            {"cse": True},
        )
        z = ca.SX.sym("z", self.unknowns)
        entry = ca.SX.sym("entry", self.entry.size)
        start = self._start(z, entry)
        self.start = ca.Function("start", [z, entry], [start, ca.jacobian(start, z)], ["z", "entry"], ["x", "dx_dz"])
        state = State.split(x, tubes)
        single = StepColumns(tubes, 1)
        local_column = ca.SX.sym("column", single.size)
        local = single.local(local_column, 0)
        bent, twisted = rod.curvature(state, local)
        moments = ca.vertcat(*rod.tube_moments(state.angles, bent, twisted, local))
        energy = rod.elastic_density(state.angles, bent, twisted, local)
        self.local = ca.Function("local", [x, local_column], [bent, twisted, moments, energy])
        self.rates = ca.Function("rates", [x, local_column], [rod.rates(state, local).joined()])
        behind = boundary.jump(state, *single.point_load(local_column)).joined()
        self.point_jump = ca.Function("point_jump", [x, local_column], [behind])

    def _step(self, x: Any, column: Any) -> tuple[Any, Any]:
        def derivative(inner: Any, j: int) -> Any:
            return rod.rates(State.split(inner, self.tubes), self.columns.local(column, j)).joined()

        before = self.integrator.step(derivative, x, column[0])
        force, moment = self.columns.point_load(column)
        after = boundary.jump(State.split(before, self.tubes), force, moment).joined()
        return before, after

    def _start(self, z: Any, entry: Any) -> Any:
        state = boundary.entry_state(z[:2], z[2:], self.entry.entry(entry))
        return boundary.jump(state, *self.entry.point_load(entry)).joined()

    def sweep(self, count: int) -> ca.Function:
        """``(z, entry, columns) -> (states behind each step, before its point load)``."""
        if count not in self._sweeps:
            z, entry = ca.MX.sym("z", self.unknowns), ca.MX.sym("entry", self.entry.size)
            columns = ca.MX.sym("columns", self.columns.size, count)
            start, _ = self.start(z, entry)
            after, before = self.step.mapaccum("sweep", count)(start, columns)
            self._sweeps[count] = ca.Function("sweep", [z, entry, columns], [start, after, before])
        return self._sweeps[count]

    def many(self, function: ca.Function, states: Array, columns: Array) -> tuple[Array, ...]:
        """A function of ``(state, column)`` at many points at once, ``(size, k)`` each."""
        points = states.shape[1]
        key = (function.name(), padded(points))
        if key not in self._maps:
            self._maps[key] = function.map(key[1])
        extra = ((0, 0), (0, key[1] - points))
        results = self._maps[key](np.pad(states, extra, mode="edge"), np.pad(columns, extra, mode="edge"))
        return tuple(result.full()[:, :points] for result in (results if isinstance(results, tuple) else (results,)))

    def linearized(self, count: int) -> ca.Function:
        """``(z, entry, columns) -> (residual, its Jacobian)``."""
        if count not in self._linearized:
            z, entry = ca.MX.sym("z", self.unknowns), ca.MX.sym("entry", self.entry.size)
            columns = ca.MX.sym("columns", self.columns.size, count)
            start, slope = self.start(z, entry)
            everything = self._linear_step.mapaccum("linear_sweep", count)(ca.horzcat(start, slope), columns)
            last = everything[:, -(1 + self.unknowns) :]
            rows = last[boundary.tip_rows(self.tubes), :]
            self._linearized[count] = ca.Function("linearized", [z, entry, columns], [rows[:, 0], rows[:, 1:]])
        return self._linearized[count]


@cache
def shooting_functions(tubes: int, integrator: str = "RK8") -> ShootingFunctions:
    """The functions, shared by every problem with as many tubes."""
    return ShootingFunctions(tubes, runge_kutta(integrator))


@attrs.frozen(eq=False)
class Nodes:
    """Dimensionless states: ``right (size, k)`` where steps begin, ``left`` where they end, and behind the ``tip``."""

    right: Array
    left: Array
    tip: Array


class Shooting:
    """The boundary-value problem of a configuration on a mesh, ready for numbers; everything is dimensionless."""

    def __init__(self, configuration: Configuration, mesh: Array, integrator: str = "RK8") -> None:
        self.configuration = configuration
        self.mesh = mesh
        self.integrator = integrator
        layout = self.functions.columns
        columns = layout.pack(configuration, mesh, self.functions.integrator.nodes)
        self._columns = layout.pad(columns, padded(len(mesh)))
        self._entry = self.functions.entry.pack(configuration, self._total_force(columns))
        self.unknowns = self.functions.unknowns

    @property
    def functions(self) -> ShootingFunctions:
        """The symbolic functions, which are shared and never pickled."""
        return shooting_functions(self.configuration.tube_count, self.integrator)

    def _total_force(self, columns: Array) -> Array:
        """Of all loads behind ``s = 0``, by the integrator's own quadrature, so that ``n`` ends at zero."""
        parts = self.functions.columns.parts
        density = columns[parts["force"]].reshape(-1, 3, columns.shape[1])
        distributed = np.einsum("k,c,cxk->x", columns[0], self.functions.integrator.weights, density)
        return np.asarray(distributed + columns[parts["point_force"]].sum(axis=1))

    def scaled(self, force: float = 1.0, moment: float = 1.0, precurvature: float = 1.0) -> Shooting:
        """The same problem with all forces, moments and preset curvatures multiplied."""
        other = copy(self)
        other._columns = self._columns * self.functions.columns.factors(force, moment, precurvature)[:, None]
        other._entry = self._entry * self.functions.entry.factors(force, moment, precurvature)
        return other

    def refined(self, factor: int = 2) -> Shooting:
        """The same problem with every step cut into ``factor``."""
        start, end = self.mesh[:, :1], self.mesh[:, 1:]
        edges = start + (end - start) * np.linspace(0.0, 1.0, factor + 1)
        edges[:, -1:] = end
        mesh = np.stack((edges[:, :-1], edges[:, 1:]), axis=-1).reshape(-1, 2)
        return Shooting(self.configuration, mesh, self.integrator)

    def linearize(self, z: Array) -> tuple[Array, Array]:
        """Residual ``(unknowns,)`` and its exact Jacobian."""
        function = self.functions.linearized(self._columns.shape[1])
        residual, jacobian = function(z, self._entry, self._columns)
        return residual.full()[:, 0], jacobian.full()

    def start(self, z: Array) -> Array:
        """The state right of ``s = 0``."""
        return np.asarray(self.functions.start(z, self._entry)[0].full()[:, 0])

    def sweep(self, z: Array) -> tuple[Nodes, Array]:
        """The states at the mesh's nodes, and the boundary residual."""
        start, after, before = self.functions.sweep(self._columns.shape[1])(z, self._entry, self._columns)
        right = np.hstack((start.full(), after.full()))
        count = len(self.mesh)
        nodes = Nodes(right[:, :count], before.full()[:, :count], right[:, count])
        return nodes, nodes.tip[boundary.tip_rows(self.configuration.tube_count)]
