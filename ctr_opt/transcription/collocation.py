"""Gauss-Legendre collocation of the minimum-energy formulation (paper, Appendix, extended by loads and transmissions).

Variables: the transmissions' ``v_i`` (twist ``sqrt(compliance_i) v_i``, energy ``v_i^2 / 2``), the curvatures
``w = (u_xy, u_i,z)`` at the collocation points of every step, and the states ``y = (p, q, psi)`` there and at the
nodes, which the kinematics tie to them. Minimized is ``Pi`` = elastic energy + potential of the dead forces. The
multipliers of the nodes' equations are the internal forces and moments.
"""

from __future__ import annotations

from functools import cache

import attrs
import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..errors import DefinitionError
from ..mechanics import rod
from ..mechanics.rod import Local
from ..mechanics.sections import Configuration
from ..mechanics.so3 import quaternion_rate
from ..mechanics.state import State
from ..robot.checks import Array
from .columns import EntryColumn, StepColumns
from .nlp import Nlp, NlpBuilder
from .shape import Shape, Values
from .shooting import Nodes, padded


@attrs.frozen
class Collocation:
    """Collocation at the Gauss-Legendre points; of order ``2 degree`` at the nodes."""

    degree: int = attrs.field(default=4)

    @degree.validator
    def _check(self, _: attrs.Attribute[int], value: int) -> None:
        if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= 9:
            raise DefinitionError(f"Collocation.degree = {value!r} must be a whole number from 1 to 9")


@cache
def gauss_legendre(degree: int) -> tuple[Array, Array, Array]:
    """Nodes in ``[0, 1]``, weights, and the matrix that integrates the collocation polynomial from 0 to each node."""
    points, weights = np.polynomial.legendre.leggauss(degree)
    nodes = 0.5 * (points + 1.0)
    powers = np.arange(degree)
    vandermonde = nodes[:, None] ** powers
    integrals = nodes[:, None] ** (powers + 1) / (powers + 1)
    return nodes, 0.5 * weights, np.asarray(np.linalg.solve(vandermonde.T, integrals.T).T, dtype=np.float64)


class EnergyTranscription:
    """The program for a number of tubes and steps; its numbers come from columns of data."""

    def __init__(self, tubes: int, degree: int, steps: int) -> None:
        self.tubes, self.degree, self.steps = tubes, degree, steps
        self.nodes, self.weights, self.matrix = gauss_legendre(degree)
        self.columns = StepColumns(tubes, degree)
        self.entry = EntryColumn(tubes)
        self.states = 7 + tubes
        self.controls = 2 + tubes
        self.nlp = self._build()

    def _names(self) -> tuple[list[str], list[str]]:
        angles = [f"psi_{i}" for i in range(self.tubes)]
        states = ["p_x", "p_y", "p_z", "q_w", "q_x", "q_y", "q_z", *angles]
        return states, ["u_x", "u_y", *(f"u_{i},z" for i in range(self.tubes))]

    def _build(self) -> Nlp:
        states, controls = self._names()
        at_nodes = [f"node {j}, {name}" for j in range(self.degree) for name in states]
        builder = NlpBuilder()
        columns = builder.parameter("columns", self.columns.size, self.steps)
        entry = builder.parameter("entry", self.entry.size)
        twist = builder.variable("transmission", [f"v_{i}" for i in range(self.tubes)])
        y = builder.variable("state", states, self.steps + 1)
        inner = builder.variable("inner state", at_nodes, self.steps)
        w = builder.variable(
            "curvature", [f"node {j}, {name}" for j in range(self.degree) for name in controls], self.steps
        )
        begin = self.entry.entry(entry)
        angles = begin.free_angles + ca.sqrt(begin.compliance) * twist
        builder.equation("entry", states, ca.vertcat(begin.position, begin.orientation, angles) - y[:, 0])
        defects, ends, energies = self._step().map(self.steps)(y[:, :-1], inner, w, y[:, 1:], columns)
        builder.equation("collocation", at_nodes, defects)
        builder.equation("node", states, ends)
        point_force, _ = self.entry.point_load(entry)
        here = ca.dot(point_force, begin.position)
        return builder.build(ca.sum2(energies) + 0.5 * ca.sumsqr(twist) - here)

    def _step(self) -> ca.Function:
        """One step: defects of the inner states and of the end, and the step's part of ``Pi``."""
        size, degree = self.states, self.degree
        y, end = ca.SX.sym("y", size), ca.SX.sym("end", size)
        inner, w = ca.SX.sym("inner", size * degree), ca.SX.sym("w", self.controls * degree)
        column = ca.SX.sym("column", self.columns.size)
        length = column[0]
        slopes, energy = [], 0.5 * ca.if_else(length == 0, ca.sumsqr(w), 0)
        for j in range(degree):
            own = inner[size * j : size * (j + 1)]
            controls = w[self.controls * j : self.controls * (j + 1)]
            local: Local[ca.SX] = self.columns.local(column, j)
            position, orientation = rod.kinematic_rates(own[3:7], controls[:2])
            slopes.append(ca.vertcat(position, orientation, controls[2:]))
            density = rod.elastic_density(own[7:], controls[:2], controls[2:], local) - ca.dot(local.force, own[:3])
            energy += length * float(self.weights[j]) * density
        rates = ca.horzcat(*slopes)
        start = ca.repmat(y, 1, degree)
        defects = start + length * (rates @ ca.DM(self.matrix.T)) - ca.reshape(inner, size, degree)
        arrival = y + length * (rates @ ca.DM(self.weights))
        point_force, _ = self.columns.point_load(column)
        energy -= ca.dot(point_force, end[:3])
        return ca.Function("energy_step", [y, inner, w, end, column], [ca.vec(defects), arrival - end, energy])

    @property
    def free(self) -> NDArray[np.intp]:
        """The variables that determine all others."""
        variables = self.nlp.variables
        return np.concatenate([variables[name].indices.ravel(order="F") for name in ("transmission", "curvature")])


@cache
def energy_transcription(tubes: int, degree: int, steps: int) -> EnergyTranscription:
    """The program, shared by all problems of its size."""
    return EnergyTranscription(tubes, degree, steps)


class EnergyProblem:
    """The energy of a configuration on a mesh, ready for numbers; dimensionless."""

    def __init__(self, configuration: Configuration, mesh: Array, collocation: Collocation) -> None:
        self.configuration = configuration
        self.mesh = mesh
        self.transcription = energy_transcription(configuration.tube_count, collocation.degree, padded(len(mesh)))
        layout = self.transcription.columns
        self._columns = layout.pad(layout.pack(configuration, mesh, self.transcription.nodes), self.transcription.steps)
        self._entry = self.transcription.entry.pack(configuration, np.zeros(3))

    @property
    def parameters(self) -> Array:
        """The program's parameters."""
        return np.concatenate((self._columns.ravel(order="F"), self._entry))

    def straight(self) -> Array:
        """The straight robot, its tubes free of torque: the guess that needs no thought."""
        transcription, tubes = self.transcription, self.configuration.tube_count
        parts = transcription.entry.parts
        lengths = self._columns[0]
        ends = np.concatenate(([0.0], np.cumsum(lengths)))
        inner = ends[:-1, None] + lengths[:, None] * transcription.nodes
        tangent = self.configuration.robot.base_pose[:3, 2]
        angles = self._entry[parts["rotations"]] + self._entry[parts["twist"]]

        def states(s: Array) -> Array:
            rest = np.concatenate((self._entry[parts["orientation"]], angles))
            positions = self._entry[parts["position"]] + s[..., None] * tangent
            return np.concatenate((positions, np.broadcast_to(rest, (*s.shape, len(rest)))), axis=-1)

        controls = np.zeros(transcription.controls * transcription.degree * transcription.steps)
        return np.concatenate((np.zeros(tubes), states(ends).ravel(), states(inner).ravel(), controls))

    def like(self, shape: Shape) -> Array:
        """A guess with the curvatures and states of another shape, its arc length stretched to this one's."""
        transcription, scales = self.transcription, self.configuration.scales
        other = shape.configuration.scales
        count, idle = len(self.mesh), transcription.steps - len(self.mesh)
        stretch = other.length / scales.length
        start, end = self.mesh[:, :1] * stretch, self.mesh[:, 1:] * stretch
        inner = shape.at((start + (end - start) * transcription.nodes).ravel())
        nodes = shape.at(np.append(start, other.length))

        def rows(values: Values) -> Array:
            state = values.state
            return np.vstack((state.position / scales.length, state.orientation, state.angles)).T

        controls = (np.vstack((inner.bent, inner.twisted)).T * scales.length).reshape(count, -1)
        torque = nodes.state.torsion[:, 0] / scales.moment
        compliance = self._entry[transcription.entry.parts["compliance"]]
        states, inside = rows(nodes), rows(inner).reshape(count, -1)
        still = np.tile(states[-1], (idle, transcription.degree))
        blocks = (
            np.sqrt(compliance) * torque,
            np.vstack((states, np.tile(states[-1], (idle, 1)))),
            np.vstack((inside, still)),
            np.vstack((controls, np.zeros((idle, controls.shape[1])))),
        )
        return np.concatenate([block.ravel() for block in blocks])

    def metric(self) -> Array:
        """The elastic energy's weights of the free variables, at fixed preset curvature."""
        transcription, parts = self.transcription, self.transcription.columns.parts
        bending = self._columns[parts["bending_stiffness"]].sum(axis=0)
        stiffness = np.vstack((bending, bending, self._columns[parts["torsional_stiffness"]]))
        lengths = self._columns[0]
        weights = np.einsum("k,j,ik->kji", lengths, transcription.weights, stiffness)
        weights[lengths == 0.0] = 1.0
        return np.concatenate((np.ones(self.configuration.tube_count), weights.ravel()))

    def recover(self, x: Array, multipliers: Array) -> tuple[Nodes, Array]:
        """Full states at the mesh's nodes out of a solution, and the boundary unknowns ``z``.

        The multipliers of the states' equations are ``-n`` for the position, ``-tau_i`` for the angles and, for the
        orientation, minus the moment in quaternion coordinates.
        """
        blocks, tubes, count = self.transcription.nlp, self.configuration.tube_count, len(self.mesh)
        y = blocks.variables["state"].take(x)[:, : count + 1]
        costate = np.hstack(
            (blocks.constraints["entry"].take(multipliers), blocks.constraints["node"].take(multipliers))
        )
        left = _with_costates(tubes)(y, costate[:, : count + 1]).full()
        parts = State.parts(tubes)
        right = left.copy()
        jumps = np.column_stack(
            (
                self._entry[self.transcription.entry.parts["point_force"]],
                self._columns[self.transcription.columns.parts["point_force"], :count],
            )
        )
        right[parts["force"]] -= jumps
        z = np.concatenate((left[parts["bending"], 0], left[parts["torsion"], 0]))
        return Nodes(right[:, :count], left[:, 1:], right[:, count]), z


@cache
def _with_costates(tubes: int) -> ca.Function:
    """From ``y`` and its costate to the whole state."""
    y, costate = ca.SX.sym("y", 7 + tubes), ca.SX.sym("costate", 7 + tubes)
    q, u = y[3:7], ca.SX.sym("u", 3)
    body = ca.mtimes(ca.jacobian(quaternion_rate(q, u), u).T, costate[3:7])
    state = State(y[:3], q, y[7:], -body[:2], -costate[7:], -costate[:3])
    return ca.Function("with_costates", [y, costate], [state.joined()])
