"""Functions are built once and kept; those for users' own expressions, of which there may be ever new ones, briefly."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import lru_cache
from typing import TypeVar

from ..mechanics.kind import Kind

_T = TypeVar("_T")
_OWN = 4  # kept of those built for expressions


def shared_by_kind(build: Callable[..., _T], most: int) -> Callable[..., _T]:
    """``build(...)``, called once for equal arguments, which are hashable and hold a ``Kind``."""
    common, own = lru_cache(maxsize=most)(build), lru_cache(maxsize=_OWN)(build)

    def shared(*arguments: Hashable) -> _T:
        fields = any(argument.fields for argument in arguments if isinstance(argument, Kind))
        return own(*arguments) if fields else common(*arguments)

    return shared
