"""IPOPT for programs that are evaluated in numbers: objective and constraints with derivatives from outside CasADi."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import attrs
import casadi as ca
import numpy as np

from ..checks import Array
from .ipopt import LOCK, IpoptPoint, quiet

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

_ENDS = ("Solve_Succeeded", "Search_Direction_Becomes_Too_Small", "Solved_To_Acceptable_Level")
"""How IPOPT ends at an answer: as wanted, or where rounding errors leave nothing to gain."""
_STANDS_STILL = {
    "acceptable_iter": 3,
    "acceptable_obj_change_tol": 1e-12,
    "acceptable_constr_viol_tol": 1e-9,
    "acceptable_tol": 1e10,
}
"""An answer, too: equations hold, and the objective is the same in so many steps, as where it knows no direction."""
_SATISFIED = 1e-8  # largest equation left


@attrs.frozen(eq=False)
class Evaluated:
    """A program at a point: objective, gradient, constraints, their Jacobian, Hessian of the objective.

    The last two are the nonzeros, column by column; the Hessian may be that of Gauss and Newton and holds the upper
    triangle.
    """

    objective: float
    gradient: Array
    constraints: Array
    jacobian: Array
    hessian: Array


class Program(Protocol):
    """Minimize an objective under equations."""

    @property
    def jacobian_structure(self) -> csc_matrix:
        """Where the Jacobian of the constraints has nonzeros."""

    @property
    def hessian_structure(self) -> csc_matrix:
        """Where the Hessian's upper triangle has nonzeros."""

    def evaluate(self, x: Array) -> Evaluated | None:
        """Everything at a point; None where it cannot be evaluated."""


class _Callback(ca.Callback):
    """A function of CasADi's whose outputs are computed in numbers."""

    def __init__(
        self,
        name: str,
        sizes: list[int],
        outputs: list[ca.Sparsity],
        values: Callable[..., list[Any]],
        caught: list[BaseException],
    ) -> None:
        ca.Callback.__init__(self)
        self._sizes, self._outputs, self._values, self._caught = sizes, outputs, values, caught
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._sizes)

    def get_n_out(self) -> int:
        return len(self._outputs)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._sizes[i], 1)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self._outputs[i]

    def eval(self, arguments: Sequence[ca.DM]) -> list[ca.DM]:
        try:
            values = self._values(*(np.asarray(each.full())[:, 0] for each in arguments))
        except BaseException as error:  # IPOPT would print it and go on: kept until it has ended
            self._caught.append(error)
            return [ca.DM(pattern, np.full(pattern.nnz(), np.nan)) for pattern in self._outputs]
        return [ca.DM(pattern, value) for pattern, value in zip(self._outputs, values, strict=True)]


def _pattern(matrix: csc_matrix) -> ca.Sparsity:
    rows, columns = matrix.shape
    return ca.Sparsity(rows, columns, matrix.indptr.tolist(), matrix.indices.tolist())


def solve_program(
    program: Program,
    start: Array,
    bounds: tuple[Array, Array],
    *,
    tolerance: float = 1e-9,
    iterations: int = 200,
    progress: Callable[[int], None] | None = None,
) -> IpoptPoint:
    """IPOPT's answer from a start, between bounds."""
    size, count = len(start), program.jacobian_structure.shape[0]
    kept: dict[bytes, Evaluated] = {}

    def at(x: Array) -> Evaluated:
        if caught:
            return _nowhere(size, count, program)
        key = x.tobytes()
        if key not in kept:
            found = program.evaluate(x)
            kept.clear()
            kept[key] = _nowhere(size, count, program) if found is None else found
        return kept[key]

    def told(x: Array, _: Array) -> list[Any]:
        found = at(x)
        return [[found.objective], found.constraints]

    def hessian(x: Array, _: Array, factor: Array, __: Array) -> list[Any]:
        return [factor[0] * at(x).hessian]

    def watch(*_: Array) -> list[Any]:
        try:
            steps.append(0)
            if progress is not None and not caught:
                progress(len(steps))
        except BaseException as error:
            caught.append(error)
        return [[float(bool(caught))]]  # not zero: IPOPT is to stop

    steps: list[int] = []
    caught: list[BaseException] = []
    dense = ca.Sparsity.dense
    jacobian, second = _pattern(program.jacobian_structure), _pattern(program.hessian_structure)
    values = _Callback("values", [size, 0], [dense(1, 1), dense(count, 1)], told, caught)
    slope = _Callback(
        "slope", [size, 0], [dense(1, 1), dense(size, 1)], lambda x, _: [[at(x).objective], at(x).gradient], caught
    )
    slopes = _Callback(
        "slopes", [size, 0], [dense(count, 1), jacobian], lambda x, _: [at(x).constraints, at(x).jacobian], caught
    )
    curved = _Callback("curved", [size, 0, 1, count], [second], hessian, caught)
    x = ca.MX.sym("x", size)
    objective, constraints = values(x, ca.MX(0, 1))
    options = quiet(tolerance, iterations, mu_init=1e-6, **_STANDS_STILL)
    options |= {"no_nlp_grad": True, "calc_lam_x": False, "calc_f": False, "calc_g": False}
    options |= {"grad_f": slope, "jac_g": slopes, "hess_lag": curved}
    if progress is not None:
        watched = [dense(size, 1), dense(1, 1), dense(count, 1), dense(size, 1), dense(count, 1), dense(0, 1)]
        options["iteration_callback"] = _Callback(
            "watch", [each.numel() for each in watched], [dense(1, 1)], watch, caught
        )
    with LOCK:
        solver = ca.nlpsol("estimation", "ipopt", {"x": x, "f": objective, "g": constraints}, options)
        result = solver(x0=start, lbx=bounds[0], ubx=bounds[1], lbg=0.0, ubg=0.0)
        stats = solver.stats()
    if caught:
        raise caught[0]
    found, residual = result["x"].full()[:, 0], result["g"].full()[:, 0]
    sound = bool(np.isfinite(found).all()) and np.abs(residual).max(initial=0.0) < _SATISFIED
    return IpoptPoint(
        found,
        result["lam_g"].full()[:, 0],
        float(result["f"]),
        int(stats["iter_count"]),
        stats["return_status"] in _ENDS and bool(sound),
        str(stats["return_status"]).replace("_", " ").lower(),
        residual,
    )


def _nowhere(size: int, count: int, program: Program) -> Evaluated:
    nothing = np.nan
    return Evaluated(
        nothing,
        np.full(size, nothing),
        np.full(count, nothing),
        np.full(program.jacobian_structure.nnz, nothing),
        np.full(program.hessian_structure.nnz, nothing),
    )
