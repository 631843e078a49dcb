"""Checks of user input: each returns the clean value or raises a one-sentence ``DefinitionError``.

What a value must be is stated once, as an :class:`Entry`: constructors check by it, files are read by it, and reports
take its unit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Any, ClassVar, cast

import attrs
import numpy as np
from numpy.typing import NDArray

from .errors import DefinitionError

Array = NDArray[np.float64]
ARRAY_EQ = attrs.cmp_using(eq=np.array_equal)
"""Equality of a field that holds an array."""
_LARGEST = 1e30  # in SI: no length, modulus or force is larger, and none overflows
_ROTATION_TOLERANCE = 1e-6


def number(
    value: Any,
    field: str,
    *,
    above: float | None = None,
    least: float | None = None,
    most: float | None = None,
    unit: str = "",
) -> float:
    """``value`` as a finite float with ``above < value``, ``least <= value <= most``."""
    allowed = _range(above, least, most, unit)
    try:
        if isinstance(value, (bool, str, bytes)):
            raise TypeError
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise DefinitionError(f"{field} = {value!r} must be {allowed}") from None
    inside = (
        abs(result) <= _LARGEST
        and (above is None or result > above)
        and (least is None or result >= least)
        and (most is None or result <= most)
    )
    if not inside:
        raise DefinitionError(f"{field} = {result:g}{_spaced(unit)} must be {allowed}")
    return result


def bounded(
    above: float | None = None, least: float | None = None, most: float | None = None
) -> Callable[[Any, attrs.Attribute[Any], Any], None]:
    """A validator of a field that holds a :func:`number`."""

    def validate(instance: Any, field: attrs.Attribute[Any], value: Any) -> None:
        number(value, f"{type(instance).__name__}.{field.name}", above=above, least=least, most=most)

    return validate


def array(
    value: Any, field: str, shape: tuple[int | None, ...], *, above: float | None = None, unit: str = ""
) -> Array:
    """``value`` as a finite, read-only float array above a bound; ``None`` in ``shape`` stands for any size."""
    try:
        given = np.array(value)
        if given.dtype.kind not in "iuf":
            raise TypeError
        result = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise DefinitionError(f"{field} = {_short(value)} must be numbers of shape {_wanted(shape)}") from None
    if result.shape != shape and (
        result.ndim != len(shape) or any(size not in (None, got) for size, got in zip(shape, result.shape, strict=True))
    ):
        raise DefinitionError(f"{field} has shape {result.shape}, but must have shape {_wanted(shape)}")
    if not (np.abs(result) <= _LARGEST).all():
        entry, bad = _first(np.abs(result) <= _LARGEST, result)
        raise DefinitionError(f"{field}[{entry}] = {bad} must be a finite number{_in(unit)}")
    if above is not None and not (result > above).all():
        entry, bad = _first(result > above, result)
        raise DefinitionError(f"{field}[{entry}] = {bad:g}{_spaced(unit)} must be above {above:g}")
    result.setflags(write=False)
    return result


def direction(value: Any, field: str) -> Array:
    """``value`` as a unit vector ``(3,)``, given at any length but zero."""
    given = array(value, field, (3,))
    size = float(np.linalg.norm(given))
    if size == 0.0:
        raise DefinitionError(f"{field} = {given.tolist()} is zero, but must be a direction")
    return given / size


def rigid(value: Any, field: str) -> Array:
    """``value`` as a pose ``(4, 4)``, its rotation accepted up to rounding of 1e-6 and made exact."""
    pose = np.array(array(value, field, (4, 4)))
    if not np.array_equal(pose[3], [0.0, 0.0, 0.0, 1.0]):
        raise DefinitionError(f"{field}: the last row {pose[3].tolist()} must be [0, 0, 0, 1]")
    rotation = pose[:3, :3]
    defect = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    determinant = float(np.linalg.det(rotation))
    if defect > _ROTATION_TOLERANCE or determinant < 0.0:
        raise DefinitionError(
            f"{field}: the upper left 3 x 3 block is no rotation (R^T R differs from the identity by {defect:.2g}, "
            f"allowed {_ROTATION_TOLERANCE:g}; det R = {determinant:.6g}, must be 1)"
        )
    left, _, right = np.linalg.svd(rotation)
    pose[:3, :3] = left @ right
    pose.setflags(write=False)
    return pose


def choice(value: Any, field: str, allowed: Iterable[str]) -> str:
    """``value`` if it is one of ``allowed``."""
    if not isinstance(value, str) or value not in tuple(allowed):
        names = " or ".join(repr(name) for name in allowed)
        raise DefinitionError(f"{field} = {value!r} must be {names}")
    return value


def flag(value: Any, field: str) -> bool:
    """``value`` if it is True or False."""
    if not isinstance(value, bool):
        raise DefinitionError(f"{field} = {value!r} must be True or False")
    return value


def whole(value: Any, field: str, least: int, most: float = np.inf, *, meaning: str = "") -> int:
    """``value`` as an integer ``least <= value <= most``; ``meaning`` is what an error says that it must be."""
    try:
        if isinstance(value, bool) or int(value) != value or not least <= value <= most:
            raise ValueError
        return int(value)
    except (TypeError, ValueError, OverflowError):
        wanted = meaning or f"a whole number, at least {least}" + (f" and at most {most}" if most < np.inf else "")
        raise DefinitionError(f"{field} = {value!r} must be {wanted}") from None


def index(value: Any, field: str, size: int | None = None) -> int:
    """``value`` as an index ``0 <= value < size``."""
    top, most = ("", np.inf) if size is None else (f" from 0 to {size - 1}", size - 1)
    return whole(value, field, 0, most, meaning=f"the index of a tube{top}, 0 being the innermost")


def _range(above: float | None, least: float | None, most: float | None, unit: str) -> str:
    given = (("above", above), ("at least", least), ("at most", most))
    bounds = [f"{name} {bound:g}" for name, bound in given if bound is not None]
    return "a finite number" + _in(unit) + (", " + " and ".join(bounds) if bounds else "")


def _in(unit: str) -> str:
    return f" in {unit}" if unit else ""


def _spaced(unit: str) -> str:
    return f" {unit}" if unit else ""


def _wanted(shape: tuple[int | None, ...]) -> str:
    return str(shape).replace("None", "k")


def _first(good: Any, values: Array) -> tuple[str, float]:
    """The place of the first entry that is not good, and the entry."""
    place = tuple(np.argwhere(~good)[0].tolist())
    return ", ".join(map(str, place)), float(values[place])


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


# -- values that are described -----------------------------------------------------------------------------------------

_WORDS = ("text", "flag", "whole", "tube", "any")


@attrs.frozen
class Entry:
    """What an argument, or a value in a file, must be.

    Attributes
    ----------
    unit
        Its SI unit, ``"1"`` for a number without one; or ``"text"``, ``"flag"``, ``"whole"``, ``"tube"``, ``"any"``.
    shape
        Default: a single value. None: any size.
    scalar_too
        Whether in files one number may stand for all.
    above, least, most
        The range of a number.
    optional
        Whether it may be None.
    choices
        The texts that are allowed, if not all are.
    says
        What messages call a list in a file.
    """

    unit: str
    shape: tuple[int | None, ...] = ()
    scalar_too: bool = False
    above: float | None = None
    least: float | None = None
    most: float | None = None
    optional: bool = False
    choices: tuple[str, ...] = ()
    says: str = "a list"

    @property
    def numeric(self) -> bool:
        """Whether it is a number, or an array of numbers."""
        return self.unit not in _WORDS

    def checked(self, value: Any, field: str) -> Any:
        """An argument of this name, clean."""
        if value is None and self.optional:
            return None
        unit = self.unit if self.unit != "1" else ""
        if self.shape:
            return array(value, field, self.shape, unit=unit)
        if self.unit == "tube":
            return index(value, field)
        if self.unit == "whole":
            return whole(value, field, int(self.least or 0), np.inf if self.most is None else self.most)
        if self.unit == "flag":
            return flag(value, field)
        if self.choices:
            return choice(value, field, self.choices)
        return number(value, field, above=self.above, least=self.least, most=self.most, unit=unit)


@attrs.frozen
class Table:
    """A table of a file with a ``kind``: its entries by name, and what makes a value of them.

    A name that ends in ``?`` may be left out; entries may be tables themselves. With ``needed`` columns (SI units by
    their names), and ``optional`` ones, the table names a CSV file: ``make`` takes their values by name, first. With
    ``csv``, a number of columns and where entries stand in them, it may name a CSV file without a header for these.
    """

    kind: str
    entries: Mapping[str, Any]
    make: Callable[..., Any]
    needed: Mapping[str, str] = attrs.field(factory=dict)
    optional: Mapping[str, str] = attrs.field(factory=dict)
    csv: Any = None


def given(value: Any) -> Any:
    """The converter of fields that :class:`Checked` checks: type checkers let callers pass what it accepts."""
    return value


def described(**entries: Entry) -> Mapping[str, Entry]:
    """Entries by the names of arguments."""
    return entries


class Checked:
    """A frozen value whose arguments are checked by their ``entries`` when it is made."""

    __slots__ = ()

    kind: ClassVar[str] = ""
    """What it is called in files; empty: it has no place in them."""
    entries: ClassVar[Mapping[str, Entry]]
    csv: ClassVar[Any] = None
    """See :class:`Table`."""

    def __attrs_post_init__(self) -> None:
        put = object.__setattr__  # loads are made in loops: every look-up counts
        for slot, field, entry in _slots(cast(Any, type(self))):
            put(self, slot, entry.checked(getattr(self, slot), field))

    @classmethod
    def in_files(cls) -> dict[str, Entry]:
        """Its entries in files: a name ends in ``?`` where there is a default."""
        defaults = {field.alias: field.default for field in attrs.fields(cast(Any, cls))}
        return {name + "?" * (defaults[name] is not attrs.NOTHING): entry for name, entry in cls.entries.items()}

    @classmethod
    def tables(cls) -> Sequence[Table]:
        """The tables of files that describe it."""
        return (Table(cls.kind, cls.in_files(), cls, csv=cls.csv),) if cls.kind else ()


@cache
def _slots(kind: Any) -> list[tuple[str, str, Entry]]:
    """Where a class keeps the arguments that have entries, their names, and the entries."""
    names = {field.alias: field.name for field in attrs.fields(kind)}
    return [(names[field], field, entry) for field, entry in kind.entries.items()]
