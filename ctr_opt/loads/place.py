"""Where a load acts: entries that all loads share."""

from __future__ import annotations

from ..checks import Entry
from ..errors import DefinitionError

ARC_LENGTH = Entry("m", least=0.0, optional=True)
"""From the entry point; None rides on the tube's end."""
START = Entry("m", least=0.0)
TUBE = Entry("tube")
POINT = {"arc_length": ARC_LENGTH, "tube": TUBE}
SPAN = {"start": START, "end": ARC_LENGTH, "tube": TUBE}


def check_interval(first: float, last: float | None) -> None:
    """Refuse a reversed interval."""
    if last is not None and last <= first:
        raise DefinitionError(f"end = {last:g} m must be above start = {first:g} m")
