"""The differential equations of the externally loaded robot, in internal moments.

The paper's (2), (12), (16), (19), (20), rewritten in states without derivatives of the preset curvature or the
stiffness; see ``docs/explanation/theory.md`` for each equation. Quantities are either all dimensionless or all SI.
"""

from __future__ import annotations

from typing import Generic

import attrs
import casadi as ca

from . import law as constitutive
from .law import Stiffness
from .so3 import SymT, quaternion_rate, rotation_matrix, turn, turn_back
from .state import State


@attrs.frozen(eq=False)
class Local(Generic[SymT]):
    """The data of the equations at one arc length.

    ``stiffness`` of all tubes; ``precurvature (3, tubes)`` in the tubes' frames; the total ``force (3,)`` and each
    tube's ``moment (3, tubes)``, per arc length, in the world frame.
    """

    stiffness: Stiffness
    precurvature: SymT
    force: SymT
    moment: SymT

    @property
    def tubes(self) -> int:
        """Number of tubes."""
        return int(self.precurvature.shape[1])


def curvature(state: State[SymT], local: Local[SymT]) -> tuple[SymT, SymT]:
    """Backbone curvature ``u_xy (2,)`` and the tubes' torsions ``u_i,z (tubes,)`` by the constitutive law."""
    x, y = turn(state.angles, local.precurvature[0, :].T, local.precurvature[1, :].T)
    bent = constitutive.backbone_curvature(state.bending, local.stiffness, x, y)
    twisted = constitutive.twist_rate(state.torsion, local.stiffness, local.precurvature[2, :].T)
    return bent, twisted


def strain(psi: SymT, bent: SymT, twisted: SymT, preset: SymT) -> SymT:
    """Strain ``u_i - u*_i`` of a tube turned by ``psi`` against the backbone frame (11)."""
    x, y = turn_back(psi, bent[0], bent[1])
    return ca.vertcat(x, y, twisted) - preset


def kinematic_rates(orientation: SymT, bent: SymT) -> tuple[SymT, SymT]:
    """Rates ``p' = R e3`` and ``R' = R hat(u)`` with ``u = (u_x, u_y, 0)`` (2)."""
    u = ca.vertcat(bent, 0)
    return rotation_matrix(orientation)[:, 2], quaternion_rate(orientation, u)


def rates(state: State[SymT], local: Local[SymT]) -> State[SymT]:
    """Derivative of the state along the arc length."""
    bent, _ = curvature(state, local)
    return rates_at(state, local, rotation_matrix(state.orientation), bent)


def rates_at(state: State[SymT], local: Local[SymT], frame: SymT, bent: SymT) -> State[SymT]:
    """The state's rates from the frame ``R (3, 3)`` and curvature ``u_xy (2,)``, for derivatives by parts."""
    twisted = constitutive.twist_rate(state.torsion, local.stiffness, local.precurvature[2, :].T)
    position, orientation = frame[:, 2], quaternion_rate(state.orientation, ca.vertcat(bent, 0))
    to_body = frame.T
    force = to_body @ state.force
    couples = to_body @ local.moment
    axial = ca.sum1(state.torsion)
    bending = ca.vertcat(-bent[1] * axial + force[1], bent[0] * axial - force[0]) - ca.sum2(couples[:2, :])
    torsion = []
    for i, moment in enumerate(tube_moments(state.angles, bent, twisted, local)):
        own_x, own_y = turn_back(state.angles[i], bent[0], bent[1])
        torsion.append(-(own_x * moment[1] - own_y * moment[0]) - couples[2, i])
    return State(position, orientation, twisted, bending, ca.vertcat(*torsion), -local.force)


def tube_moments(angles: SymT, bent: SymT, twisted: SymT, local: Local[SymT]) -> list[SymT]:
    """Each tube's internal moment in its own frame, by the constitutive law (3)."""
    moments = []
    for i in range(local.tubes):
        excess = strain(angles[i], bent, twisted[i], local.precurvature[:, i])
        moments.append(constitutive.moment(excess, local.stiffness.of_tube(i)))
    return moments


def elastic_density(angles: SymT, bent: SymT, twisted: SymT, local: Local[SymT]) -> SymT:
    """Elastic energy per arc length of all tubes at the given curvatures (paper, Appendix)."""
    total = 0 * bent[0]
    for i in range(local.tubes):
        excess = strain(angles[i], bent, twisted[i], local.precurvature[:, i])
        total += constitutive.energy_density(excess, local.stiffness.of_tube(i))
    return total
