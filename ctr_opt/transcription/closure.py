"""Distance of node states from the exact ones: gaps between steps, closed by one Newton step.

This is multiple shooting, linearized at the nodes. Where exact steps miss the next node or the conditions at the tip,
the nodes must move. Nothing is integrated from one end of the robot to the other, so stiff loads do not amplify small
errors.
"""

from __future__ import annotations

import attrs
import numpy as np

from ..checks import Array
from ..mechanics import boundary
from ..mechanics.state import State
from .shooting import NodeStates, Shooting

NEGLIGIBLE = 1e-8
"""Singular values below this belong to undetermined directions; those of a straight, unloaded robot are about 1."""


def newton_correction(jacobian: Array, residual: Array, negligible: float = NEGLIGIBLE) -> Array:
    """The shortest ``dz`` with ``jacobian dz = -residual``.

    Along a family of equilibria (a buckled straight rod may lie in any plane) the Jacobian is singular. The shortest
    correction does not move along the family.
    """
    left, values, right = np.linalg.svd(jacobian)
    kept = values > max(negligible, float(np.finfo(float).eps) * values[0])
    inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    return np.asarray(-right.T @ (inverse * (left.T @ residual)))


@attrs.frozen(eq=False)
class Closure:
    """Corrections of the states ``(size, k + 1)`` behind the nodes and of the unknowns, and their Jacobian.

    ``gaps (size, k)`` lead from the next node to the end of each exact step, behind the point load there.
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
    if functions.unknowns < free.shape[1]:  # under dead loads the force is known, except for its quadrature error
        free[State.parts(tubes)["force"], -3:] = np.eye(3)
    first = np.column_stack((free, start.full()[:, 0] - right[:, 0]))
    carried = functions.carry(first, nodes.right, shooting.columns, gaps)
    rows = boundary.tip_rows(tubes, live=True)
    last = carried[-1][rows]
    jacobian = last[:, :-1]
    moved = newton_correction(jacobian, last[:, -1] + nodes.tip[rows])
    states = np.stack([matrix[:, :-1] @ moved + matrix[:, -1] for matrix in carried], axis=1)
    known = slice(0, functions.unknowns)
    return Closure(states, gaps, moved[known], jacobian[known, known])
