"""What loads with a potential have in common."""

from __future__ import annotations

from typing import Self


class Conservative:
    """A load that has a potential, all of it."""

    __slots__ = ()

    @property
    def nonconservative(self) -> str:
        """Why it has no potential: it has one."""
        return ""

    def conservative_part(self) -> Self:
        """The load itself."""
        return self
