"""The settings of a forward problem: formulation, method, accuracy, discretization."""

from __future__ import annotations

from typing import Any, TypeAlias

import attrs

from ..checks import choice, number
from ..errors import DefinitionError
from ..solvers.homotopy import Homotopy
from ..solvers.ipopt import Ipopt
from ..solvers.newton import Newton
from ..transcription.integrators import INTEGRATORS
from ..transcription.schemes import Collocation, MultipleShooting, Transcription

Method: TypeAlias = Newton | Homotopy | Ipopt
_KINDS: tuple[type[Method], ...] = (Homotopy, Newton, Ipopt)
_METHODS: dict[str, tuple[type[Method], ...]] = {"automatic": (Homotopy,), "energy": (Ipopt,), "equilibrium": _KINDS}
_NAMES = {kind.__name__.lower(): kind for kind in _KINDS}


@attrs.frozen
class Settings:
    """The checked settings of a :class:`~ctr_opt.ForwardProblem`."""

    formulation: str
    method: Method
    tolerance: float
    integrator: str
    transcription: Transcription

    @classmethod
    def of(
        cls, formulation: Any, method: Any, tolerance: Any, integrator: Any, transcription: Transcription | None
    ) -> Settings:
        """Settings from the arguments of a :class:`~ctr_opt.ForwardProblem`, checked."""
        if not isinstance(transcription, (Collocation, MultipleShooting, type(None))):
            raise DefinitionError(f"transcription = {transcription!r} must be a Collocation or a MultipleShooting")
        return cls(
            *_method(formulation, method, transcription),
            number(tolerance, "tolerance", least=1e-11, most=1e-2),
            choice(integrator, "integrator", INTEGRATORS),
            transcription or Collocation(),
        )

    @property
    def residual_tolerance(self) -> float:
        """Tolerance of the scaled boundary residual, far below what the position tolerance needs."""
        return min(1e-9, max(1e-12, 1e-4 * self.tolerance))

    @property
    def compiled_residual(self) -> float:
        """Tolerance of the residual in compiled solves, which include the rest in their error estimate."""
        return min(1e-8, max(1e-12, 0.1 * self.tolerance))

    @property
    def ipopt(self) -> Ipopt:
        """The options of IPOPT, chosen or default."""
        return self.method if isinstance(self.method, Ipopt) else Ipopt()

    @property
    def homotopy(self) -> Homotopy:
        """The options of the homotopy, chosen or default."""
        return self.method if isinstance(self.method, Homotopy) else Homotopy()

    @property
    def compilable(self) -> bool:
        """Whether the compiled solver supports these settings."""
        return self.formulation != "energy" and self.integrator == "RK8" and self.method == Homotopy()


def _method(formulation: Any, method: Any, transcription: Transcription | None) -> tuple[str, Method]:
    """Formulation and method; a missing one follows from the other."""
    allowed = _METHODS[choice(formulation, "formulation", tuple(_METHODS))]
    if isinstance(method, str):
        method = _NAMES[choice(method, "method", tuple(_NAMES))]()
    if method is None:
        by_default = Ipopt if formulation == "equilibrium" and transcription is not None else allowed[0]
        return formulation, by_default()
    if formulation == "automatic" and not isinstance(method, allowed):
        formulation = next((name for name, kinds in _METHODS.items() if isinstance(method, kinds)), formulation)
        allowed = _METHODS[formulation]
    if not isinstance(method, allowed):
        names = " or ".join(kind.__name__ for kind in allowed)
        raise DefinitionError(f"method = {method!r} must be {names} with formulation = {formulation!r}")
    if formulation == "equilibrium" and transcription is not None and not isinstance(method, Ipopt):
        raise DefinitionError(
            f"transcription = {transcription!r} requires method = Ipopt(...), but method is {type(method).__name__}, "
            "which shoots: leave out one of them"
        )
    return formulation, method
