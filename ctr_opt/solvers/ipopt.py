"""IPOPT behind one class: built once for a program, solved for many parameters.

What it says is believed only if the equations hold at the point it returns.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import attrs
import casadi as ca
import numpy as np

from ..checks import Array, bounded, choice
from ..transcription.nlp import Nlp

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix


LOCK = threading.RLock()  # IPOPT's linear solver is one for the process and not safe in threads


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
        Of the optimality conditions and constraints; the problems are dimensionless.
    max_iterations
        Iterations allowed.
    start
        From where a cold solve starts: ``"straight"``, the straight robot, or ``"homotopy"``, the equilibrium that
        shooting with homotopy finds (and, where it finds none, the straight robot). Default: straight for the energy
        formulation, which is at home there, homotopy for the equilibrium formulation, which is not.
    """

    tolerance: float = attrs.field(default=1e-10, validator=bounded(above=0.0))
    max_iterations: int = attrs.field(default=100, validator=bounded(above=0.0))
    start: str | None = attrs.field(default=None, validator=_start)


@attrs.frozen(eq=False)
class IpoptPoint:
    """Where IPOPT ended."""

    x: Array
    multipliers: Array
    objective: float
    iterations: int
    converged: bool
    message: str
    residual: Array

    @classmethod
    def of(cls, result: Any, stats: Any, ends: Sequence[str], most: float) -> IpoptPoint:
        """What a solver of CasADi's returned: believed if it ended well and left at most ``most`` of the equations."""
        x, multipliers, residual = (result[name].full()[:, 0] for name in ("x", "lam_g", "g"))
        sound = bool(np.isfinite(x).all()) and np.abs(residual).max(initial=0.0) < most
        status = str(stats["return_status"])
        said = status.replace("_", " ").lower()
        converged = status in ends and bool(sound)
        return cls(x, multipliers, float(result["f"]), int(stats["iter_count"]), converged, said, residual)


def quiet(tolerance: float, iterations: int, **own: Any) -> dict[str, Any]:
    """Options for CasADi of an IPOPT that prints nothing, scales nothing and leaves failures to its caller."""
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
            **own,
        },
    }


class IpoptSolver:
    """An equality-constrained program, ready to be solved."""

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
        """Hessian of the Lagrangian and Jacobian of the constraints at a point."""
        from scipy.sparse import csc_matrix

        with LOCK:
            if self._hessian is None:
                nlp = self.nlp
                lam = ca.MX.sym("lam", nlp.g.numel())
                hessian, _ = ca.hessian(nlp.f + ca.dot(lam, nlp.g), nlp.x)
                self._hessian = ca.Function("derivatives", [nlp.x, nlp.p, lam], [hessian, ca.jacobian(nlp.g, nlp.x)])
            second, first = self._hessian(point.x, p, point.multipliers)
        return csc_matrix(second.sparse()), csc_matrix(first.sparse())
