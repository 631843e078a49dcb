"""How a solve ended, and what to do about it."""

from __future__ import annotations

from enum import Enum


class Advised(Enum):
    """An outcome with its description and advice."""

    def __init__(self, description: str, advice: str) -> None:
        self.description = description
        self.advice = advice


class SolveStatus(Advised):
    """The outcome of a solve, with a ``description`` and ``advice`` on what to do.

    Examples
    --------
    >>> SolveStatus.CONVERGED.advice
    'nothing to do'
    """

    CONVERGED = ("converged", "nothing to do")
    GUESS = ("a guess, not solved", "pass it to solve() as `initial`")
    FOLD = (
        "the path from the start ended at a fold or a bifurcation",
        "no equilibrium continues this branch: reduce the load or the curvature, use the default formulation, "
        "or start from another equilibrium with `initial`",
    )
    STALLED = (
        "the path from the start could not be continued",
        "loosen the tolerance, reach the loads in steps with `initial`, or try formulation='energy'",
    )
    NEWTON_FAILED = (
        "Newton's method did not converge",
        "use the default method, or start from a nearer equilibrium with `initial`",
    )
    OPTIMIZER_FAILED = (
        "the energy minimization did not converge",
        "reach the loads in steps with `initial`, or use the default formulation",
    )
    NO_MINIMUM = (
        "the energy minimization found only saddles",
        "start from another equilibrium with `initial`, or use the default formulation",
    )
    UNSTABLE = (
        "only unstable equilibria were found",
        "the robot cannot stay there; `last_equilibrium` is one of them: start from another equilibrium with `initial`",
    )
    INACCURATE = (
        "the discretization did not reach the tolerance",
        "loosen the tolerance, or cut loads and curvatures with kinks into smooth pieces",
    )
