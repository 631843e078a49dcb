"""Solve rows of actuations and loads one after the other; rows that leave their branch are marked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import attrs
import numpy as np

from ...checks import flag
from ...loads.kind import Load
from ...robot.actuation import Actuation, actuation_of
from ...solvers.homotopy import Homotopy, family_of, regular_between
from ...solvers.ipopt import Ipopt
from ..equilibrium import Equilibrium
from ..solver import ForwardSolver, started
from .result import Batch
from .rows import rows_of_actuations, rows_of_loads

_SAME = 1e-3  # relative distance of the unknowns: equilibria this near with a regular Jacobian between them are one


def solve_rows(
    solver: ForwardSolver,
    actuations: Sequence[Actuation] | tuple[Any, Any],
    loads: Sequence[Any],
    initial: Equilibrium | None,
    chained: bool,
) -> Batch:
    """Solve all rows; see :meth:`ForwardProblem.solve_many <ctr_opt.ForwardProblem.solve_many>`."""
    flag(chained, "chained")
    rows, objects = rows_of_actuations(actuations, len(solver.robot.tubes))
    rows_loads = rows_of_loads(loads, len(rows))
    if initial is not None:
        started(initial, solver.robot)
    fast = solver.compiled_for(load for row in rows_loads for load in row)
    batch = None if fast is None else fast.batch(rows, rows_loads)
    results: list[Equilibrium] = []
    snapped, before = np.zeros(len(rows), dtype=bool), initial
    while len(results) < len(rows):
        first = None if before is None else before.record
        for record in [None] if batch is None else batch.solve(len(results), first, chained):
            k = len(results)
            if record is not None:
                result = Equilibrium(record)
            else:
                actuation = actuation_of(rows[k]) if objects is None else objects[k]
                result, left = _solve_row(solver, actuation, rows_loads[k], before)
                snapped[k] = left and chained
            results.append(result)
            if chained and result.converged:
                before = result
    return Batch(results, snapped)


def _solve_row(
    solver: ForwardSolver, actuation: Actuation, loads: tuple[Load, ...], before: Equilibrium | None
) -> tuple[Equilibrium, bool]:
    """Solve one row; also whether it left the branch of ``before``. A guess is not on a branch."""
    if before is None:
        return solver.solve(actuation, loads), False
    result = solver.solve(actuation, loads, before)
    if result.converged:
        return result, before.converged and not _continues(solver, before, result)
    cold = solver.solve(actuation, loads)
    return cold, cold.converged and before.converged


def _continues(solver: ForwardSolver, before: Equilibrium, result: Equilibrium) -> bool:
    """Whether a solve from ``before`` stayed on its branch.

    Shooting stays on the branch or fails. IPOPT may cross a fold to any shape. So shooting follows the branch again,
    and the two answers are compared.
    """
    settings = solver.settings
    if not isinstance(settings.method, Ipopt):
        return True
    shooting = attrs.evolve(settings, formulation="equilibrium", method=Homotopy())
    followed = ForwardSolver(solver.robot, shooting, compiled=False).solve(result.actuation, result.loads, before)
    if not followed.converged:
        return False
    scales, live = result.configuration.scales, result.configuration.kind.live
    a, b = (equilibrium.last_iterate.unknowns(scales, live) for equilibrium in (followed, result))
    near = np.linalg.norm(a - b) <= _SAME * (1.0 + np.linalg.norm(a))
    along_branch, at_result = followed.shooting_jacobian, result.shooting_jacobian
    assert along_branch is not None
    assert at_result is not None
    return bool(near) and regular_between(along_branch, at_result, family_of(along_branch))
