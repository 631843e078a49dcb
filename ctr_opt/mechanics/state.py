"""The state along the arc length, and its order in a vector."""

from __future__ import annotations

from typing import Any, Generic

import attrs
import casadi as ca
import numpy as np

from ..checks import Array
from .so3 import SymT


def slices(sizes: dict[str, int]) -> dict[str, slice]:
    """The slices of successive parts of given sizes in a vector."""
    ends = np.cumsum(list(sizes.values()))
    return {name: slice(int(end) - size, int(end)) for (name, size), end in zip(sizes.items(), ends, strict=True)}


@attrs.frozen(eq=False)
class State(Generic[SymT]):
    """The state ``(p, q, psi, m_xy, tau, n)``, which is continuous except for jumps at point loads.

    position ``p`` (3); orientation ``q`` of the backbone frame (4); tube angles ``psi_i``; total bending moment
    ``m_xy`` in the backbone frame (2); torsional moments ``tau_i``; internal force ``n`` in the world frame (3).
    """

    position: SymT
    orientation: SymT
    angles: SymT
    bending: SymT
    torsion: SymT
    force: SymT

    @staticmethod
    def size(tubes: int) -> int:
        """Number of entries of a state vector."""
        return 12 + 2 * tubes

    @staticmethod
    def parts(tubes: int) -> dict[str, slice]:
        """The slice of each part in the state vector."""
        sizes = {"position": 3, "orientation": 4, "angles": tubes, "bending": 2, "torsion": tubes, "force": 3}
        return slices(sizes)

    @staticmethod
    def split(vector: Any, tubes: int) -> State[Any]:
        """The parts of a state vector: symbolic ``(size,)``, or numbers ``(size, k)``."""
        return State(**{name: vector[part, :] for name, part in State.parts(tubes).items()})

    def joined(self) -> SymT:
        """The state as one vector."""
        return ca.vertcat(self.position, self.orientation, self.angles, self.bending, self.torsion, self.force)


def state_names(tubes: int) -> list[str]:
    """A name for each entry of a state vector."""
    angles, torques = [f"psi_{i}" for i in range(tubes)], [f"tau_{i}" for i in range(tubes)]
    pose = ["p_x", "p_y", "p_z", "q_w", "q_x", "q_y", "q_z"]
    return [*pose, *angles, "m_x", "m_y", *torques, "n_x", "n_y", "n_z"]


def stacked(state: State[Any]) -> Array:
    """One array ``(size, k)`` of a state in numbers ``(.., k)``."""
    return np.vstack((state.position, state.orientation, state.angles, state.bending, state.torsion, state.force))


def state_scales(tubes: int, length: float, moment: float, force: float) -> Array:
    """The unit in which each entry of a dimensionless state is measured."""
    scale = np.ones(State.size(tubes))
    parts = State.parts(tubes)
    for name, unit in {"position": length, "bending": moment, "torsion": moment, "force": force}.items():
        scale[parts[name]] = unit
    return scale
