"""The equilibrium formulation, the Cosserat boundary-value problem, as a square system with all states as unknowns.

Variables: the unknowns ``z`` at the entry point, the states ``x`` at the nodes (behind their point loads) and, by
collocation, at the points inside the steps. Equations: the entry, every step, and the conditions at the tip.
"""

from __future__ import annotations

import casadi as ca

from ..checks import Array
from ..mechanics import boundary
from ..mechanics.kind import Kind, shared_by_kind
from ..mechanics.state import State, state_names
from .nlp import Nlp
from .problem import Guess, TranscribedProblem, TranscribedProgram
from .schemes import Tableau, Transcription
from .shooting import NodeStates, shooting_functions


class EquilibriumProgram(TranscribedProgram):
    """The square system of the Cosserat equations."""

    def __init__(self, tubes: int, transcription: Transcription, integrator: str, kind: Kind, steps: int) -> None:
        super().__init__(tubes, transcription, integrator, kind, steps)
        self.points = self.collocation
        self.shooting = shooting_functions(tubes, integrator, kind)
        self.step = self.shooting.step if self.points is None else self._collocation_step(self.points)
        self.nlp = self._build()

    def _build(self) -> Nlp:
        names = state_names(self.tubes)
        builder, columns, entry = self.begun()
        tip_names = [names[row] for row in self.shooting.tip_rows]
        z = builder.variable("entry unknowns", tip_names)
        x = builder.variable("state", names, self.steps + 1)
        builder.equation("entry", names, self.shooting.start(z, entry)[0] - x[:, 0])
        if self.points is None:
            after, _ = self.step.map(self.steps)(x[:, :-1], columns)
        else:
            at_points = [f"point {j}, {name}" for j in range(len(self.points.nodes)) for name in names]
            inner = builder.variable("inner state", at_points, self.steps)
            defects, after, _ = self.step.map(self.steps)(x[:, :-1], inner, columns)
            builder.equation("collocation", at_points, defects)
        builder.equation("node", names, after - x[:, 1:])
        builder.equation("tip", tip_names, x[self.shooting.tip_rows, -1])
        return builder.build()

    def _collocation_step(self, points: Tableau) -> ca.Function:
        """The function ``(x, inner, column) -> (defects, state behind the step, state before its point load)``."""
        size, degree = State.size(self.tubes), len(points.nodes)
        x, inner = ca.SX.sym("x", size), ca.SX.sym("inner", size, degree)
        column = ca.SX.sym("column", self.columns.size)
        rates = [self.shooting.rates(inner[:, j], self.columns.node(column, j)) for j in range(degree)]
        slopes = column[0] * ca.horzcat(*rates)
        defects, before = points.collocated(x, inner, slopes)
        state = State.split(before, self.tubes)
        after = boundary.jump(state, *self.columns.point_load(column, state)).joined()
        return ca.Function("collocation_step", [x, ca.vec(inner), column], [ca.vec(defects), after, before])


class EquilibriumProblem(TranscribedProblem):
    """The boundary-value problem of a configuration on a mesh, ready for numbers; dimensionless."""

    program: EquilibriumProgram
    programs = shared_by_kind(EquilibriumProgram, most=32)

    def _blocks(self, start: Guess) -> dict[str, Array]:
        z = start.nodes[self.program.shooting.tip_rows, 0]
        if self.configuration.kind.live:
            z[-3:] -= self.entry[self.program.entry.parts["force"]]
        return {"entry unknowns": z, "state": start.nodes, "inner state": start.inner}

    def recover(self, x: Array) -> tuple[NodeStates, Array]:
        """The states at the nodes of the mesh and the unknowns ``z`` at the entry point, from a solution."""
        variables, count = self.program.nlp.variables, len(self.mesh)
        states = variables["state"].take(x)
        inputs = [states[:, :-1], self._columns]
        if self.program.points is not None:
            inputs.insert(1, variables["inner state"].take(x))
        before = self.program.step.map(self.program.steps)(*inputs)[-1].full()
        z = variables["entry unknowns"].take(x)[:, 0]
        return NodeStates(states[:, :count], before[:, :count], states[:, count]), z
