"""Conditions at the entry point, at point loads and at the tip."""

from __future__ import annotations

from typing import Generic

import attrs
import casadi as ca

from .law import transmission_twist
from .so3 import SymT, rotation_matrix
from .state import State


@attrs.frozen(eq=False)
class EntryPoint(Generic[SymT]):
    """The data of the entry point.

    Its ``position (3,)`` and ``orientation (4,)``; the angles ``psi_i(0)`` of tubes without torque, ``free_angles``;
    the ``compliance`` ``-beta_i / GJ_i`` of the transmissions; the total ``force`` of the dead loads.
    """

    position: SymT
    orientation: SymT
    free_angles: SymT
    compliance: SymT
    force: SymT


def entry_state(bending: SymT, torsion: SymT, force: SymT, entry: EntryPoint[SymT]) -> State[SymT]:
    """The state at ``s = 0`` before any load acts there; ``force`` is due to loads that depend on the shape.

    Behind the entry point, tubes only twist: ``psi_i(0) = free_angle_i + compliance_i tau_i``.
    """
    angles = entry.free_angles + transmission_twist(torsion, entry.compliance)
    return State(entry.position, entry.orientation, angles, bending, torsion, entry.force + force)


def jump(state: State[SymT], force: SymT, moment: SymT) -> State[SymT]:
    """The state behind a point force ``(3,)`` and the tubes' point moments ``(3, tubes)``, world frame.

    ``n(s-) = n(s+) + F``, ``m(s-) = m(s+) + l``, ``tau_i(s-) = tau_i(s+) + (R^T l_i)_z`` (paper, II-G).
    """
    return jump_at(state, force, moment, rotation_matrix(state.orientation))


def jump_at(state: State[SymT], force: SymT, moment: SymT, frame: SymT) -> State[SymT]:
    """The state behind a point load, from the backbone frame ``R (3, 3)``, for derivatives by parts."""
    couples = frame.T @ moment
    return attrs.evolve(
        state,
        bending=state.bending - ca.sum2(couples[:2, :]),
        torsion=state.torsion - couples[2, :].T,
        force=state.force - force,
    )


def tip_rows(tubes: int, live: bool = False) -> list[int]:
    """The entries of a state vector that vanish behind the last load: ``m_xy`` and every ``tau_i`` (paper, II-G).

    With ``live`` loads, which depend on the shape, ``n`` is unknown at the entry and included here. Under dead loads
    alone it vanishes anyway.
    """
    names = ("bending", "torsion", "force") if live else ("bending", "torsion")
    parts = [State.parts(tubes)[name] for name in names]
    return [row for part in parts for row in range(part.start, part.stop)]
