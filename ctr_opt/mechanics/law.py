"""The constitutive law of a tube, in this one place (paper, (3)): linear and isotropic.

Another law replaces the three functions: the energy density, its derivative (the moment), and the backbone
curvature at which the tubes together carry a given bending moment.
"""

from __future__ import annotations

import casadi as ca

from .symbols import SymT


def energy_density(strain: SymT, bending_stiffness: SymT, torsional_stiffness: SymT) -> SymT:
    """Elastic energy per arc length of one tube, ``1/2 Du^T K Du``; ``strain = u - u*``, tube frame, ``(3,)``."""
    return 0.5 * (bending_stiffness * (strain[0] ** 2 + strain[1] ** 2) + torsional_stiffness * strain[2] ** 2)


def moment(strain: SymT, bending_stiffness: SymT, torsional_stiffness: SymT) -> SymT:
    """Internal moment of one tube in its own frame, ``K Du`` (3)."""
    return ca.vertcat(bending_stiffness * strain[0], bending_stiffness * strain[1], torsional_stiffness * strain[2])


def twist_rate(torsional_moment: SymT, torsional_stiffness: SymT, preset: SymT) -> SymT:
    """``u_i,z`` of a tube that carries ``tau_i``: the third row of (3), solved."""
    return preset + torsional_moment / torsional_stiffness


def backbone_curvature(bending_moment: SymT, bending_stiffness: SymT, preset_x: SymT, preset_y: SymT) -> SymT:
    """``u_xy`` at which the tubes together carry ``m_xy``: the first rows of (3), summed and solved.

    ``bending_stiffness`` and the preset curvatures, *turned into the backbone frame*, are ``(tubes,)``.
    """
    carried = ca.vertcat(ca.dot(bending_stiffness, preset_x), ca.dot(bending_stiffness, preset_y))
    return (bending_moment + carried) / ca.sum1(bending_stiffness)
