"""Integrals along the robot besides its states, and the Hamiltonian: energies, forces on actuators.

With internal forces and moments as costates, the potential energy of a shape in equilibrium changes by the jump of
``H = m_xy . u_xy + sum tau_i u_i,z + n . R e3 - W - V`` when a break point moves; ``W`` is the elastic energy and ``V``
the potential of the loads, both per arc length.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..layout.columns import StepColumns
from ..mechanics.kind import Kind, shared_by_kind
from ..mechanics.so3 import rotation_matrix
from ..mechanics.state import State
from .shooting import shooting_functions


class IntegralFunctions:
    """The CasADi functions for a number of tubes, an integrator and a kind of loads; dimensionless.

    ``step: (x, column, slopes) -> (W, V, forces)``: integrals over a step that begins with the state ``x``: the elastic
    energy, the loads' potential with those at the step's end, and for each tube ``m_i . du*_i/ds``;
    ``slopes`` are ``du*_i/ds (3 tubes,)`` node by node. ``hamiltonian: (x, column of one node) -> H``.
    """

    def __init__(self, tubes: int, integrator: str, kind: Kind) -> None:
        functions = shooting_functions(tubes, integrator, kind)
        columns, nodes = functions.columns, functions.columns.nodes
        size, position = State.size(tubes), State.parts(tubes)["position"]
        x, column = ca.SX.sym("x", size), ca.SX.sym("column", columns.size)
        slopes = ca.SX.sym("slopes", 3, tubes * nodes)

        def derivative(inner: Any, j: int) -> Any:
            here = columns.node(column, j)
            _, _, moments, elastic = functions.local(inner[:size], here)
            forces = ca.sum1(moments.reshape((3, tubes)) * slopes[:, tubes * j : tubes * (j + 1)])
            potential = columns.load_energy(column, j, inner[position])
            return ca.vertcat(functions.rates(inner[:size], here), elastic, potential, forces.T)

        end = functions.integrator.step(derivative, ca.vertcat(x, ca.SX.zeros(2 + tubes)), column[0])
        potential = end[size + 1] + columns.point_energy(column, end[position])
        self.step = ca.Function("integrals", [x, column, ca.vec(slopes)], [end[size], potential, end[size + 2 :]])
        single = StepColumns(tubes, 1, kind)
        here, state = ca.SX.sym("column", single.size), State.split(x, tubes)
        bent, twisted, _, elastic = functions.local(x, here)
        work = ca.dot(state.bending, bent) + ca.dot(state.torsion, twisted)
        work += ca.dot(state.force, rotation_matrix(state.orientation)[:, 2])
        stored = elastic + single.load_energy(here, 0, state.position)
        self.hamiltonian = ca.Function("hamiltonian", [x, here], [work - stored])


integral_functions = shared_by_kind(IntegralFunctions, most=32)
"""The functions for ``(tubes, integrator, kind)``, shared by all problems."""
