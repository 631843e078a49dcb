"""Newton's method for a small square system; every iterate is checked for size and finiteness."""

from __future__ import annotations

from typing import Protocol

import attrs
import numpy as np

from ..checks import Array, bounded, counted
from ..transcription.closure import NEGLIGIBLE, newton_correction


class System(Protocol):
    """A square system: residual and Jacobian at ``z``."""

    def linearize(self, z: Array) -> tuple[Array, Array]:
        """Residual ``(k,)`` and Jacobian ``(k, k)``."""
        ...


_ROUNDING = 1e-13  # corrections below this, relative to the unknowns, are rounding errors ...
_ROUNDED = 1e-6  # ... which a flexible robot amplifies to residuals up to this
_POSITIVE = bounded(above=0.0)


@attrs.frozen
class Newton:
    """Newton's method with a monotonicity test.

    Parameters
    ----------
    max_iterations
        Largest number of iterations.
    contraction
        A step is halved until the norm of the simplified Newton correction falls below this factor times the last
        correction (Deuflhard's natural monotonicity test).
    shortest_step
        The smallest damping factor tried.
    negligible
        Singular values of the Jacobian below this count as zero; no step is made in their directions.

    Raises
    ------
    DefinitionError
        A value that is not positive.

    Examples
    --------
    >>> Newton(max_iterations=50).contraction
    1.0
    """

    max_iterations: int = attrs.field(default=30, validator=counted(1))
    contraction: float = attrs.field(default=1.0, validator=_POSITIVE)
    shortest_step: float = attrs.field(default=1e-3, validator=_POSITIVE)
    negligible: float = attrs.field(default=NEGLIGIBLE, validator=_POSITIVE)


@attrs.frozen(eq=False)
class NewtonResult:
    """The end of Newton's method: ``z``, the residual and Jacobian there, and whether it converged."""

    z: Array
    residual: Array
    jacobian: Array
    iterations: int
    converged: bool
    reason: str = ""

    @property
    def residual_norm(self) -> float:
        """Largest entry of the residual; infinite if it is not finite."""
        size = float(np.abs(self.residual).max())
        return size if np.isfinite(size) else np.inf


def newton(system: System, z: Array, tolerance: float, method: Newton = Newton()) -> NewtonResult:
    """Solve ``residual(z) = 0`` from ``z`` down to ``tolerance`` (largest entry)."""
    residual, jacobian = system.linearize(z)
    iterations = 0
    while True:
        if not (np.all(np.isfinite(residual)) and np.all(np.isfinite(jacobian))):
            return NewtonResult(z, residual, jacobian, iterations, False, "the residual is not finite")
        correction = newton_correction(jacobian, residual, method.negligible)
        size, change = np.abs(residual).max(), np.linalg.norm(correction)
        if size <= tolerance or (size <= _ROUNDED and change <= _ROUNDING * (1.0 + np.linalg.norm(z))):
            return NewtonResult(z, residual, jacobian, iterations, True)
        if iterations == method.max_iterations:
            return NewtonResult(z, residual, jacobian, iterations, False, f"no convergence in {iterations} iterations")
        step = 1.0
        while True:
            trial = z + step * correction
            new_residual, new_jacobian = system.linearize(trial)
            if np.all(np.isfinite(new_residual)) and np.all(np.isfinite(new_jacobian)):
                following = np.linalg.norm(newton_correction(jacobian, new_residual, method.negligible))
                if following <= max(
                    (1.0 - 0.5 * step) * method.contraction * change, _ROUNDING * (1.0 + np.linalg.norm(z))
                ):
                    break
            step *= 0.5
            if step < method.shortest_step:
                return NewtonResult(z, residual, jacobian, iterations, False, "no step decreased the residual")
        z, residual, jacobian = trial, new_residual, new_jacobian
        iterations += 1
