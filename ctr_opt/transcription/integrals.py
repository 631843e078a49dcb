"""What is integrated along the robot beside its states, and the Hamiltonian: energies, forces on actuators.

With internal forces and moments as costates, the potential energy of a shape in equilibrium changes by the jump of
``H = m_xy . u_xy + sum tau_i u_i,z + n . R e3 - W - V`` when a break point moves; ``W`` is the elastic energy and ``V``
the potential of the loads, both per arc length.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..layout.columns import StepColumns
from ..mechanics import rod
from ..mechanics.kind import Kind, shared_by_kind
from ..mechanics.so3 import rotation_matrix
from ..mechanics.state import State
from .integrators import runge_kutta


class IntegralFunctions:
    """The CasADi functions for a number of tubes, an integrator and a kind of loads; dimensionless.

    ``step: (x, column, slopes) -> (W, V, forces)``: integrals over a step that begins with the state ``x``: the elastic
    energy, the loads' potential with those at the step's end, and for each tube ``m_i . du*_i/ds``;
    ``slopes`` are ``du*_i/ds (3 tubes,)`` node by node. ``hamiltonian: (x, column of one node) -> H``.
    """

    def __init__(self, tubes: int, integrator: str, kind: Kind) -> None:
        method = runge_kutta(integrator)
        columns = StepColumns(tubes, len(method.nodes), kind)
        size = State.size(tubes)
        x, column = ca.SX.sym("x", size), ca.SX.sym("column", columns.size)
        slopes = ca.SX.sym("slopes", 3 * tubes * len(method.nodes))

        def derivative(inner: Any, j: int) -> Any:
            state = State.split(inner[:size], tubes)
            local = columns.local(column, j, state)
            bent, twisted = rod.curvature(state, local)
            moments = rod.tube_moments(state.angles, bent, twisted, local)
            own = [slopes[3 * (tubes * j + i) : 3 * (tubes * j + i) + 3] for i in range(tubes)]
            forces = [ca.dot(moment, slope) for moment, slope in zip(moments, own, strict=True)]
            elastic = rod.elastic_density(state.angles, bent, twisted, local)
            return ca.vertcat(
                rod.rates(state, local).joined(), elastic, columns.load_energy(column, j, state.position), *forces
            )

        end = method.step(derivative, ca.vertcat(x, ca.SX.zeros(2 + tubes)), column[0])
        potential = end[size + 1] + columns.point_energy(column, end[State.parts(tubes)["position"]])
        self.step = ca.Function("integrals", [x, column, slopes], [end[size], potential, end[size + 2 :]])
        single = StepColumns(tubes, 1, kind)
        here, state = ca.SX.sym("column", single.size), State.split(x, tubes)
        local = single.local(here, 0, state)
        bent, twisted = rod.curvature(state, local)
        work = ca.dot(state.bending, bent) + ca.dot(state.torsion, twisted)
        work += ca.dot(state.force, rotation_matrix(state.orientation)[:, 2])
        stored = rod.elastic_density(state.angles, bent, twisted, local) + single.load_energy(here, 0, state.position)
        self.hamiltonian = ca.Function("hamiltonian", [x, here], [work - stored])


integral_functions = shared_by_kind(IntegralFunctions, most=32)
"""The functions for ``(tubes, integrator, kind)``, shared by all problems."""
