"""IPOPT for programs evaluated in numbers: objective, constraints and derivatives come from outside CasADi."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import count
from typing import TYPE_CHECKING, Any, Protocol

import attrs
import casadi as ca
import numpy as np

from ..checks import Array
from .ipopt import LOCK, IpoptPoint, quiet

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

_ENDS = ("Solve_Succeeded", "Search_Direction_Becomes_Too_Small", "Solved_To_Acceptable_Level")
"""Endings of IPOPT that count as an answer: success, or rounding errors that prevent further progress."""
_STANDS_STILL = {
    "acceptable_iter": 3,
    "acceptable_obj_change_tol": 1e-12,
    "acceptable_constr_viol_tol": 1e-9,
    "acceptable_tol": 1e10,
}
"""Also an answer: the equations hold and the objective stays the same in this number of steps."""
_SATISFIED = 1e-8  # largest residual of an equation


@attrs.frozen(eq=False)
class Evaluated:
    """A program at a point: objective, gradient, constraints, their Jacobian, Hessian of the objective.

    Jacobian and Hessian are given by their nonzeros, column by column. The Hessian may be that of Gauss-Newton; it
    holds the upper triangle.
    """

    objective: float
    gradient: Array
    constraints: Array
    jacobian: Array
    hessian: Array


class Program(Protocol):
    """A program: minimize an objective under equations."""

    @property
    def jacobian_structure(self) -> csc_matrix:
        """The sparsity of the Jacobian of the constraints."""

    @property
    def hessian_structure(self) -> csc_matrix:
        """The sparsity of the Hessian's upper triangle."""

    def evaluate(self, x: Array) -> Evaluated | None:
        """Evaluate everything at a point; None if that is not possible."""


class _Callback(ca.Callback):
    """A CasADi function of columns, computed in numbers; exceptions are collected in ``caught``."""

    def __init__(
        self,
        name: str,
        caught: list[BaseException],
        sizes: list[int],
        outputs: list[ca.Sparsity],
        values: Callable[..., list[Any]],
    ) -> None:
        ca.Callback.__init__(self)
        self._caught, self._sizes, self._outputs, self._values = caught, sizes, outputs, values
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
            values = self._values(*(np.asarray(argument.full())[:, 0] for argument in arguments))
        except BaseException as error:  # IPOPT would print it and continue: kept until IPOPT ends
            self._caught.append(error)
            return [ca.DM(pattern, np.full(pattern.nnz(), np.nan)) for pattern in self._outputs]
        return [ca.DM(pattern, value) for pattern, value in zip(self._outputs, values, strict=True)]


class _Points:
    """A program at the points that IPOPT requests; each is evaluated once, and an error ends the solve."""

    def __init__(self, program: Program, size: int) -> None:
        self.program, self.size = program, size
        self.caught: list[BaseException] = []
        self._kept: tuple[bytes, Evaluated] | None = None

    def at(self, x: Array) -> Evaluated:
        """Everything at a point; NaN if it cannot be evaluated, and after an error."""
        key = x.tobytes()
        if self._kept is None or self._kept[0] != key:
            evaluated = None if self.caught else self.program.evaluate(x)
            self._kept = key, evaluated or self._nowhere()
        return self._kept[1]

    def _nowhere(self) -> Evaluated:
        jacobian, hessian = self.program.jacobian_structure, self.program.hessian_structure
        sizes = self.size, jacobian.shape[0], jacobian.nnz, hessian.nnz
        return Evaluated(np.nan, *(np.full(size, np.nan) for size in sizes))

    def functions(self) -> dict[str, _Callback]:
        """The program as ``nlp``, and its derivatives, by the names of CasADi's options."""
        size, at, dense = self.size, self.at, ca.Sparsity.dense
        jacobian, hessian = _pattern(self.program.jacobian_structure), _pattern(self.program.hessian_structure)
        equations, one = jacobian.shape[0], dense(1, 1)
        parts: dict[str, tuple[list[int], list[ca.Sparsity], Callable[..., list[Any]]]] = {
            "nlp": ([size, 0], [one, dense(equations, 1)], lambda x, _: [[at(x).objective], at(x).constraints]),
            "grad_f": ([size, 0], [one, dense(size, 1)], lambda x, _: [[at(x).objective], at(x).gradient]),
            "jac_g": ([size, 0], [dense(equations, 1), jacobian], lambda x, _: [at(x).constraints, at(x).jacobian]),
            "hess_lag": ([size, 0, 1, equations], [hessian], lambda x, _, factor, __: [factor[0] * at(x).hessian]),
        }
        return {name: _Callback(name, self.caught, *part) for name, part in parts.items()}

    def watched(self, progress: Callable[[int], None]) -> _Callback:
        """The callback after each iteration, which reports their number or stops the solve."""
        steps = count(1)

        def watch(*_: Array) -> list[Any]:
            try:
                if not self.caught:
                    progress(next(steps))
            except BaseException as error:
                self.caught.append(error)
            return [[float(bool(self.caught))]]  # not zero: IPOPT is to stop

        size, equations = self.size, self.program.jacobian_structure.shape[0]
        return _Callback(
            "watch", self.caught, [size, 1, equations, size, equations, 0], [ca.Sparsity.dense(1, 1)], watch
        )


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
    """Solve a program by IPOPT from a start, between bounds; raises errors of the program or of ``progress``."""
    points = _Points(program, len(start))
    functions = points.functions()
    x, nlp = ca.MX.sym("x", len(start)), functions.pop("nlp")  # CasADi keeps no callback alive: they are kept here
    objective, constraints = nlp(x, ca.MX(0, 1))
    options = quiet(tolerance, iterations, mu_init=1e-6, **_STANDS_STILL) | functions
    options |= {"no_nlp_grad": True, "calc_lam_x": False, "calc_f": False, "calc_g": False}
    if progress is not None:
        options["iteration_callback"] = points.watched(progress)
    with LOCK:
        solver = ca.nlpsol("estimation", "ipopt", {"x": x, "f": objective, "g": constraints}, options)
        result = solver(x0=start, lbx=bounds[0], ubx=bounds[1], lbg=0.0, ubg=0.0)
        stats = solver.stats()
    if points.caught:
        raise points.caught[0]
    return IpoptPoint.of(result, stats, _ENDS, _SATISFIED)
