"""Checks of user input: each returns the clean value or raises a one-sentence ``DefinitionError``."""

from __future__ import annotations

from typing import Any

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


def array(value: Any, field: str, shape: tuple[int | None, ...], *, unit: str = "") -> Array:
    """``value`` as a finite, read-only float array; ``None`` in ``shape`` stands for any size."""
    try:
        given = np.array(value)
        if given.dtype.kind not in "iuf":
            raise TypeError
        result = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise DefinitionError(f"{field} = {_short(value)} must be numbers of shape {_wanted(shape)}") from None
    if result.ndim != len(shape) or any(size not in (None, got) for size, got in zip(shape, result.shape, strict=True)):
        raise DefinitionError(f"{field} has shape {result.shape}, but must have shape {_wanted(shape)}")
    if not (np.abs(result) <= _LARGEST).all():
        bad = np.argwhere(~(np.abs(result) <= _LARGEST))
        where = ", ".join(str(int(i)) for i in bad[0])
        raise DefinitionError(f"{field}[{where}] = {result[tuple(bad[0])]} must be a finite number{_in(unit)}")
    result.setflags(write=False)
    return result


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


def _wanted(shape: tuple[int | None, ...]) -> str:
    return (
        "(" + ", ".join("k" if size is None else str(size) for size in shape) + ("," if len(shape) == 1 else "") + ")"
    )


def choice(value: Any, field: str, allowed: tuple[str, ...]) -> str:
    """``value`` if it is one of ``allowed``."""
    if not isinstance(value, str) or value not in allowed:
        names = " or ".join(repr(name) for name in allowed)
        raise DefinitionError(f"{field} = {value!r} must be {names}")
    return value


def flag(value: Any, field: str) -> bool:
    """``value`` if it is True or False."""
    if not isinstance(value, bool):
        raise DefinitionError(f"{field} = {value!r} must be True or False")
    return value


def index(value: Any, field: str, size: int | None = None) -> int:
    """``value`` as an index ``0 <= value < size``."""
    try:
        if isinstance(value, bool):
            raise TypeError
        result = int(value)
        whole = result == value
    except (TypeError, ValueError, OverflowError):
        result, whole = 0, False
    if not whole or result < 0 or (size is not None and result >= size):
        top = "" if size is None else f" from 0 to {size - 1}"
        raise DefinitionError(f"{field} = {value!r} must be the index of a tube{top}, 0 being the innermost")
    return result


def _range(above: float | None, least: float | None, most: float | None, unit: str) -> str:
    bounds = []
    if above is not None:
        bounds.append(f"above {above:g}")
    if least is not None:
        bounds.append(f"at least {least:g}")
    if most is not None:
        bounds.append(f"at most {most:g}")
    return "a finite number" + _in(unit) + (", " + " and ".join(bounds) if bounds else "")


def _in(unit: str) -> str:
    return f" in {unit}" if unit else ""


def _spaced(unit: str) -> str:
    return f" {unit}" if unit else ""


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
