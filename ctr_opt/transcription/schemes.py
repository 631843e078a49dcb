"""Transcriptions of differential equations as values, and their tableaus."""

from __future__ import annotations

from functools import cache
from typing import Any, TypeAlias

import attrs
import casadi as ca
import numpy as np

from ..checks import Array, choice
from ..errors import DefinitionError

SCHEMES = ("legendre", "radau")
_HIGHEST = 9  # degree; CasADi's tables of collocation points end there


def _degree(scheme: Any, field: attrs.Attribute[Any], value: Any) -> None:
    if value is None and field.default is None:
        return
    if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= _HIGHEST:
        name = f"{type(scheme).__name__}.{field.name}"
        raise DefinitionError(f"{name} = {value!r} must be a whole number from 1 to {_HIGHEST}")


def _scheme(_: Any, field: attrs.Attribute[Any], value: Any) -> None:
    choice(value, f"Collocation.{field.name}", SCHEMES)


@attrs.frozen
class Collocation:
    """A collocation transcription: the equations hold at ``degree`` points of every step.

    Parameters
    ----------
    degree
        Number of collocation points in each step, 1 to 9.
    scheme
        ``"legendre"``: Gauss-Legendre points, of order ``2 degree`` at the nodes. ``"radau"``: Radau IIA points, of
        order ``2 degree - 1``, which include the end of the step.

    Raises
    ------
    DefinitionError
        A degree out of range, or an unknown scheme.

    Examples
    --------
    >>> Collocation(3, scheme="radau").order
    5
    """

    degree: int = attrs.field(default=4, validator=_degree)
    scheme: str = attrs.field(default="legendre", validator=_scheme)

    @property
    def order(self) -> int:
        """Order of the error at the nodes, as a power of the step length."""
        return 2 * self.degree - (self.scheme == "radau")


@attrs.frozen
class MultipleShooting:
    """A multiple-shooting transcription: the problem's Runge-Kutta method integrates every step.

    Parameters
    ----------
    degree
        For the energy formulation only: in every step the curvatures are polynomials, given at ``degree``
        Gauss-Legendre points. Default: half the order of the integrator, rounded up, so that neither limits the other.

    Raises
    ------
    DefinitionError
        A degree out of range.

    Examples
    --------
    >>> MultipleShooting().degree is None
    True
    """

    degree: int | None = attrs.field(default=None, validator=_degree)


Transcription: TypeAlias = Collocation | MultipleShooting


@attrs.frozen(eq=False)
class Tableau:
    """Points in ``(0, 1]``, weights, and the matrix that integrates the collocation polynomial from 0 to each point."""

    nodes: Array
    weights: Array
    matrix: Array

    def collocated(self, x: Any, inner: Any, slopes: Any) -> tuple[Any, Any]:
        """Defects of the states inside a step from ``x``, and the state at its end; ``slopes`` times its length."""
        defects = ca.repmat(x, 1, len(self.nodes)) + slopes @ ca.DM(self.matrix.T) - inner
        return defects, x + slopes @ ca.DM(self.weights)


@cache
def tableau(degree: int, scheme: str = "legendre") -> Tableau:
    """The tableau of a collocation method."""
    nodes = np.array(ca.collocation_points(degree, scheme))
    powers = np.arange(degree)
    vandermonde = nodes[:, None] ** powers
    matrix = np.linalg.solve(vandermonde.T, (nodes[:, None] ** (powers + 1) / (powers + 1)).T).T
    weights = np.linalg.solve(vandermonde.T, 1.0 / (powers + 1))
    return Tableau(nodes, np.asarray(weights, dtype=np.float64), np.asarray(matrix, dtype=np.float64))


def interpolation(nodes: Array, points: Array) -> Array:
    """The matrix from values at ``nodes`` to values of their polynomial at ``points``."""
    powers = np.arange(len(nodes))
    return np.asarray(np.linalg.solve((nodes[:, None] ** powers).T, (points[:, None] ** powers).T).T)
