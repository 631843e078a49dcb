"""Checks of user input: each returns the clean value or raises a one-sentence ``DefinitionError``.

The requirements on a value are stated once, as an :class:`Entry`. Constructors check it, files are read with it, and
reports take its unit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Any, ClassVar, TypeVar, cast

import attrs
import numpy as np
from numpy.typing import NDArray

from .errors import DefinitionError

Array = NDArray[np.float64]
_N = TypeVar("_N", bound=NDArray[Any])
ARRAY_EQ = attrs.cmp_using(eq=np.array_equal)
"""Equality of fields that hold arrays."""


def alike(one: Any, other: Any) -> bool:
    """Whether two values are equal, with arrays and numbers in lists and tuples of any depth."""
    if isinstance(one, (list, tuple)) and isinstance(other, (list, tuple)):
        return len(one) == len(other) and all(map(alike, one, other))
    if one is None or other is None:
        return one is other
    return bool(np.array_equal(one, other))


ANY_EQ = attrs.cmp_using(eq=alike, require_same_type=False)
"""Equality of a field that holds numbers, arrays, or pairs of these."""
_LARGEST = 1e30  # in SI: no length, modulus or force is larger, and none overflows
SMALLEST = 1e-100  # of what must be positive: its square does not vanish
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
    """Check a finite float with ``above < value`` and ``least <= value <= most``."""
    allowed = _range(above, least, most, unit)
    try:
        if isinstance(value, (bool, str, bytes)) or value is np.ma.masked:
            raise TypeError
        result = float(value)
    except Exception:  # whatever the value's own conversion raises
        raise DefinitionError(f"{field} = {short(value)} must be {allowed}") from None
    inside = (
        abs(result) <= _LARGEST
        and (above is None or result > above + (SMALLEST if above == 0.0 else 0.0))
        and (least is None or result >= least)
        and (most is None or result <= most)
    )
    if not inside:
        raise DefinitionError(f"{field} = {result:g}{_spaced(unit)} must be {allowed}")
    return result


def bounded(
    above: float | None = None, least: float | None = None, most: float | None = None
) -> Callable[[Any, attrs.Attribute[Any], Any], None]:
    """A validator for fields that hold a :func:`number`."""

    def validate(instance: Any, field: attrs.Attribute[Any], value: Any) -> None:
        number(value, f"{type(instance).__name__}.{field.name}", above=above, least=least, most=most)

    return validate


def counted(least: int) -> Callable[[Any, attrs.Attribute[Any], Any], None]:
    """A validator of a field that holds a :func:`whole` number."""

    def validate(instance: Any, field: attrs.Attribute[Any], value: Any) -> None:
        whole(value, f"{type(instance).__name__}.{field.name}", least)

    return validate


def array(
    value: Any, field: str, shape: tuple[int | None, ...], *, above: float | None = None, unit: str = ""
) -> Array:
    """Check a finite float array above a bound and return it read-only; ``None`` in ``shape`` allows any size."""
    try:
        raw = np.array(value)
        if raw.dtype.kind not in "iuf":
            raise TypeError
        result = np.asarray(raw, dtype=np.float64)
    except Exception:  # whatever the value's own conversion raises
        raise DefinitionError(f"{field} = {short(value)} must be numbers of shape {_wanted(shape)}") from None
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        mask = np.atleast_1d(np.ma.getmaskarray(value))
        points = np.atleast_1d(mask.any(axis=tuple(range(1, mask.ndim))))
        raise DefinitionError(f"{field}: {points.sum()} of {len(points)} points are masked: leave them out")
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


def frozen(values: _N) -> _N:
    """Make an array read-only, so that nobody who is given it changes the answer for others."""
    values.setflags(write=False)
    return values


def freezing(values: Any) -> Any:
    """A converter for fields, which makes an array read-only."""
    return frozen(values)


def direction(value: Any, field: str) -> Array:
    """Check a direction ``(3,)`` of any nonzero length and return the unit vector."""
    vector = array(value, field, (3,))
    size = float(np.linalg.norm(vector))
    if size <= SMALLEST:
        raise DefinitionError(f"{field} = {vector.tolist()} is zero, but must be a direction")
    return vector / size


def rigid(value: Any, field: str) -> Array:
    """Check a pose ``(4, 4)``; its rotation may be off by 1e-6 and is made exact."""
    pose = np.array(array(value, field, (4, 4)))
    if not np.array_equal(pose[3], [0.0, 0.0, 0.0, 1.0]):
        raise DefinitionError(f"{field}: the last row {pose[3].tolist()} must be [0, 0, 0, 1]")
    rotation = pose[:3, :3]
    defect = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    determinant = float(np.linalg.det(rotation))
    if defect > _ROTATION_TOLERANCE or determinant < 0.0:
        raise DefinitionError(
            f"{field}: the upper left 3 x 3 block is not a rotation (R^T R differs from the identity by {defect:.2g}, "
            f"allowed {_ROTATION_TOLERANCE:g}; det R = {determinant:.6g}, must be 1)"
        )
    left, _, right = np.linalg.svd(rotation)
    pose[:3, :3] = left @ right
    pose.setflags(write=False)
    return pose


def choice(value: Any, field: str, allowed: Iterable[str]) -> str:
    """Check that ``value`` is one of ``allowed``."""
    if not isinstance(value, str) or value not in tuple(allowed):
        names = " or ".join(repr(name) for name in allowed)
        raise DefinitionError(f"{field} = {value!r} must be {names}")
    return value


def flag(value: Any, field: str) -> bool:
    """Check that ``value`` is True or False."""
    if not isinstance(value, bool):
        raise DefinitionError(f"{field} = {value!r} must be True or False")
    return value


def whole(value: Any, field: str, least: int, most: float = np.inf, *, meaning: str = "") -> int:
    """Check an integer ``least <= value <= most``; ``meaning`` describes it in errors."""
    try:
        if isinstance(value, bool) or value is np.ma.masked or int(value) != value or not least <= value <= most:
            raise ValueError
        return int(value)
    except Exception:  # whatever the value's own conversion raises
        wanted = meaning or f"a whole number, at least {least}" + (f" and at most {most}" if most < np.inf else "")
        raise DefinitionError(f"{field} = {value!r} must be {wanted}") from None


def side_of(value: Any, field: str = "side") -> int:
    """Check the side of a derivative: 1 or -1."""
    result = whole(value, field, -1, 1, meaning="1 or -1")
    if not result:
        raise DefinitionError(f"{field} = {value!r} must be 1 or -1")
    return result


def names_of(value: Any, field: str) -> list[str]:
    """Check a list of names, or a single name."""
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, (list, tuple)) or not all(isinstance(name, str) for name in names):
        raise DefinitionError(f"{field} = {short(value)} must be a list of names")
    return list(names)


def function(value: Any, field: str) -> Any:
    """Check a function that may be left out."""
    if value is not None and not callable(value):
        raise DefinitionError(f"{field} = {short(value)} must be a function or None")
    return value


def listed(value: Any, field: str, wanted: str) -> list[Any]:
    """Check something that can be listed: ``wanted`` says of what."""
    try:
        return list(value)
    except Exception:  # whatever its iteration raises
        raise DefinitionError(f"{field} = {short(value)} must be {wanted}") from None


def index(value: Any, field: str, size: int | None = None) -> int:
    """Check the index of a tube, ``0 <= value < size``."""
    top, most = ("", np.inf) if size is None else (f" from 0 to {size - 1}", size - 1)
    return whole(value, field, 0, most, meaning=f"the index of a tube{top}, 0 being the innermost")


def _range(above: float | None, least: float | None, most: float | None, unit: str) -> str:
    limits = (("above", above), ("at least", least), ("at most", most))
    bounds = [f"{name} {bound:g}" for name, bound in limits if bound is not None]
    return "a finite number" + _in(unit) + (", " + " and ".join(bounds) if bounds else "")


def _in(unit: str) -> str:
    return f" in {unit}" if unit else ""


def _spaced(unit: str) -> str:
    return f" {unit}" if unit else ""


def _wanted(shape: tuple[int | None, ...]) -> str:
    return str(shape).replace("None", "k")


def _first(good: Any, values: Array) -> tuple[str, float]:
    """The position of the first entry that is not good, and the entry."""
    place = tuple(np.argwhere(~good)[0].tolist())
    return ", ".join(map(str, place)), float(values[place])


def dimensions(value: Any) -> int:
    """Number of axes of what may be an array; one for what cannot, so that :func:`array` says so."""
    try:
        return np.ndim(value)
    except Exception:  # ragged lists, and whatever the value's own conversion raises
        return 1


def short(value: Any) -> str:
    """A short text of any value, for messages."""
    try:
        text = repr(value)
    except ValueError:  # an int of more digits than Python prints
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."


# -- described values --------------------------------------------------------------------------------------------------

_WORDS = ("text", "flag", "whole", "tube", "any")


@attrs.frozen
class Entry:
    """The requirements on an argument, or on a value in a file.

    Attributes
    ----------
    unit
        Its SI unit, ``"1"`` for a number without one; or ``"text"``, ``"flag"``, ``"whole"``, ``"tube"``, ``"any"``.
    shape
        Default: a single value. None: any size.
    scalar_too
        Whether one number in a file may replace a whole list.
    above, least, most
        The range of a number.
    optional
        Whether it may be None.
    choices
        The allowed texts; empty if all are allowed.
    says
        The name of a list in messages about files.
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
        """The checked value of an argument called ``field``."""
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
    """A table of a file with a ``kind``: its entries by name, and the function that makes a value from them.

    A name that ends in ``?`` may be left out; entries may be tables themselves. With ``needed`` and ``optional``
    columns (SI units by name), the table names a CSV file, and ``make`` takes the columns by name as first argument.
    With ``csv``, a number of columns and the columns of entries, the table may name a CSV file without a header.
    """

    kind: str
    entries: Mapping[str, Any]
    make: Callable[..., Any]
    needed: Mapping[str, str] = attrs.field(factory=dict)
    optional: Mapping[str, str] = attrs.field(factory=dict)
    csv: Any = None


def unchecked(value: Any) -> Any:
    """A converter for fields of :class:`Checked`, which makes type checkers accept any argument."""
    return value


def described(**entries: Entry) -> Mapping[str, Entry]:
    """Entries by the names of arguments."""
    return entries


class Checked:
    """A frozen value whose arguments are checked by ``entries`` when it is created."""

    __slots__ = ()

    kind: ClassVar[str] = ""
    """The name of this kind in files; empty if files cannot contain it."""
    entries: ClassVar[Mapping[str, Entry]]
    csv: ClassVar[Any] = None
    """See :class:`Table`."""

    def __attrs_post_init__(self) -> None:
        put = object.__setattr__  # loads are created in loops: every look-up counts
        for slot, field, entry in _slots(cast(Any, type(self))):
            put(self, slot, entry.checked(getattr(self, slot), field))

    @classmethod
    def in_files(cls) -> dict[str, Entry]:
        """The entries in files; a name ends in ``?`` if it has a default."""
        defaults = {field.alias: field.default for field in attrs.fields(cast(Any, cls))}
        return {name + "?" * (defaults[name] is not attrs.NOTHING): entry for name, entry in cls.entries.items()}

    @classmethod
    def tables(cls) -> Sequence[Table]:
        """The tables of files that describe this kind."""
        return (Table(cls.kind, cls.in_files(), cls, csv=cls.csv),) if cls.kind else ()


@cache
def _slots(kind: Any) -> list[tuple[str, str, Entry]]:
    """The attributes of a class that have entries, with the names of their arguments and the entries."""
    names = {field.alias: field.name for field in attrs.fields(kind)}
    return [(names[field], field, entry) for field, entry in kind.entries.items()]
