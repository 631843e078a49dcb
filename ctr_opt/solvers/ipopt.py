"""IPOPT as one class, built once for a program and solved for many parameters.

A reported success counts only if the equations hold at the returned point.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import attrs
import casadi as ca
import numpy as np

from ..checks import Array, bounded, choice, counted
from ..transcription.nlp import Nlp

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix


LOCK = threading.RLock()  # IPOPT's linear solver is shared by the process and not thread-safe


def _start(_: Ipopt, field: attrs.Attribute[Any], value: Any) -> None:
    if value is not None:
        choice(value, f"Ipopt.{field.name}", STARTS)


STARTS = ("straight", "homotopy")


@attrs.frozen
class Ipopt:
    """Options of IPOPT.

    Parameters
    ----------
    tolerance
        Tolerance of the optimality conditions and constraints; the problems are dimensionless.
    max_iterations
        Largest number of iterations.
    start
        Where a cold solve starts. ``"straight"``: at the straight robot. ``"homotopy"``: at the equilibrium that
        shooting with homotopy finds. If it finds none, the energy formulation starts at the straight robot. The
        equilibrium formulation then tries a minimum of the energy under the conservative loads, and last the straight
        robot. Default: ``"straight"`` for the energy formulation, ``"homotopy"`` for the equilibrium formulation,
        which converges less often from the straight robot.

    Raises
    ------
    DefinitionError
        A value outside its range, or an unknown start.

    Examples
    --------
    >>> Ipopt(start="homotopy").max_iterations
    100
    """

    tolerance: float = attrs.field(default=1e-10, validator=bounded(above=0.0))
    max_iterations: int = attrs.field(default=100, validator=counted(1))
    start: str | None = attrs.field(default=None, validator=_start)


@attrs.frozen(eq=False)
class IpoptPoint:
    """The point where IPOPT ended."""

    x: Array
    multipliers: Array
    objective: float
    iterations: int
    converged: bool
    message: str
    residual: Array

    @classmethod
    def of(cls, result: Any, stats: Any, ends: Sequence[str], most: float) -> IpoptPoint:
        """The point from a CasADi result; converged if it ended well and residuals are below ``most``."""
        x, multipliers, residual = (result[name].full()[:, 0] for name in ("x", "lam_g", "g"))
        sound = bool(np.isfinite(x).all()) and np.abs(residual).max(initial=0.0) < most
        status = str(stats["return_status"])
        message = status.replace("_", " ").lower()
        converged = status in ends and bool(sound)
        return cls(x, multipliers, float(result["f"]), int(stats["iter_count"]), converged, message, residual)


def quiet(tolerance: float, iterations: int, **extra: Any) -> dict[str, Any]:
    """CasADi options for an IPOPT that prints nothing, scales nothing and leaves failures to its caller."""
    return {
        "print_time": False,
        "error_on_fail": False,
        "calc_lam_p": False,
        "show_eval_warnings": False,
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "tol": tolerance,
            "max_iter": iterations,
            "nlp_scaling_method": "none",
            **extra,
        },
    }


class IpoptSolver:
    """IPOPT for one equality-constrained program."""

    def __init__(self, nlp: Nlp, method: Ipopt) -> None:
        self.nlp = nlp
        self._tolerance = method.tolerance
        options = quiet(method.tolerance, method.max_iterations, acceptable_iter=0)
        if nlp.f.is_zero():  # a square system: without curvature of a Lagrangian IPOPT takes Newton's steps
            x, p, lam_f, lam_g = nlp.x, nlp.p, ca.MX.sym("lam_f"), ca.MX.sym("lam_g", nlp.g.numel())
            none = ca.MX(nlp.x.numel(), nlp.x.numel())
            options["hess_lag"] = ca.Function("nlp_hess_l", [x, p, lam_f, lam_g], [none])
        program: Any = {"x": nlp.x, "p": nlp.p, "f": nlp.f, "g": nlp.g}
        self._solver = ca.nlpsol("solver", "ipopt", program, options)
        self._hessian: ca.Function | None = None

    def solve(self, x: Array, p: Array) -> IpoptPoint:
        """Solve from the guess ``x`` with parameters ``p``."""
        with LOCK:
            result = self._solver(x0=x, p=p, lbg=0.0, ubg=0.0)
            stats = self._solver.stats()
        return IpoptPoint.of(result, stats, ("Solve_Succeeded",), 1e3 * self._tolerance)

    def derivatives(self, point: IpoptPoint, p: Array) -> tuple[csc_matrix, csc_matrix]:
        """The Hessian of the Lagrangian and the Jacobian of the constraints at a point."""
        from scipy.sparse import csc_matrix

        with LOCK:
            if self._hessian is None:
                nlp = self.nlp
                lam = ca.MX.sym("lam", nlp.g.numel())
                hessian, _ = ca.hessian(nlp.f + ca.dot(lam, nlp.g), nlp.x)
                self._hessian = ca.Function("derivatives", [nlp.x, nlp.p, lam], [hessian, ca.jacobian(nlp.g, nlp.x)])
            second, first = self._hessian(point.x, p, point.multipliers)
        return csc_matrix(second.sparse()), csc_matrix(first.sparse())
