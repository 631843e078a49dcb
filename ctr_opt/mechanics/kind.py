"""Kinds of loads that the equations cover; each kind has its own symbolic functions and compiled library."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from functools import lru_cache, wraps
from typing import Any, TypeVar, cast

import attrs

from ..loads.field import Field

_T = TypeVar("_T")
_Method = TypeVar("_Method", bound=Callable[..., Any])
_EXPRESSIONS = 4  # functions kept for users' expressions, as a program may create ever new expressions


@attrs.frozen(cache_hash=True)
class Kind:
    """The loads that the equations cover beyond dead loads: expressions, and flags that are off by default.

    A flag is a field of type bool. A flag that is on appears in the name of the compiled library and keeps the lines of
    headers between ``#if`` and ``#endif`` of its name in capitals. The C text of a kind does not mention flags that are
    off, so a new flag does not change the C text of other kinds.
    """

    body: bool = False  # loads in tubes' frames
    fields: tuple[Field, ...] = ()  # loads by expressions, for which there is no compiled code

    @classmethod
    def known_flags(cls) -> tuple[str, ...]:
        """The names of all flags."""
        return tuple(field.name for field in attrs.fields(cls) if field.default is False)

    @property
    def flags(self) -> tuple[str, ...]:
        """The names of the flags that are on."""
        return tuple(name for name in self.known_flags() if getattr(self, name))

    @property
    def live(self) -> bool:
        """Whether loads depend on the shape, so that the force at the entry point is unknown."""
        return self.body or bool(self.fields)

    def joined(self, other: Kind) -> Kind:
        """The kind that covers both."""
        flags = dict.fromkeys((*self.flags, *other.flags), True)
        return attrs.evolve(self, fields=tuple(dict.fromkeys((*self.fields, *other.fields))), **flags)


DEAD = Kind()
"""The kind for dead loads only."""

_BODY = Kind(body=True)


def kind_of(loads: Iterable[Any], fields: Iterable[Field] = ()) -> Kind:
    """The kind for loads, and for the expressions that they consist of."""
    kind = DEAD
    for load in loads:  # not any(): it runs in every compiled solve
        if getattr(load, "frame", "world") == "body":
            kind = _BODY
            break
    expressions = tuple(dict.fromkeys(fields))
    return attrs.evolve(kind, fields=expressions) if expressions else kind


def shared_by_kind(build: Callable[..., _T], most: int) -> Callable[..., _T]:
    """Cache ``build(...)`` for equal arguments, which are hashable and include a ``Kind``."""
    common, of_expressions = lru_cache(maxsize=most)(build), lru_cache(maxsize=_EXPRESSIONS)(build)

    def shared(*arguments: Hashable) -> _T:
        fields = any(argument.fields for argument in arguments if isinstance(argument, Kind))
        return of_expressions(*arguments) if fields else common(*arguments)

    return shared


def built_once(build: _Method) -> _Method:
    """Decorate a method so that it runs once for equal arguments; its object keeps the results."""
    slot = f"_built_{build.__name__}"

    @wraps(build)
    def method(self: Any, *key: Hashable) -> Any:
        try:  # the fast way first: solves ask thousands of times
            return self.__dict__[slot][key]
        except KeyError:
            result = build(self, *key)
            return self.__dict__.setdefault(slot, {}).setdefault(key, result)

    return cast(_Method, method)
