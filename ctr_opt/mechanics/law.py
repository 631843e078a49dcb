"""The constitutive law of a tube and its energies (paper, (3)): linear and isotropic; defined only here.

Numbers, symbols and compiled code use these functions. Another law replaces their bodies and names its stiffnesses in
:class:`Stiffness`; everything between a tube's attributes and this module uses those names. The model assumes that a
tube twists in proportion to its torque.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import attrs
import casadi as ca

from .so3 import SymT


@attrs.frozen(eq=False)
class Stiffness:
    """The stiffnesses of one tube, or of all ``(tubes,)``, by the names of a tube's attributes.

    The unit of a stiffness is N m^(2 + lengths). It is zero past its tube's end unless it is kept ``everywhere``: a
    tube's angle continues there at its preset rate.
    """

    bending_stiffness: Any = attrs.field(metadata={"lengths": 0, "everywhere": False})
    torsional_stiffness: Any = attrs.field(metadata={"lengths": 0, "everywhere": True})

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """The names of the stiffnesses, in order."""
        return tuple(field.name for field in attrs.fields(cls))

    @classmethod
    def lengths(cls, name: str) -> int:
        """The powers of length by which the unit of a stiffness exceeds that of ``EI``."""
        return int(getattr(attrs.fields(cls), name).metadata["lengths"])

    @classmethod
    def everywhere(cls, name: str) -> bool:
        """Whether a stiffness is kept past its tube's end."""
        return bool(getattr(attrs.fields(cls), name).metadata["everywhere"])

    @classmethod
    def of(cls, value: Callable[[str], Any]) -> Stiffness:
        """Stiffnesses from a function of their names."""
        return cls(**{name: value(name) for name in cls.names()})

    def of_tube(self, i: int) -> Stiffness:
        """The stiffnesses of one tube out of all."""
        return self.of(lambda name: getattr(self, name)[i])

    def resistance(self) -> list[Any]:
        """Moments over curvatures for ``u_x``, ``u_y`` and each ``u_i,z``, of all tubes at rest."""
        tubes = range(self.bending_stiffness.shape[0])
        bending = sum((self.bending_stiffness[i] for i in tubes[1:]), self.bending_stiffness[0])
        return [bending, bending, *(self.torsional_stiffness[i] for i in tubes)]

    def bends(self) -> Any:
        """Whether tubes resist bending, which they do not past their ends."""
        return self.bending_stiffness > 0


# -- along the robot ---------------------------------------------------------------------------------------------------


def energy_density(strain: Any, stiffness: Stiffness) -> Any:
    """Elastic energy per arc length of one tube, ``1/2 Du^T K Du``; ``strain = u - u*``, tube frame, ``(3,)``."""
    bending, torsional = stiffness.bending_stiffness, stiffness.torsional_stiffness
    return 0.5 * (bending * (strain[0] ** 2 + strain[1] ** 2) + torsional * strain[2] ** 2)


def moment(strain: SymT, stiffness: Stiffness) -> SymT:
    """Internal moment of one tube in its own frame, ``K Du`` (3)."""
    bending, torsional = stiffness.bending_stiffness, stiffness.torsional_stiffness
    result: SymT = ca.vertcat(bending * strain[0], bending * strain[1], torsional * strain[2])
    return result


def twist_rate(torque: Any, stiffness: Stiffness, preset: Any) -> Any:
    """Torsion ``u_i,z`` of a tube that carries ``tau_i``, or of all: the third row of (3), solved."""
    return preset + torque / stiffness.torsional_stiffness


def backbone_curvature(bending_moment: SymT, stiffness: Stiffness, preset_x: SymT, preset_y: SymT) -> SymT:
    """Curvature ``u_xy`` at which the tubes together carry ``m_xy``: the first rows of (3), summed and solved.

    The preset curvatures, *turned into the backbone frame*, are ``(tubes,)``.
    """
    bending = stiffness.bending_stiffness
    carried = ca.vertcat(ca.dot(bending, preset_x), ca.dot(bending, preset_y))
    bent: SymT = (bending_moment + carried) / ca.sum1(bending)
    return bent


# -- behind the entry point, where tubes are held straight and only twist ----------------------------------------------


def straight_energy_density(preset: Any, stiffness: Stiffness) -> Any:
    """Elastic energy per arc length of a tube of preset curvature ``u*`` that is held straight, without torque."""
    return energy_density((-preset[0], -preset[1], 0.0), stiffness)


def straight_hamiltonian(torque: Any, preset: Any, stiffness: Stiffness) -> Any:
    """Hamiltonian ``tau u_z - W`` of a tube alone held straight, N: its loss of energy per length let out."""
    twist = twist_rate(torque, stiffness, preset[2])
    return torque * twist - energy_density((-preset[0], -preset[1], twist - preset[2]), stiffness)


def transmission_compliance(length: Any, stiffness: Stiffness) -> Any:
    """The angle by which a unit torque twists a ``length`` of a tube, or of all tubes, rad/(N m)."""
    return length / stiffness.torsional_stiffness


def transmission_twist(torque: Any, compliance: Any) -> Any:
    """The angle by which a torque twists a transmission, rad."""
    return compliance * torque


def transmission_energy(torque: Any, compliance: Any) -> Any:
    """Elastic energy of a twisted transmission."""
    return 0.5 * compliance * torque**2
