"""Where a load acts: converters of the fields that all loads share."""

from __future__ import annotations

from typing import Any

from ..checks import index, number
from ..errors import DefinitionError


def arc_length(value: Any) -> float | None:
    """An arc length from the entry point, m; None rides on the tube's end."""
    return None if value is None else number(value, "arc_length", least=0.0, unit="m")


def start(value: Any) -> float:
    """Where an interval begins, m."""
    return number(value, "start", least=0.0, unit="m")


def end(value: Any) -> float | None:
    """Where an interval ends, m; None rides on the tube's end."""
    return None if value is None else number(value, "end", least=0.0, unit="m")


def tube(value: Any) -> int:
    """The index of a tube."""
    return index(value, "tube")


def check_interval(first: float, last: float | None) -> None:
    """Refuse a reversed interval."""
    if last is not None and last <= first:
        raise DefinitionError(f"end = {last:g} m must be above start = {first:g} m")
