"""The minimum-energy formulation (paper, Appendix, extended by loads and transmissions) as a nonlinear program.

Variables: the transmissions' ``v_i`` (twist ``sqrt(compliance_i) v_i``, energy ``v_i^2 / 2``), the curvatures
``w = (u_xy, u_i,z)`` at points of every step, and the states ``y = (p, q, psi)`` at the nodes (and, by collocation, at
those points), which the kinematics tie to them. Minimized is ``Pi`` = elastic energy + potential of the loads. The
multipliers of the nodes' equations are the internal forces and moments.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..mechanics import boundary, rod
from ..mechanics.kind import Kind, shared_by_kind
from ..mechanics.law import Stiffness
from ..mechanics.so3 import quaternion_rate
from ..mechanics.state import State, state_names
from .nlp import Nlp
from .problem import Guess, TranscribedProblem, TranscribedProgram
from .schemes import Tableau, Transcription, interpolation, tableau
from .shooting import NodeStates


class EnergyProgram(TranscribedProgram):
    """The nonlinear program of energy minimization."""

    points: Tableau

    def __init__(self, tubes: int, transcription: Transcription, integrator: str, kind: Kind, steps: int) -> None:
        super().__init__(tubes, transcription, integrator, kind, steps)
        self.points = self.collocation or tableau(transcription.degree or (self.integrator.order + 1) // 2)
        self.degree = len(self.points.nodes)
        self.states = 7 + tubes
        self.controls = 2 + tubes
        self.nlp = self._build()
        self.with_costates = self._with_costates()

    def _build(self) -> Nlp:
        states = state_names(self.tubes)[: self.states]
        controls = ["u_x", "u_y", *(f"u_{i},z" for i in range(self.tubes))]
        at_points = [f"point {j}, {name}" for j in range(self.degree) for name in states]
        builder, columns, entry = self.begun()
        twist = builder.variable("transmission", [f"v_{i}" for i in range(self.tubes)])
        y = builder.variable("state", states, self.steps + 1)
        inner = [builder.variable("inner state", at_points, self.steps)] if self.collocation else []
        rows = [f"point {j}, {name}" for j in range(self.degree) for name in controls]
        w = builder.variable("curvature", rows, self.steps)
        begin = self.entry.entry(entry)
        angles = begin.free_angles + ca.sqrt(begin.compliance) * twist
        builder.equation("entry", states, ca.vertcat(begin.position, begin.orientation, angles) - y[:, 0])
        *defects, ends, energies = self._step().map(self.steps)(y[:, :-1], *inner, w, y[:, 1:], columns)
        if defects:
            builder.equation("collocation", at_points, defects[0])
        builder.equation("node", states, ends)
        here = self.entry.point_energy(entry, y[:3, 0])  # of the state, so that its multiplier is n(0-)
        return builder.build(ca.sum2(energies) + 0.5 * ca.sumsqr(twist) + here)

    def _step(self) -> ca.Function:
        """The function of one step: defects of inner states, if any, and of the end, and its part of ``Pi``."""
        y, end = ca.SX.sym("y", self.states), ca.SX.sym("end", self.states)
        w, column = ca.SX.sym("w", self.controls, self.degree), ca.SX.sym("column", self.columns.size)
        inner = [ca.SX.sym("inner", self.states, self.degree)] if self.collocation else []
        step: Callable[..., tuple[Any, ...]] = self._collocated if self.collocation else self._integrated
        *defects, arrival, energy = step(y, *inner, w, column)
        energy += self.columns.point_energy(column, end[:3]) + 0.5 * ca.if_else(column[0] == 0, ca.sumsqr(w), 0)
        inputs = [y, *map(ca.vec, (*inner, w)), end, column]
        return ca.Function("energy_step", inputs, [*map(ca.vec, defects), arrival - end, energy])

    def _collocated(self, y: Any, inner: Any, w: Any, column: Any) -> tuple[Any, ...]:
        rates = (self._rates(inner[:, j], w[:, j], column, j) for j in range(self.degree))
        begin, between = ca.vertcat(y, 0), ca.vertcat(inner, ca.SX(1, self.degree))
        defects, arrival = self.points.collocated(begin, between, column[0] * ca.horzcat(*rates))
        return defects[:-1, :], arrival[:-1], arrival[-1]

    def _integrated(self, y: Any, w: Any, column: Any) -> tuple[Any, ...]:
        curvatures = w @ ca.DM(interpolation(self.points.nodes, self.integrator.nodes).T)

        def rates(inner: Any, j: int) -> Any:
            return self._rates(inner[:-1], curvatures[:, j], column, j)

        arrival = self.integrator.step(rates, ca.vertcat(y, 0), column[0])
        return arrival[:-1], arrival[-1]

    def _rates(self, y: Any, w: Any, column: Any, node: int) -> Any:
        """The rates ``y'`` followed by ``Pi'`` at a node of the data."""
        local = self.columns.local(column, node)
        position, orientation = rod.kinematic_rates(y[3:7], w[:2])
        energy = rod.elastic_density(y[7:], w[:2], w[2:], local) + self.columns.load_energy(column, node, y[:3])
        return ca.vertcat(position, orientation, w[2:], energy)

    def _with_costates(self) -> ca.Function:
        """The states left and right of a node, from ``y``, its costate and the column of the step before."""
        y, costate = ca.SX.sym("y", self.states), ca.SX.sym("costate", self.states)
        column = ca.SX.sym("column", self.columns.size)
        q, u = y[3:7], ca.SX.sym("u", 3)
        body = ca.mtimes(ca.jacobian(quaternion_rate(q, u), u).T, costate[3:7])
        left = State(y[:3], q, y[7:], -body[:2], -costate[7:], -costate[:3])
        right = boundary.jump(left, *self.columns.point_load(column, left))
        return ca.Function("with_costates", [y, costate, column], [left.joined(), right.joined()])

    @property
    def free(self) -> NDArray[np.intp]:
        """The variables that determine all others."""
        variables = self.nlp.variables
        return np.concatenate([variables[name].indices.ravel(order="F") for name in ("transmission", "curvature")])


class EnergyProblem(TranscribedProblem):
    """The energy of a configuration on a mesh, ready for numbers; dimensionless."""

    program: EnergyProgram
    programs = shared_by_kind(EnergyProgram, most=32)

    def _blocks(self, start: Guess) -> dict[str, Array]:
        states = self.program.states
        torque = start.nodes[State.parts(self.configuration.tube_count)["torsion"], 0]
        compliance = self.entry[self.program.entry.parts["compliance"]]
        return {
            "transmission": np.sqrt(compliance) * torque,
            "state": start.nodes[:states],
            "inner state": start.inner[:states],
            "curvature": start.curvatures,
        }

    def metric(self) -> Array:
        """Weights of the free variables in the elastic energy, at fixed preset curvature."""
        parts, weights = self.program.columns.parts, self.program.points.weights
        stiffness = np.vstack(Stiffness.of(lambda name: self._columns[parts[name]]).resistance())
        lengths = self._columns[0]
        metric = np.einsum("k,j,ik->kji", lengths, weights, stiffness)
        metric[lengths == 0.0] = 1.0
        return np.concatenate((np.ones(self.configuration.tube_count), metric.ravel()))

    def recover(self, x: Array, multipliers: Array) -> tuple[NodeStates, Array]:
        """Full states at the nodes of the mesh and the unknowns ``z``, from a solution.

        The multipliers of the states' equations are ``-n`` for the position, ``-tau_i`` for the angles and, for the
        orientation, minus the moment in quaternion coordinates.
        """
        nlp, count = self.program.nlp, len(self.mesh)
        y = nlp.variables["state"].take(x)[:, : count + 1]
        costates = [nlp.constraints[name].take(multipliers) for name in ("entry", "node")]
        costate = np.hstack(costates)[:, : count + 1]
        entry_jump = np.zeros((self.program.columns.size, 1))
        for name, part in self.program.columns.parts.items():
            if name.startswith("point_"):
                entry_jump[part, 0] = self.entry[self.program.entry.parts[name]]
        columns = np.hstack((entry_jump, self._columns[:, :count]))
        left, right = (states.full() for states in self.program.with_costates(y, costate, columns))
        parts = State.parts(self.configuration.tube_count)
        z = [left[parts["bending"], 0], left[parts["torsion"], 0]]
        if self.configuration.kind.live:
            z.append(left[parts["force"], 0] - self.entry[self.program.entry.parts["force"]])
        return NodeStates(right[:, :count], left[:, 1:], right[:, count]), np.concatenate(z)
