"""How far states at the nodes of a mesh are from the exact ones: gaps between steps, closed by one Newton step.

Multiple shooting, linearized at the nodes: wherever the exact steps end beside the next node or miss the conditions at
the tip, the nodes must move. Nothing is integrated from one end of the robot to the other, so that stiff loads, which
would blow small errors up on the way, do no harm.
"""

from __future__ import annotations

import attrs
import numpy as np

from ..checks import Array
from ..mechanics import boundary
from ..mechanics.state import State
from .shooting import NodeStates, Shooting

NEGLIGIBLE = 1e-8
"""Singular values below are directions in which nothing is determined; a straight, unloaded robot's are about 1."""


def newton_correction(jacobian: Array, residual: Array, negligible: float = NEGLIGIBLE) -> Array:
    """The shortest ``dz`` with ``jacobian dz = -residual``.

    Where a family of equilibria exists (a buckled straight rod may lie in any plane) the Jacobian is singular along
    it, and the shortest correction leaves the family alone.
    """
    left, values, right = np.linalg.svd(jacobian)
    kept = values > max(negligible, float(np.finfo(float).eps) * values[0])
    inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    return np.asarray(-right.T @ (inverse * (left.T @ residual)))


@attrs.frozen(eq=False)
class Closure:
    """Corrections of the states ``(size, k + 1)`` behind the nodes, of the unknowns at the entry, and their Jacobian.

    ``gaps (size, k)``: from where the exact steps end, behind the point loads there, to the next node.
    """

    states: Array
    gaps: Array
    unknowns: Array
    jacobian: Array


def close(shooting: Shooting, z: Array, nodes: NodeStates, ends: Array) -> Closure:
    """The correction that closes the gaps, to first order; exact steps from the nodes end at ``ends (size, k)``."""
    functions, tubes = shooting.functions, shooting.configuration.tube_count
    right = np.column_stack((nodes.right, nodes.tip))
    gaps = functions.many("jumped", ends, shooting.columns)[0] - right[:, 1:]
    start, slope = functions.start(z, shooting.entry)
    free = np.zeros((State.size(tubes), 5 + tubes))
    free[:, : functions.unknowns] = slope.full()
    if functions.unknowns < free.shape[1]:  # under dead loads the force is known, but for the error of its quadrature
        free[State.parts(tubes)["force"], -3:] = np.eye(3)
    first = np.column_stack((free, start.full()[:, 0] - right[:, 0]))
    carried = functions.carry(first, nodes.right, shooting.columns, gaps)
    rows = boundary.tip_rows(tubes, live=True)
    last = carried[-1][rows]
    jacobian = last[:, :-1]
    moved = newton_correction(jacobian, last[:, -1] + nodes.tip[rows])
    states = np.stack([each[:, :-1] @ moved + each[:, -1] for each in carried], axis=1)
    known = slice(0, functions.unknowns)
    return Closure(states, gaps, moved[known], jacobian[known, known])
