"""The compiled library for a number of tubes and a kind, and when it is built."""

from __future__ import annotations

import ctypes
import os
import threading
from functools import cache, cached_property, partial

from ..mechanics.kind import Kind
from . import compile as compilation
from .calls import Native
from .generate import library_source, origin

_ENOUGH = 10  # solves in one process after which a library is built in the background


class Library:
    """The library for a number of tubes and a kind, loaded from disk or built."""

    def __init__(self, tubes: int, kind: Kind) -> None:
        self._arguments = (tubes, kind)
        self._name = "_".join(("shooting", str(tubes), *kind.flags))
        self._native: Native | None = None
        self._build: compilation.Build | None = None
        self._asked = 0
        self._counting = threading.Lock()

    @cached_property
    def _source(self) -> compilation.Source:
        return compilation.Source(partial(library_source, *self._arguments), origin(*self._arguments))

    def ready(self) -> Native | None:
        """The library if it is available without a request; never waits for the compiler."""
        if compilation.on_request_only():
            return None
        if self._native is None:
            self._look()
        return self._native

    def built(self) -> Native:
        """The library, after compilation if necessary; raises ``CompilationError``."""
        return self._native or self._made(compilation.load(self._name, self._source))

    def _made(self, library: ctypes.CDLL) -> Native:
        self._native, self._build = Native(library, *self._arguments), None
        return self._native

    def _look(self) -> None:
        with self._counting:  # a count that two threads skip would never be met
            self._asked += 1
            asked = self._asked
        library = None
        if asked == 1:
            library = compilation.kept(self._name, self._source)
        elif asked == _ENOUGH and compilation.compiler() is not None:
            _ = self._source.text  # written here, as CasADi's symbols belong to one thread
            self._build = compilation.Build(self._name, self._source)
        elif self._build is not None and self._build.ready():
            library = self._build.result()
        if library is not None:
            self._made(library)


@cache
def library(tubes: int, kind: Kind) -> Library:
    """The library for a number of tubes and a kind in this process."""
    return Library(tubes, kind)


def _renewed() -> None:
    library.cache_clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renewed)
