"""One precurved elastic tube."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import attrs

from ..checks import Checked, Entry, described, number
from ..errors import DefinitionError
from .piecewise import PiecewisePolynomial
from .precurvature import Piece, as_pieces

# Formulas in diameters and moduli, for numbers and symbols alike.


def second_moment(outer_diameter: Any, inner_diameter: Any) -> Any:
    """Second moment of area, ``I = pi (D^4 - d^4) / 64``, m^4."""
    return math.pi * (outer_diameter**4 - inner_diameter**4) / 64.0


def cross_section(outer_diameter: Any, inner_diameter: Any) -> Any:
    """Area of the cross-section, ``pi (D^2 - d^2) / 4``, m^2."""
    return math.pi * (outer_diameter**2 - inner_diameter**2) / 4.0


def shear_modulus(youngs_modulus: Any, poisson_ratio: Any) -> Any:
    """Shear modulus from Young's modulus and Poisson's ratio, ``G = E / (2 (1 + nu))``, Pa."""
    return youngs_modulus / (2.0 * (1.0 + poisson_ratio))


def torsional_stiffness(shear: Any, moment_of_area: Any) -> Any:
    """Torsional stiffness, ``GJ = 2 G I``, N m^2."""
    return shear * 2.0 * moment_of_area


Numbers = Callable[[str], Any]
"""A lookup of a tube's moduli and diameters by name; None for a number that is not given."""


def _bending(of: Numbers) -> Any:
    young = of("youngs_modulus")
    return None if young is None else young * second_moment(of("outer_diameter"), of("inner_diameter"))


def _torsional(of: Numbers) -> Any:
    shear = of("shear_modulus")
    if shear is None:
        young, ratio = of("youngs_modulus"), of("poisson_ratio")
        if young is None or ratio is None:
            return None
        shear = shear_modulus(young, ratio)
    return torsional_stiffness(shear, second_moment(of("outer_diameter"), of("inner_diameter")))


STIFFNESSES: dict[str, Callable[[Numbers], Any]] = {"bending_stiffness": _bending, "torsional_stiffness": _torsional}
"""Rule for each stiffness that is not given directly; None if a number that it needs is missing."""


def _inputs_of(name: str, of: Numbers) -> tuple[str, ...]:
    """Names of the numbers from which the rule computes a stiffness."""
    names = []

    def number(field: str) -> Any:
        names.append(field)
        return of(field)

    STIFFNESSES[name](number)
    return tuple(names)


SOURCES = frozenset(
    field for name in STIFFNESSES for field in _inputs_of(name, lambda field: None if field == "shear_modulus" else 1.0)
)
"""The moduli, ratios and diameters from which stiffnesses follow."""


_MODULUS, _STIFFNESS = Entry("Pa", above=0.0, optional=True), Entry("N m^2", above=0.0, optional=True)


@attrs.frozen(kw_only=False)
class Tube(Checked):
    """A tube: its cross-section, its material and its preset shape.

    Stiffnesses follow from the diameters and moduli, ``EI = E pi (D^4 - d^4) / 64`` and ``GJ = 2 G I``
    (paper, (3)). A stiffness that is given directly takes precedence. The tube's length is the sum of its pieces'.

    Parameters
    ----------
    name
        Name for messages, reports and files.
    outer_diameter, inner_diameter
        m, ``0 <= inner_diameter < outer_diameter``.
    precurvature
        A piece, or the pieces from base to tip: :class:`Straight`, :class:`Arc`,
        :class:`PolynomialCurvature`, :class:`SampledCurvature`.
    youngs_modulus, shear_modulus
        Pa; may be omitted when the stiffnesses are given.
    poisson_ratio
        Alternative to the shear modulus: ``G = E / (2 (1 + nu))``, ``-1 < nu <= 0.5``.
    density
        kg/m^3, for :class:`Gravity`.
    bending_stiffness, torsional_stiffness
        ``EI`` and ``GJ``, N m^2.

    Raises
    ------
    DefinitionError
        A value is out of range or missing; the message names the tube, the field, its value and what is allowed.

    Examples
    --------
    >>> import ctr_opt as ctr
    >>> pieces = [ctr.Straight(0.2), ctr.Arc(0.1, 7.0)]
    >>> tube = ctr.Tube("inner", 1.75e-3, 1.25e-3, pieces, youngs_modulus=58e9, poisson_ratio=0.3)
    >>> round(tube.bending_stiffness, 5), round(tube.length, 3)
    (0.01975, 0.3)
    """

    entries = described(
        outer_diameter=Entry("m", above=0.0),
        inner_diameter=Entry("m", least=0.0),
        youngs_modulus=_MODULUS,
        shear_modulus=_MODULUS,
        poisson_ratio=Entry("1", above=-1.0, most=0.5, optional=True),
        density=Entry("kg/m^3", least=0.0),
        bending_stiffness=_STIFFNESS,
        torsional_stiffness=_STIFFNESS,
    )
    name: str
    outer_diameter: float
    inner_diameter: float
    precurvature: tuple[Piece, ...]
    youngs_modulus: float | None = None
    shear_modulus: float | None = None
    poisson_ratio: float | None = None
    density: float = 0.0
    _bending_stiffness: float | None = None
    _torsional_stiffness: float | None = None
    shape: PiecewisePolynomial = attrs.field(init=False, eq=False, repr=False)

    def __attrs_post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise DefinitionError(f"tube name = {self.name!r} must be a non-empty text")
        try:
            super().__attrs_post_init__()
            self._check()
        except DefinitionError as error:
            raise DefinitionError(f"tube {self.name!r}: {error}") from None

    def _check(self) -> None:
        if self.inner_diameter >= self.outer_diameter:
            raise DefinitionError(
                f"inner_diameter = {self.inner_diameter:g} m must be below outer_diameter = {self.outer_diameter:g} m"
            )
        if self.poisson_ratio is not None and self.shear_modulus is not None:
            raise DefinitionError(
                f"shear_modulus = {self.shear_modulus:g} Pa and poisson_ratio = {self.poisson_ratio:g} "
                "are both given: give one of them"
            )
        if self.youngs_modulus is None and self._bending_stiffness is None:
            raise DefinitionError("youngs_modulus is missing: give it, in Pa, or bending_stiffness, in N m^2")
        if self._stiffness("torsional_stiffness") is None:
            raise DefinitionError(
                "shear_modulus is missing: give it, in Pa, or poisson_ratio with youngs_modulus, "
                "or torsional_stiffness, in N m^2"
            )
        for name in STIFFNESSES:
            number(getattr(self, name), f"{name} of these diameters and moduli", above=0.0, unit="N m^2")
        object.__setattr__(self, "precurvature", as_pieces(self.precurvature))
        object.__setattr__(self, "shape", PiecewisePolynomial.join([piece.polynomial() for piece in self.precurvature]))

    def _stiffness(self, name: str) -> Any:
        direct = getattr(self, f"_{name}")
        return direct if direct is not None else STIFFNESSES[name](lambda field: getattr(self, field))

    def sources(self, name: str) -> tuple[str, ...]:
        """Moduli, ratios and diameters from which a stiffness of this tube follows, unless it is given directly."""
        return _inputs_of(name, lambda field: getattr(self, field))

    @property
    def second_moment(self) -> float:
        """Second moment of area ``I``, m^4."""
        return float(second_moment(self.outer_diameter, self.inner_diameter))

    @property
    def mass_per_length(self) -> float:
        """Mass per arc length, ``density pi (D^2 - d^2) / 4``, kg/m."""
        return self.density * float(cross_section(self.outer_diameter, self.inner_diameter))

    @property
    def bending_stiffness(self) -> float:
        """Bending stiffness ``EI``, N m^2."""
        return float(self._stiffness("bending_stiffness"))

    @property
    def torsional_stiffness(self) -> float:
        """Torsional stiffness ``GJ``, N m^2."""
        return float(self._stiffness("torsional_stiffness"))

    @property
    def length(self) -> float:
        """Arc length from base to tip, m."""
        return float(self.shape.breaks[-1])

    @property
    def given_stiffnesses(self) -> dict[str, float]:
        """The stiffnesses that were given directly, by their argument names."""
        direct = {name: getattr(self, f"_{name}") for name in STIFFNESSES}
        return {name: value for name, value in direct.items() if value is not None}
