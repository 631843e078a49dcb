"""Interface of a load: named numbers, lowered to forces and moments at points and along spans.

The engine never asks for a load's kind. It uses the pushes to which the load is lowered (:class:`Push`), gets its
numbers by name, multiplies it, and keeps it on its tube.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from typing import Any, ClassVar, NamedTuple, Self, cast

import attrs
import numpy as np

from ..checks import Array, Checked
from ..robot.names import NamedNumber, optional, shown
from ..robot.robot import Robot
from .density import LoadTable, numbers_of, scaled
from .field import Field

Number = Callable[[str], Any]
"""A lookup of a load's number by name: the number itself, or a symbol in its place."""
_ZERO = np.zeros(3)
_PLACES = ("arc_length", "start", "end")
_CALLED = "it is a function"


class Push(NamedTuple):
    """One action on one tube, in numbers or in symbols.

    ``places`` names the load's arguments that say where it acts: one for a point, two for a span. ``force`` and
    ``moment`` are vectors, N and N m, or densities along a span. They are world-fixed, or with ``body`` (from the
    load's ``frame``) in the tube's material frame. An expression ``field``, with its parameters' ``numbers`` and
    multiplied by ``factor``, replaces them if given. Figures show the push tied to the ``anchor (3,)`` in the world, m.
    """

    tube: int
    places: tuple[str, ...]
    force: Any = _ZERO
    moment: Any = _ZERO
    body: bool = False
    field: Field | None = None
    factor: Any = 0.0
    numbers: Any = ()
    anchor: Array | None = None

    @property
    def constant(self) -> bool:
        """Whether force and moment are numbers that do not vary along a span."""
        return self.field is None and isinstance(self.force, np.ndarray) and isinstance(self.moment, np.ndarray)


class Load(Checked):
    """Base of all loads on a robot."""

    __slots__ = ()

    frame: str = "world"
    """Frame in which force and moment have constant components: ``"world"``, or ``"body"``, the tube's frame."""
    pulls: ClassVar[str] = ""
    """Name of the argument that accelerates masses; empty if there is none."""

    def lowered(self, number: Number, gravity: Any, masses: Sequence[Any]) -> Iterator[Push]:
        """Lower the load to pushes on tubes.

        ``number`` gives the load's numbers by name. ``gravity (3,)`` is the total acceleration of masses, m/s^2.
        ``masses`` are the tubes' masses per length, kg/m, None for a tube without a density.
        """
        raise NotImplementedError

    @property
    def nonconservative(self) -> str:
        """Why the load has no potential; empty if it has one."""
        return ""

    def conservative_part(self) -> Self | None:
        """Return the part of the load that has a potential; None if there is no such part."""
        return None if self.nonconservative else self

    @property
    def places(self) -> tuple[str, ...]:
        """Names of the arguments that say where the load acts: ``("arc_length",)``, ``("start", "end")`` or none."""
        return _places_in(tuple(self.entries))

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the arguments that are numbers of this load."""
        numeric = [field for field, entry in self.entries.items() if entry.numeric]
        return tuple(field for field in numeric if field not in _PLACES or field in self.places)

    @property
    def amounts(self) -> tuple[str, ...]:
        """Names of the numbers that :meth:`times` multiplies."""
        return tuple(field for field in self.fields if field not in _PLACES)

    def idle(self, pulled: bool) -> str:  # noqa: ARG002
        """Why none of the load's numbers acts, or empty; ``pulled`` says whether any load accelerates masses."""
        return ""

    def numbers(self, prefix: str, pulled: bool) -> Iterator[NamedNumber]:
        """Yield the load's numbers as parameters, names behind a prefix."""
        for field in self.fields:
            value = getattr(self, field)
            numbers, idle = (np.nan, _CALLED) if callable(value) else (numbers_of(value), self.idle(pulled))
            yield optional(prefix + field, numbers, idle, unit=self.entries[field].unit)

    def replaced(self, field: str, value: Any) -> Self:
        """Copy the load with one number replaced."""
        before = getattr(self, field)
        return self._with({field: attrs.evolve(before, values=value) if isinstance(before, LoadTable) else value})

    def times(self, factor: float) -> Self:
        """Copy the load multiplied by a factor."""
        return self._with({field: scaled(getattr(self, field), factor) for field in self.amounts})

    def where(self, field: str) -> float | None:
        """Arc length given by an argument, m; None is the tube's distal end."""
        value: float | None = getattr(self, field)
        return 0.0 if value is None and field == "start" else value

    def within(self, tube_ends: Array) -> Self | None:
        """Keep the load on its tube when tubes end at ``tube_ends``; None if its interval lies beyond the end.

        A load at a tube's distal end stays there.
        """
        end = float(tube_ends[getattr(self, "tube", 0)])
        if "start" in self.places and (self.where("start") or 0.0) >= end:
            return None
        last = self.places[-1:]
        return self._with({field: min(s, end) for field in last if (s := self.where(field)) is not None and s > end})

    def _with(self, fields: dict[str, Any]) -> Self:
        return attrs.evolve(cast(Any, self), **fields) if fields else self

    def __str__(self) -> str:
        """Describe the load in one line."""
        texts = [text for number in self.numbers("", pulled=True) if (text := _number_text(number))]
        carrier = ""
        if hasattr(self, "tube"):
            at_end = self.places == ("arc_length",) and self.where("arc_length") is None
            carrier = f" {'at the end of' if at_end else 'on'} tube {self.tube}"
        turning = ", in its frame" if self.frame == "body" else ""
        return f"{type(self).__name__}{carrier}{turning}: {', '.join(texts) or 'nothing'}"


def _number_text(number: NamedNumber) -> str:
    """Show a number with its name and unit; empty if it does not act or is zero."""
    if number.idle == _CALLED or number.value.ndim > 1:
        return f"{number.name} {'as a function' if number.idle else 'as a table'}"
    if number.idle or not number.value.any():
        return ""
    factor, unit = shown(number.unit)
    values = ", ".join(f"{factor * x:.6g}" for x in np.atleast_1d(number.value))
    return f"{number.name} {f'({values})' if number.value.ndim else values} {unit}".rstrip()


@cache
def _places_in(fields: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(field for field in _PLACES if field in fields)


def weights(robot: Robot, loads: Sequence[Load]) -> tuple[Array, list[float | None]]:
    """Acceleration of masses ``(3,)`` and the tubes' masses per length, for :meth:`Load.lowered` in numbers."""
    pulling = [getattr(load, load.pulls) for load in loads if load.pulls]
    if not pulling:
        return _ZERO, []
    return sum(pulling, _ZERO), [tube.mass_per_length if tube.density > 0.0 else None for tube in robot.tubes]


def lowered(robot: Robot, loads: Sequence[Load]) -> Iterator[tuple[int, Push]]:
    """Lower loads to pushes in numbers, each with the load's index."""
    return pushes_of(loads, [partial(getattr, load) for load in loads], *weights(robot, loads))


def pushes_of(
    loads: Sequence[Load], numbers: Sequence[Number], gravity: Any, masses: Sequence[Any]
) -> Iterator[tuple[int, Push]]:
    """Lower loads with these ``numbers`` to pushes, each with the load's index; see :meth:`Load.lowered`."""
    slots: Counter[Field] = Counter()
    for k, load in enumerate(loads):
        for push in load.lowered(numbers[k], gravity, masses):
            if load.frame == "body":
                push = push._replace(body=True)
            if push.field is not None and push.field.parameters:
                slot, slots[push.field] = slots[push.field], slots[push.field] + 1
                push = push._replace(field=attrs.evolve(push.field, slot=slot))
            yield k, push
