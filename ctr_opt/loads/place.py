"""Entries that say where a load acts, shared by all loads."""

from __future__ import annotations

from ..checks import Entry
from ..errors import DefinitionError

ARC_LENGTH = Entry("m", least=0.0, optional=True)
"""Arc length from the entry point; None is the tube's distal end."""
START = Entry("m", least=0.0)
TUBE = Entry("tube")
POINT = {"arc_length": ARC_LENGTH, "tube": TUBE}
SPAN = {"start": START, "end": ARC_LENGTH, "tube": TUBE}


def check_interval(first: float, last: float | None) -> None:
    """Refuse an interval whose end is not above its start."""
    if last is not None and last <= first:
        raise DefinitionError(f"end = {last:g} m must be above start = {first:g} m")
