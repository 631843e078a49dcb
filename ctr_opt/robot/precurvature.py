"""The preset shape of a tube, ``u*(sigma)``, in pieces laid one behind the other.

``sigma`` is measured from the tube's base, ``u* = (u*_x, u*_y, u*_z)`` in the tube's own frame (z along the
tangent), in 1/m. A positive ``u*_x`` bends toward -y, a positive ``u*_y`` toward +x; ``u*_z`` is a
preset twist (paper, II-B).
"""

from __future__ import annotations

from typing import Any, TypeAlias

import attrs
import numpy as np

from ..checks import ARRAY_EQ, Array, array, number
from ..errors import DefinitionError
from .piecewise import PiecewisePolynomial


def _length(value: Any) -> float:
    return number(value, "length", above=0.0, unit="m")


def _curvature(value: Any) -> Array:
    return array([value, 0.0, 0.0] if np.ndim(value) == 0 else value, "curvature", (3,), unit="1/m")


def _coefficients(value: Any) -> Array:
    rows = array(value, "coefficients", (None, 3), unit="1/m")
    if len(rows) == 0:
        raise DefinitionError("coefficients has no row, but needs at least one row of three numbers in 1/m")
    return rows


def _sample_points(value: Any) -> Array:
    return array(value, "arc_length", (None,), unit="m")


def _samples(value: Any) -> Array:
    return array(value, "curvature", (None, 3), unit="1/m")


@attrs.frozen
class Straight:
    """A straight piece of the given length (m).

    >>> Straight(0.1).length
    0.1
    """

    length: float = attrs.field(converter=_length)

    def polynomial(self) -> PiecewisePolynomial:
        """``u*`` along the piece."""
        return _one_piece(self.length, np.zeros((1, 3)))


@attrs.frozen
class Arc:
    """A piece of constant curvature vector: a circular arc, or a helix where ``u*_z`` is not zero.

    Parameters
    ----------
    length
        Arc length, m.
    curvature
        1/m; a scalar kappa means ``(kappa, 0, 0)``, which bends toward -y.

    Examples
    --------
    >>> Arc(0.05, 10.0).curvature
    array([10.,  0.,  0.])
    """

    length: float = attrs.field(converter=_length)
    curvature: Array = attrs.field(converter=_curvature, eq=ARRAY_EQ, hash=False)

    def polynomial(self) -> PiecewisePolynomial:
        """``u*`` along the piece."""
        return _one_piece(self.length, self.curvature[None, :])


@attrs.frozen
class PolynomialCurvature:
    """``u*(q) = sum_k coefficients[k] q^k`` with ``q`` in ``[0, 1]`` along the piece.

    Parameters
    ----------
    length
        Arc length, m.
    coefficients
        Shape ``(k, 3)``, 1/m: row ``k`` multiplies ``q^k``.

    Examples
    --------
    A curvature that grows from 5 to 8 1/m:

    >>> PolynomialCurvature(0.1, [[0, 5, 0], [0, 3, 0]]).coefficients.shape
    (2, 3)
    """

    length: float = attrs.field(converter=_length)
    coefficients: Array = attrs.field(converter=_coefficients, eq=ARRAY_EQ, hash=False)

    def polynomial(self) -> PiecewisePolynomial:
        """``u*`` along the piece."""
        return _one_piece(self.length, np.array(along_arc_length(list(self.coefficients), self.length)))


@attrs.frozen
class SampledCurvature:
    """Measured curvature, interpolated by a cubic spline (not-a-knot; linear and parabolic for 2 and 3 samples).

    Parameters
    ----------
    arc_length
        Shape ``(k,)``, m, increasing, ``k >= 2``; starts at 0, its last entry is the piece's length.
    curvature
        Shape ``(k, 3)``, 1/m.

    Examples
    --------
    >>> SampledCurvature([0.0, 0.02, 0.05], [[0, 5, 0], [0, 6, 0], [0, 8, 0]]).length
    0.05
    """

    arc_length: Array = attrs.field(eq=ARRAY_EQ, hash=False, converter=_sample_points)
    curvature: Array = attrs.field(eq=ARRAY_EQ, hash=False, converter=_samples)

    def __attrs_post_init__(self) -> None:
        samples = len(self.arc_length)
        if samples < 2:
            raise DefinitionError(f"arc_length has {samples} entries, but a sampled curvature needs at least 2")
        if self.arc_length[0] != 0.0:
            raise DefinitionError(f"arc_length[0] = {self.arc_length[0]:g} m must be 0, the start of the piece")
        steps = np.diff(self.arc_length)
        if np.any(steps <= 0.0):
            k = int(np.argmax(steps <= 0.0)) + 1
            raise DefinitionError(
                f"arc_length[{k}] = {self.arc_length[k]:g} m must be above arc_length[{k - 1}] = "
                f"{self.arc_length[k - 1]:g} m"
            )
        if len(self.curvature) != samples:
            raise DefinitionError(f"curvature has {len(self.curvature)} rows, but arc_length has {samples} entries")

    @property
    def length(self) -> float:
        """Arc length of the piece, m."""
        return float(self.arc_length[-1])

    def polynomial(self) -> PiecewisePolynomial:
        """``u*`` along the piece."""
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(self.arc_length, self.curvature)
        return PiecewisePolynomial(np.asarray(spline.x, dtype=np.float64), np.asarray(spline.c[::-1], dtype=np.float64))

    def basis(self) -> Array:
        """The spline's coefficients ``(4, k - 1, k)`` for a unit value at each of the ``k`` samples: it is linear."""
        from scipy.interpolate import CubicSpline

        return np.asarray(CubicSpline(self.arc_length, np.eye(len(self.arc_length))).c[::-1], dtype=np.float64)


PrecurvaturePiece: TypeAlias = Straight | Arc | PolynomialCurvature | SampledCurvature
PIECES = (Straight, Arc, PolynomialCurvature, SampledCurvature)


def as_pieces(value: Any) -> tuple[PrecurvaturePiece, ...]:
    """One piece, or several in the order from base to tip, as a tuple."""
    pieces = (value,) if isinstance(value, PIECES) else value
    if not isinstance(pieces, (list, tuple)) or not pieces:
        raise DefinitionError(f"precurvature = {value!r} must be a piece or a non-empty list of pieces")
    for k, piece in enumerate(pieces):
        if not isinstance(piece, PIECES):
            names = ", ".join(kind.__name__ for kind in PIECES)
            raise DefinitionError(f"precurvature[{k}] = {piece!r} must be one of {names}")
    return tuple(pieces)


def along_arc_length(coefficients: list[Any], length: Any) -> list[Any]:
    """Rows that multiply powers of ``q = sigma / length`` as rows that multiply powers of ``sigma``."""
    return [row / length**k for k, row in enumerate(coefficients)]


def _one_piece(length: float, coefficients: Array) -> PiecewisePolynomial:
    return PiecewisePolynomial(np.array([0.0, length]), np.asarray(coefficients)[:, None, :])
