"""What derivatives can be taken of, by name: attributes and methods of an equilibrium, as CasADi expressions."""

from __future__ import annotations

from typing import Any

import attrs
import casadi as ca
import numpy as np

from ..checks import Array, index, number
from ..errors import DefinitionError
from ..layout.configuration import Configuration
from ..mechanics.fields import material_frame
from ..mechanics.law import transmission_energy
from ..mechanics.so3 import rotation_matrix
from ..mechanics.state import State
from ..transcription.integrals import integral_functions
from ..transcription.parametric_problem import PROBE, Discretized, ParametricProblem, Swept

ATTRIBUTES = ("tip_position", "tip_pose", "energy", "load_work", "potential_energy")
_ALONG = ("position", "pose", "curvature", "internal_force", "internal_moment")
_OF_TUBES = ("torsion", "tube_angle", "tube_moment")


@attrs.frozen
class Output:
    """What is asked for: a ``name``, and which ``tube`` and arc length ``s`` where it needs them."""

    name: str
    tube: int | None = None
    s: float | None = None

    @property
    def along(self) -> bool:
        """Whether it is a value at an arc length."""
        return self.s is not None

    @property
    def posed(self) -> bool:
        """Whether it is a pose, whose rates are of its position and its rotation."""
        return self.name in ("pose", "tip_pose")

    @property
    def integrals(self) -> bool:
        """Whether it takes integrals along the robot."""
        return self.name in (*ATTRIBUTES[2:], "actuator_wrench")

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the output; poses stand for position and rotation, six numbers."""
        if self.posed:
            return (6,)
        if self.name == "actuator_wrench":
            return (2,)
        return () if self.name in (*ATTRIBUTES[2:], "torsion", "tube_angle") else (3,)


def output(of: Any, configuration: Configuration) -> Output:
    """The output that a name, or a pair of a method's name and its arguments, stands for."""
    parts = (of,) if isinstance(of, str) else of
    if not isinstance(parts, tuple) or not parts or not isinstance(parts[0], str):
        raise _unknown(of)
    name, arguments = parts[0], parts[1:]
    if name in ATTRIBUTES and not arguments:
        found = Output(name)
    elif name in _ALONG and len(arguments) == (2 if name == "pose" and len(arguments) == 2 else 1):
        tube = _tube(arguments[1], configuration) if len(arguments) == 2 and arguments[1] is not None else None
        found = Output(name, tube, place_of(arguments[0], tube, configuration))
    elif name in _OF_TUBES and len(arguments) == 2:
        tube = _tube(arguments[0], configuration)
        found = Output(name, tube, place_of(arguments[1], tube, configuration))
    elif name == "actuator_wrench" and len(arguments) == 1:
        found = Output(name, _tube(arguments[0], configuration))
    else:
        raise _unknown(of)
    return found


def _unknown(of: Any) -> DefinitionError:
    pairs = [f"({name!r}, s)" for name in _ALONG] + [f"({name!r}, tube, s)" for name in _OF_TUBES]
    return DefinitionError(
        f"of = {of!r} is no output; there are {', '.join(map(repr, ATTRIBUTES))}, {', '.join(pairs)}, "
        "('pose', s, tube), ('actuator_wrench', tube)"
    )


def _tube(tube: Any, configuration: Configuration) -> int:
    return index(tube, "tube", configuration.tube_count)


def place_of(s: Any, tube: int | None, configuration: Configuration, field: str = "s") -> float:
    """An arc length on the robot or on a tube, exactly at a tube's end where it is that except for rounding."""
    ends = configuration.ends
    return float(ends.snap(number(s, field, least=0.0, most=ends.of(tube) + ends.slack, unit="m")))


def from_left(wanted: Output, configuration: Configuration) -> bool:
    """Whether the value at its arc length is the limit from the left, as at the end of the tube or the robot."""
    return wanted.s is not None and wanted.s >= configuration.ends.of(wanted.tube)


class Expressions:
    """Outputs in one order of break points: what they need of the data, and their values at symbols, SI."""

    def __init__(self, wanted: Output, problem: ParametricProblem, keys: tuple[Any, ...]) -> None:
        self.wanted = wanted
        self.problem = problem
        self.order = problem.given(keys)
        self._left = problem.from_left
        self.around = self._around()

    def _around(self) -> list[tuple[int, int]]:
        """Positions, and the side, where the data of the equations are needed."""
        if self.wanted.name in ("curvature", "torsion", "tube_moment"):
            return [(self.order.ranks[PROBE], 0 if self._left else 1)]
        if self.wanted.name != "actuator_wrench":
            return []
        moving = self._moving()
        return [(k, side) for k in moving for side in (0, 1) if not (side and k == self.order.sections)]

    def _moving(self) -> list[int]:
        """Positions of the tube's own break points in front of the entry point."""
        return [rank for key, rank in self.order.ranks.items() if key[:2] == ("tube", self.wanted.tube) and rank > 0]

    def value(self, swept: Swept, discretized: Discretized) -> Any:
        """The output as a column; a pose as its position and the nine entries of its rotation."""
        problem, scales = self.problem, self.problem.configuration.scales
        of, tubes = self.wanted, self.problem.configuration.tube_count
        if of.name in ("energy", "load_work", "potential_energy"):
            elastic, potential = self._energies(swept, discretized)
            return {"energy": elastic, "load_work": -potential, "potential_energy": elastic + potential}[of.name]
        if of.name == "actuator_wrench":
            return self._actuator(swept, discretized)
        position = self.order.sections if of.s is None else self.order.ranks[PROBE]
        before = of.s is None or self._left
        vector = swept.left[:, position - 1] if before else swept.right[:, position]
        state = State.split(vector, tubes)
        if of.name in ("position", "tip_position"):
            return state.position * scales.length
        if of.posed:
            frame = material_frame(state.orientation, state.angles[of.tube])
            return ca.vertcat(state.position * scales.length, ca.vec(frame))
        if of.name == "tube_angle":
            return state.angles[of.tube]
        if of.name == "internal_force":
            return state.force * scales.force
        if of.name == "internal_moment":
            own = ca.vertcat(state.bending, ca.sum1(state.torsion))
            return rotation_matrix(state.orientation) @ own * scales.moment
        bent, twisted, moments, _ = problem.functions.local(vector, swept.locals[position, 0 if before else 1])
        if of.name == "curvature":
            return ca.vertcat(bent, 0) / scales.length
        assert of.tube is not None
        return (
            twisted[of.tube] / scales.length
            if of.name == "torsion"
            else moments[3 * of.tube : 3 * of.tube + 3] * (scales.moment)
        )

    def _integrals(self, swept: Swept, discretized: Discretized) -> Any:
        problem = self.problem
        functions = integral_functions(problem.configuration.tube_count, problem.integrator, discretized.kind)
        return functions.step.map(len(discretized.steps))(swept.begins, swept.columns, swept.slopes)

    def _energies(self, swept: Swept, discretized: Discretized) -> tuple[Any, Any]:
        """Elastic energy and the loads' potential, J."""
        functions, scales = self.problem.functions, self.problem.configuration.scales
        elastic, potential, _ = self._integrals(swept, discretized)
        parts, tubes = functions.entry.parts, self.problem.configuration.tube_count
        torsion = swept.z[2 : 2 + tubes]
        twisted = ca.sum1(transmission_energy(torsion, swept.entry[parts["compliance"]]))
        at_entry = functions.entry.point_energy(swept.entry, swept.entry[parts["position"]])
        elastic = (ca.sum2(elastic) + twisted) * scales.moment + swept.straightening_energy
        return elastic, (ca.sum2(potential) + at_entry) * scales.moment

    def _actuator(self, swept: Swept, discretized: Discretized) -> Any:
        """Force and torque on a tube's base: jumps of the Hamiltonian, explicit dependence, and what is behind."""
        problem, i = self.problem, self.wanted.tube
        configuration, tubes = problem.configuration, problem.configuration.tube_count
        assert i is not None
        hamiltonian = integral_functions(tubes, problem.integrator, discretized.kind).hamiltonian
        *_, forces = self._integrals(swept, discretized)
        total = ca.sum2(forces[i, :])
        for position, side in self.around:
            vector = swept.right[:, position] if side else swept.left[:, position - 1]
            total += (1.0 if side else -1.0) * hamiltonian(vector, swept.locals[position, side])
        scales, torque = configuration.scales, swept.z[2 + i]
        behind = problem.behind_entry(i, self.order)(swept.theta, torque * scales.moment)
        return ca.vertcat(total * scales.force + behind, -torque * scales.moment)


def rates_of(wanted: Output, value: Array) -> Array:
    """The matrix that takes derivatives of a value to those of the output: of rotations, world rotation vectors.

    With ``Q = R(theta) R^T`` the rotation vector is ``vee(Q - Q^T) / 2`` up to the third order.
    """
    if not wanted.posed:
        return np.eye(len(value))
    frame = value[3:].reshape((3, 3), order="F")
    rates = np.zeros((6, 12))
    rates[:3, :3] = np.eye(3)
    for k in range(9):
        entry = np.zeros(9)
        entry[k] = 1.0
        turned = entry.reshape((3, 3), order="F") @ frame.T
        turned = 0.5 * (turned - turned.T)
        rates[3:, 3 + k] = turned[2, 1], turned[0, 2], turned[1, 0]
    return rates
