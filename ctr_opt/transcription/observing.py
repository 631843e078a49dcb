"""Observables in symbols: the data they need from a discretized robot, and their values as CasADi expressions, SI.

If the order of break points is given, a place is a position, and values are read from its column of states. If break
points are sorted inside the function, weights are one at the position of a place and zero elsewhere; the state is the
sum of all columns with these weights. Quantities that jump are taken from one side of a position. The sides are the
columns behind the starts of the sections, followed by those before their ends.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import attrs
import casadi as ca

from ..checks import Array
from ..layout.configuration import Scales
from ..layout.observables import Distal, Observable
from ..layout.ordering import Key, Order, Side
from ..mechanics.fields import material_frame
from ..mechanics.law import transmission_energy
from ..mechanics.so3 import rotation_matrix, turn_back
from ..mechanics.state import State
from .integrals import integral_functions
from .parametric_problem import Discretized, ParametricProblem, Swept
from .shooting import ShootingFunctions


@attrs.frozen(eq=False, slots=False)
class _Point:
    """The robot at a place: its dimensionless state and, for quantities that jump, the data of the equations."""

    functions: ShootingFunctions
    scales: Scales
    vector: Any
    data: Any
    tube: Any

    @cached_property
    def state(self) -> State[Any]:
        return State.split(self.vector, self.functions.tubes)

    @cached_property
    def local(self) -> tuple[Any, ...]:
        """The curvature ``u_xy``, the tubes' ``u_i,z`` and moments in succession, and the elastic energy density."""
        return tuple(self.functions.local(self.vector, self.data))

    @property
    def position(self) -> Any:
        return self.state.position * self.scales.length

    @property
    def angle(self) -> Any:
        return self.state.angles[self.tube]

    @property
    def moment(self) -> Any:
        in_backbone_frame = ca.vertcat(self.state.bending, ca.sum1(self.state.torsion))
        return rotation_matrix(self.state.orientation) @ in_backbone_frame * self.scales.moment

    @property
    def fibre(self) -> Any:
        """The tube's curvature ``u_x, u_y, u_z`` in its own frame."""
        bent = self.local[0]
        turned = turn_back(self.angle, bent[0], bent[1])
        return ca.vertcat(*turned, self.local[1][self.tube]) / self.scales.length


_AT_PLACES: dict[str, Callable[[_Point], Any]] = {
    "position": lambda at: at.position,
    "pose": lambda at: ca.vertcat(at.position, ca.vec(material_frame(at.state.orientation, at.angle))),
    "tube_angle": lambda at: at.angle,
    "internal_force": lambda at: at.state.force * at.scales.force,
    "internal_moment": lambda at: at.moment,
    "curvature": lambda at: ca.vertcat(at.local[0], 0) / at.scales.length,
    "tube_curvature": lambda at: at.fibre,
    "torsion": lambda at: at.local[1][at.tube] / at.scales.length,
    "tube_moment": lambda at: at.local[2][3 * at.tube : 3 * at.tube + 3] * at.scales.moment,
}


class Observer:
    """Observables of a parametric problem for one order of break points; sections are cut at ``fractions``.

    Observables at arc lengths are at the problem's probes, in their order. Poses name their tubes.
    """

    def __init__(
        self, observables: Sequence[Observable], problem: ParametricProblem, order: Order, fractions: Sequence[Array]
    ) -> None:
        self.problem, self.order, self.observables = problem, order, list(observables)
        self.pushes = {
            one.tube: problem.pushes(one.tube or 0, order)
            for one in self.observables
            if one.quantity.at == "tube" and one.quantity.integral
        }
        self._marks: list[Key] = []
        self._sides: list[tuple[Key, Key]] = []
        probes = iter(range(len(self.observables)))
        self.places = [self._place(one, ("probe", next(probes)) if one.placed else None) for one in self.observables]
        self.discretized = Discretized(
            problem,
            order,
            fractions,
            self._needed(),
            integrals=any(one.quantity.integral for one in self.observables),
            marks=self._marks,
            sides=self._sides,
        )

    def _place(self, one: Observable, probe: Key | None) -> Side | int:
        """The side at which an observable is taken, or its column of weights among the marks or sides."""
        end = self.problem.parametric.tube_end
        key = end(one.place.tube) if isinstance(one.place, Distal) else probe
        rank = self.order.sections if key is None else self.order.ranks[key]
        if key is None or isinstance(rank, int):
            return rank, 0 if key is None or self.problem.from_left else 1
        if one.quantity.jumps:
            self._sides.append((key, end(one.tube or 0)))
            return len(self._sides) - 1
        self._marks.append(key)
        return len(self._marks) - 1

    def _needed(self) -> list[Side]:
        """The sides at which the data of the equations are needed."""
        needed = {side for sides, _ in self.pushes.values() for side in sides}
        both = zip(self.observables, self.places, strict=True)
        needed |= {place for one, place in both if one.quantity.jumps and isinstance(place, tuple)}
        return [side for side in self.order.every_side if self._sides or side in needed]

    def values(self, swept: Swept) -> list[Any]:
        """A column for each observable."""
        values = _Values(self, swept)
        return [values.of(one, place) for one, place in zip(self.observables, self.places, strict=True)]


class _Values:
    """Values of observables at the states of a sweep."""

    def __init__(self, observer: Observer, swept: Swept) -> None:
        self.observer, self.swept, problem = observer, swept, observer.problem
        self.functions, self.scales, self.tubes = (
            problem.functions,
            problem.configuration.scales,
            problem.functions.tubes,
        )
        self.integrals = integral_functions(self.tubes, problem.integrator, observer.discretized.kind)

    def of(self, one: Observable, place: Side | int) -> Any:
        """The value of an observable."""
        if one.name in _AT_PLACES:
            return _AT_PLACES[one.name](self._point(one, place))
        return _ELSEWHERE[one.name](self, one.tube or 0)

    # -- at places -------------------------------------------------------------------------------------------------

    def _point(self, one: Observable, place: Side | int) -> _Point:
        swept = self.swept
        if isinstance(place, tuple):
            vector, data = self._state(place), swept.locals.get(place)
        elif one.quantity.jumps:
            vector, data = (columns @ swept.sides[:, place] for columns in self._all_sides)
        else:
            vector, data = swept.right @ swept.weights[:, place], None
        return _Point(self.functions, self.scales, vector, data, one.carrier)

    def _state(self, side: Side) -> Any:
        return self.swept.right[:, side[0]] if side[1] else self.swept.left[:, side[0] - 1]

    @cached_property
    def _all_sides(self) -> tuple[Any, Any]:
        """States and data at all sides."""
        states = ca.horzcat(self.swept.right[:, : self.observer.order.sections], self.swept.left)
        return states, ca.horzcat(*self.swept.locals.values())

    # -- of the robot ----------------------------------------------------------------------------------------------

    @cached_property
    def _integrated(self) -> tuple[Any, ...]:
        """Elastic energy and the loads' potential in each step, and the parts of the tubes' forces."""
        steps = self.integrals.step.map(len(self.observer.discretized.steps))
        return tuple(steps(self.swept.begins, self.swept.columns, self.swept.slopes))

    def energy(self, _: int) -> Any:
        """Elastic energy, including the transmissions, J."""
        entry, parts = self.swept.entry, self.functions.entry.parts
        twisted = ca.sum1(transmission_energy(self.swept.z[2 : 2 + self.tubes], entry[parts["compliance"]]))
        return (ca.sum2(self._integrated[0]) + twisted) * self.scales.moment + self.swept.straightening_energy

    def load_work(self, _: int) -> Any:
        """Work of the loads, minus their potential, J."""
        entry, parts = self.swept.entry, self.functions.entry.parts
        at_entry = self.functions.entry.point_energy(entry, entry[parts["position"]])
        return -(ca.sum2(self._integrated[1]) + at_entry) * self.scales.moment

    def torque(self, tube: int) -> Any:
        """Torque of the actuator on a tube's base, N m."""
        return -self.swept.z[2 + tube] * self.scales.moment

    def force(self, tube: int) -> Any:
        """Force of the actuator on a tube's base, N, from jumps of the Hamiltonian and an integral."""
        sides, pushing = self.observer.pushes[tube]
        states = ca.horzcat(*map(self._state, sides))
        data = ca.horzcat(*(self.swept.locals[side] for side in sides))
        weights, behind = pushing(self.swept.theta, -self.torque(tube))
        hamiltonians = self.integrals.hamiltonian.map(len(sides))(states, data)
        return (ca.sum2(self._integrated[2][tube, :]) + hamiltonians @ weights) * self.scales.force + behind

    def wrench(self, _: int) -> Any:
        """Force and moment of the robot on its support, N and N m."""
        force, moment = self.functions.support(self.swept.z, self.swept.entry)
        return ca.vertcat(force * self.scales.force, moment * self.scales.moment)


_ELSEWHERE: dict[str, Callable[[_Values, int], Any]] = {
    "energy": _Values.energy,
    "load_work": _Values.load_work,
    "potential_energy": lambda of, _: of.energy(0) - of.load_work(0),
    "base_wrench": _Values.wrench,
    "actuator_torque": _Values.torque,
    "actuator_force": _Values.force,
    "actuator_wrench": lambda of, tube: ca.vertcat(of.force(tube), of.torque(tube)),
}
