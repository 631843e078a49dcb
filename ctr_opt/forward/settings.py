"""What a forward problem is told: formulations, the methods that belong to them, and everything else at once."""

from __future__ import annotations

from typing import TypeAlias

import attrs

from ..solvers.homotopy import Homotopy
from ..solvers.ipopt import Ipopt
from ..solvers.newton import Newton
from ..transcription.schemes import Transcription

Method: TypeAlias = Newton | Homotopy | Ipopt
METHODS: dict[str, tuple[type[Newton] | type[Homotopy] | type[Ipopt], ...]] = {
    "automatic": (Homotopy,),
    "energy": (Ipopt,),
    "equilibrium": (Homotopy, Newton, Ipopt),
}
METHOD_NAMES: dict[str, type[Newton] | type[Homotopy] | type[Ipopt]] = {
    "homotopy": Homotopy,
    "newton": Newton,
    "ipopt": Ipopt,
}


@attrs.frozen
class Settings:
    """What a :class:`~ctr_opt.ForwardProblem` was told."""

    formulation: str
    method: Method
    tolerance: float
    integrator: str
    transcription: Transcription

    @property
    def residual_tolerance(self) -> float:
        """Of the scaled boundary residual: far below what the position tolerance needs."""
        return min(1e-9, max(1e-12, 1e-4 * self.tolerance))

    @property
    def compiled_residual(self) -> float:
        """The same for compiled solves, which count what is left in their error: at most a tenth of the tolerance."""
        return min(1e-8, max(1e-12, 0.1 * self.tolerance))

    @property
    def ipopt(self) -> Ipopt:
        """The method, where IPOPT is at work."""
        return self.method if isinstance(self.method, Ipopt) else Ipopt()

    @property
    def homotopy(self) -> Homotopy:
        """The method, where a homotopy is at work."""
        return self.method if isinstance(self.method, Homotopy) else Homotopy()

    @property
    def compilable(self) -> bool:
        """Whether the compiled solver does what these settings say."""
        return self.formulation != "energy" and self.integrator == "RK8" and self.method == Homotopy()
