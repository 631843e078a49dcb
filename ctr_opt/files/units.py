"""Numbers in files with units as text, ``"1.75 mm"``; a bare number is SI."""

from __future__ import annotations

import difflib
import re
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pint

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S.*)?")
_NAME = r"[A-Za-zµμ°]{1,20}(?:\s*(?:\^|\*\*)\s*-?[1-4])?"
_UNIT = re.compile(rf"(?:1\s*/\s*)?{_NAME}(?:\s*[*/ ]\s*{_NAME}){{0,5}}")
_COMMON = (
    "m",
    "mm",
    "cm",
    "um",
    "rad",
    "deg",
    "mrad",
    "N",
    "mN",
    "Pa",
    "MPa",
    "GPa",
    "N*m",
    "N*mm",
    "mN*m",
    "N/m",
    "N/mm",
)
_ANGLES = ("radian", "degree", "turn", "grade", "arcminute", "arcsecond")
_KINDS = {
    "m": "a length, like '1.75 mm'",
    "rad": "an angle, like '30 deg'",
    "N": "a force, like '0.98 N'",
    "N m": "a moment, like '5 N*mm'",
    "N/m": "a force per length, like '2 N/m'",
    "N m/m": "a moment per length, like '0.1 N*m/m'",
    "1/m": "a curvature, like '12 1/m'",
    "Pa": "a modulus, like '58 GPa'",
    "kg/m^3": "a density, like '6450 kg/m^3'",
    "m^5/N^2": "a smoothness, like '0.1 m^5/N^2'",
    "kg": "a mass, like '2 g'",
    "kg/m": "a mass per length, like '0.3 kg/m'",
    "1": "a number",
    "m/s^2": "an acceleration, like '9.81 m/s^2'",
    "N m^2": "a stiffness, like '0.02 N*m^2'",
}


def to_si(value: Any, unit: str) -> float:
    """Convert a number in SI, or a text with a unit, to ``unit``.

    ``ValueError`` describes the problem in the second half of a sentence.

    >>> to_si("1.75 mm", "m"), to_si(2, "m")
    (0.00175, 2.0)
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError(f"must be {_meaning(unit)}, or a number in {unit}")
    if not isinstance(value, str):
        return _finite(value, unit)
    if unit == "1":
        raise ValueError("must be a number")
    match = _NUMBER.fullmatch(value)
    if match is None:
        raise ValueError(f"must be {_meaning(unit)}, or a number in {unit}")
    number, text = float(match[1]), match[2]
    if text is None:
        return _finite(number, unit)
    if text.startswith(","):
        raise ValueError("has a comma where a number must have a point")
    return _finite(number * _factor(text.strip(), unit), unit)


def _meaning(unit: str) -> str:
    return _KINDS.get(unit, f"a number with a unit of {unit}")


def _finite(value: float, unit: str) -> float:
    if not abs(value) < 1e30:
        raise ValueError(f"must be a finite number in {unit}")
    return float(value)


@cache
def _registry() -> pint.UnitRegistry[Any]:
    import pint

    return pint.UnitRegistry()


@cache
def _factor(text: str, unit: str) -> float:
    import pint

    if not _UNIT.fullmatch(text):
        raise ValueError(f"has the unknown unit {text!r}{_nearest(text)}")
    registry = _registry()
    try:
        parsed = registry.parse_units(text)
        factor = float(registry.Quantity(1.0, parsed).to(unit).magnitude)
    except pint.DimensionalityError:
        raise ValueError(f"must be {_meaning(unit)}, but has the unit {text!r}") from None
    except Exception:
        raise ValueError(f"has the unknown unit {text!r}{_nearest(text)}") from None
    if unit == "rad" and not set(_ANGLES) & {
        name.removeprefix("milli").removeprefix("micro") for name in parsed._units
    }:
        raise ValueError(f"must be {_meaning(unit)}, but has the unit {text!r}")
    return factor


def _nearest(text: str) -> str:
    near = difflib.get_close_matches(text, _COMMON, n=1, cutoff=0.3)
    return f" (did you mean {near[0]!r}?)" if near else ""
