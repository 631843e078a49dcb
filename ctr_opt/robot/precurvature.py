"""Precurvature ``u*(sigma)`` of a tube, in pieces laid one behind the other.

``sigma`` is measured from the tube's base, ``u* = (u*_x, u*_y, u*_z)`` in the tube's own frame (z along the
tangent), in 1/m. A positive ``u*_x`` bends toward -y, a positive ``u*_y`` toward +x; ``u*_z`` is a
preset twist (paper, II-B).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Self, cast

import attrs
import numpy as np

from ..checks import ARRAY_EQ, Array, Checked, Entry, array, described, dimensions, unchecked
from ..errors import DefinitionError
from .piecewise import PiecewisePolynomial

_LENGTH = Entry("m", above=0.0)


class Piece(Checked):
    """A piece of a tube's preset shape. On each part ``u*`` is a polynomial, linear in the piece's rows."""

    __slots__ = ()

    rows: ClassVar[str] = ""
    """Name of the argument that holds the rows ``(k, 3)`` or ``(3,)``; empty if there is none and ``u*`` is zero."""

    length: Any

    def parts(self, rows: Sequence[Any], stretch: Any = 1.0) -> list[tuple[Any, list[Any]]]:
        """Lengths of the parts, with coefficients of powers of ``sigma`` counted from the start of each part.

        ``rows`` replace the piece's rows. They and the ``stretch`` of the length may be numbers, vectors or symbols.
        """
        return [(stretch * self.length, list(rows))]

    def polynomial(self) -> PiecewisePolynomial:
        """``u*`` along the piece."""
        rows = np.atleast_2d(getattr(self, self.rows)) if self.rows else np.zeros((1, 3))
        ((_, coefficients),) = self.parts(list(rows))
        return PiecewisePolynomial(np.array([0.0, self.length]), np.array(coefficients)[:, None, :])

    def stretched(self, length: float) -> Self:
        """Copy the piece with another length, in m."""
        return attrs.evolve(cast(Any, self), length=length)  # type: ignore[no-any-return]


class _Bend(Entry):
    """Entry for a curvature vector, or a scalar ``kappa`` for ``(kappa, 0, 0)``."""

    def checked(self, value: Any, field: str) -> Array:
        return array([value, 0.0, 0.0] if dimensions(value) == 0 else value, field, self.shape, unit=self.unit)


@attrs.frozen
class Straight(Piece):
    """A straight piece of a tube.

    Parameters
    ----------
    length
        Arc length, m.

    Examples
    --------
    >>> Straight(0.1).length
    0.1
    """

    kind = "straight"
    entries = described(length=_LENGTH)
    length: float = attrs.field(converter=unchecked)


@attrs.frozen
class Arc(Piece):
    """A piece of constant curvature: a circular arc, or a helix if ``u*_z`` is not zero.

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

    kind = "arc"
    entries = described(length=_LENGTH, curvature=_Bend("1/m", (3,), scalar_too=True))
    rows = "curvature"
    length: float = attrs.field(converter=unchecked)
    curvature: Array = attrs.field(converter=unchecked, eq=ARRAY_EQ, hash=False)


@attrs.frozen
class PolynomialCurvature(Piece):
    """A piece whose curvature is a polynomial of the arc length.

    ``u*(q) = sum_k coefficients[k] q^k`` with ``q`` in ``[0, 1]`` along the piece.

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

    kind = "polynomial"
    entries = described(length=_LENGTH, coefficients=Entry("1/m", (None, 3)))
    rows = "coefficients"
    length: float = attrs.field(converter=unchecked)
    coefficients: Array = attrs.field(converter=unchecked, eq=ARRAY_EQ, hash=False)

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        if len(self.coefficients) == 0:
            raise DefinitionError("coefficients has no row, but needs at least one row of three numbers in 1/m")

    def parts(self, rows: Sequence[Any], stretch: Any = 1.0) -> list[tuple[Any, list[Any]]]:
        """One part, whose rows multiply powers of ``sigma / length``."""
        length = stretch * self.length
        return [(length, [row / length**k for k, row in enumerate(rows)])]


@attrs.frozen
class SampledCurvature(Piece):
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

    kind = "sampled"
    entries = described(arc_length=Entry("m", (None,)), curvature=Entry("1/m", (None, 3)))
    csv = 4, {"arc_length": 0, "curvature": slice(1, 4)}
    rows = "curvature"
    arc_length: Array = attrs.field(eq=ARRAY_EQ, hash=False, converter=unchecked)
    curvature: Array = attrs.field(eq=ARRAY_EQ, hash=False, converter=unchecked)

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        samples = len(self.arc_length)
        if samples < 2:
            raise DefinitionError(f"arc_length has {samples} entries, but a sampled curvature must have at least 2")
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

    def parts(self, rows: Sequence[Any], stretch: Any = 1.0) -> list[tuple[Any, list[Any]]]:
        """Return one part between each two samples; the spline is linear in the samples."""
        from scipy.interpolate import CubicSpline

        basis = CubicSpline(self.arc_length, np.eye(len(self.arc_length))).c[::-1].transpose(1, 0, 2)
        return [
            (stretch * float(width), [_combined(row, rows) / stretch**d for d, row in enumerate(part)])
            for width, part in zip(np.diff(self.arc_length), basis, strict=True)
        ]

    def stretched(self, length: float) -> SampledCurvature:
        """Copy the piece with another length, in m; all samples move in proportion."""
        return attrs.evolve(self, arc_length=self.arc_length * (length / self.length))


def _combined(weights: Array, rows: Sequence[Any]) -> Any:
    return sum((float(weight) * row for weight, row in zip(weights, rows, strict=True)), 0.0)


PIECES = (Straight, Arc, PolynomialCurvature, SampledCurvature)


def as_pieces(value: Any) -> tuple[Piece, ...]:
    """Convert one piece, or several in order from base to tip, to a tuple."""
    pieces = (value,) if isinstance(value, Piece) else value
    if not isinstance(pieces, (list, tuple)) or not pieces:
        raise DefinitionError(f"precurvature = {value!r} must be a piece or a non-empty list of pieces")
    for k, piece in enumerate(pieces):
        if not isinstance(piece, Piece):
            names = ", ".join(kind.__name__ for kind in PIECES)
            raise DefinitionError(f"precurvature[{k}] = {piece!r} must be one of {names}")
    return tuple(pieces)
