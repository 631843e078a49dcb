"""What all loads can say of themselves, and what loads with a potential have in common."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar, Self, cast

import attrs
import numpy as np

from ..robot.names import Parameter, optional

_CALLED = "it is a function"


class Numbered:
    """A load's numbers, by the names of its arguments: see :class:`ctr_opt.robot.names.Numbered`."""

    __slots__ = ()

    units: ClassVar[dict[str, str]]
    """The arguments that are numbers, and their units."""
    pulls: ClassVar[bool] = False

    @property
    def fields(self) -> tuple[str, ...]:
        """The arguments that are numbers of this load."""
        return tuple(self.units)

    def idle(self, pulled: bool) -> str:  # noqa: ARG002
        """Why none of them acts; ``pulled``: whether there is a load that pulls at masses."""
        return ""

    def numbers(self, prefix: str, pulled: bool) -> Iterator[Parameter]:
        """Its numbers, their names behind a prefix."""
        for field in self.fields:
            value = getattr(self, field)
            plain = not callable(value)
            shown, idle = (getattr(value, "values", value), self.idle(pulled)) if plain else (np.nan, _CALLED)
            yield optional(prefix + field, shown, idle, unit=self.units[field])

    def replaced(self, field: str, value: Any) -> Self:
        """The load with another number."""
        before = getattr(self, field)
        new = attrs.evolve(before, values=value) if hasattr(before, "values") else value
        return cast(Self, attrs.evolve(cast(Any, self), **{field: new}))


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
