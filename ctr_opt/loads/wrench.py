"""Common part of wrenches at a point and along an interval."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Self

import numpy as np

from ..checks import Entry
from .density import acts
from .kind import Load, Number, Push

FRAME = Entry("text", choices=("world", "body"))
"""The frame of force and moment."""


class Wrench(Load):
    """Base of wrenches: a force and a moment on a tube, fixed in the world or to the tube."""

    __slots__ = ()

    force: Any
    moment: Any
    tube: int

    def lowered(self, number: Number, gravity: Any, masses: Sequence[Any]) -> Iterator[Push]:  # noqa: ARG002
        """Yield the force and the moment."""
        yield Push(self.tube, self.places, number("force"), number("moment"))

    @property
    def nonconservative(self) -> str:
        """Why the wrench has no potential; empty if it has one."""
        if self.frame == "body" and (acts(self.moment) or acts(self.force)):
            return "acts in a tube's frame (frame = 'body')"
        return "applies a moment" if acts(self.moment) else ""

    def conservative_part(self) -> Self | None:
        """Return the part with a potential: a world-fixed force. None for a wrench in the tube's frame."""
        return None if self.frame == "body" else self._with({"moment": np.zeros(3)})
