"""The equilibrium formulation, the Cosserat boundary-value problem, as a square system with all states as unknowns.

Variables: the unknowns ``z`` at the entry point, the states ``x`` at the nodes (behind their point loads) and, by
collocation, at the points inside the steps. Equations: the entry, every step, and the conditions at the tip.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..checks import Array
from ..layout.columns import StepColumns
from ..layout.configuration import Configuration
from ..mechanics import boundary, rod
from ..mechanics.kind import Kind
from ..mechanics.state import State, state_names
from .guess import Guess
from .nlp import Nlp, NlpBuilder, padded
from .problem import TranscribedProblem
from .schemes import Collocation, Tableau, Transcription, tableau
from .sharing import shared_by_kind
from .shooting import Nodes, shooting_functions


class EquilibriumProgram:
    """The system for a number of tubes and steps and a kind of loads; its numbers come from columns of data."""

    def __init__(self, tubes: int, transcription: Transcription, integrator: str, kind: Kind, steps: int) -> None:
        self.tubes, self.steps = tubes, steps
        self.shooting = shooting_functions(tubes, integrator, kind)
        self.points: Tableau | None = None
        if isinstance(transcription, Collocation):
            self.points = tableau(transcription.degree, transcription.scheme)
        data = self.shooting.integrator if self.points is None else self.points
        self.data_nodes, self.data_weights = data.nodes, data.weights
        self.columns = StepColumns(tubes, len(self.data_nodes), kind)
        self.entry = self.shooting.entry
        self.step = self.shooting.step if self.points is None else self._collocation_step(self.points)
        self.nlp = self._build()

    def _build(self) -> Nlp:
        names = state_names(self.tubes)
        builder = NlpBuilder()
        columns = builder.parameter("columns", self.columns.size, self.steps)
        entry = builder.parameter("entry", self.entry.size)
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
        """``(x, inner, column) -> (defects of the inner states, state behind the step, before its point load)``."""
        size, degree = State.size(self.tubes), len(points.nodes)
        x, inner = ca.SX.sym("x", size), ca.SX.sym("inner", size, degree)
        column = ca.SX.sym("column", self.columns.size)

        def rates(j: int) -> Any:
            state = State.split(inner[:, j], self.tubes)
            return rod.rates(state, self.columns.local(column, j, state)).joined()

        slopes = column[0] * ca.horzcat(*(rates(j) for j in range(degree)))
        defects = ca.repmat(x, 1, degree) + slopes @ ca.DM(points.matrix.T) - inner
        before = x + slopes @ ca.DM(points.weights)
        state = State.split(before, self.tubes)
        after = boundary.jump(state, *self.columns.point_load(column, state)).joined()
        return ca.Function("collocation_step", [x, ca.vec(inner), column], [ca.vec(defects), after, before])


equilibrium_program = shared_by_kind(EquilibriumProgram, most=32)
"""The system for ``(tubes, transcription, integrator, kind, steps)``, shared by all problems of its size."""


class EquilibriumProblem(TranscribedProblem):
    """The boundary-value problem of a configuration on a mesh, ready for numbers; dimensionless."""

    program: EquilibriumProgram

    def __init__(
        self, configuration: Configuration, mesh: Array, transcription: Transcription, integrator: str = "RK8"
    ) -> None:
        tubes, steps = configuration.tube_count, padded(len(mesh))
        program = equilibrium_program(tubes, transcription, integrator, configuration.kind, steps)
        super().__init__(configuration, mesh, program)

    def _blocks(self, start: Guess) -> dict[str, Array]:
        z = start.nodes[self.program.shooting.tip_rows, 0]
        if self.configuration.kind.live:
            z[-3:] -= self._entry[self.program.entry.parts["force"]]
        return {"entry unknowns": z, "state": start.nodes, "inner state": start.inner}

    def recover(self, x: Array) -> tuple[Nodes, Array]:
        """The states at the mesh's nodes out of a solution, and the unknowns ``z`` at the entry point."""
        variables, count = self.program.nlp.variables, len(self.mesh)
        states = variables["state"].take(x)
        given = [states[:, :-1], self._columns]
        if self.program.points is not None:
            given.insert(1, variables["inner state"].take(x))
        before = self.program.step.map(self.program.steps)(*given)[-1].full()
        return Nodes(states[:, :count], before[:, :count], states[:, count]), variables["entry unknowns"].take(x)[:, 0]
