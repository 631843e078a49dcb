"""Which compiled library serves a number of tubes and a kind of loads, and when it is built."""

from __future__ import annotations

import os
from functools import cache, partial

from ..mechanics.fields import LoadKind
from . import compile as compilation
from .calls import Native
from .generate import content, library_source

_ENOUGH = 10  # solves in one process that were worth a library: then it is built in the background


class Library:
    """The library for a number of tubes and a kind of loads: taken from the disk if it is there, or built."""

    def __init__(self, tubes: int, kind: LoadKind) -> None:
        self._arguments = (tubes, kind)
        self._name = f"shooting_{tubes}{'_body' if kind.body else ''}"
        self._native: Native | None = None
        self._build: compilation.Build | None = None
        self._asked = 0

    def ready(self) -> Native | None:
        """The library if it is there, for who did not request it; never waits for the compiler."""
        if compilation.on_request_only():
            return None
        if self._native is None:
            self._look()
        return self._native

    def built(self) -> Native:
        """The library, waited for; raises ``CompilationError`` where there is none."""
        if self._native is None:
            text = partial(library_source, *self._arguments)
            self._native = Native(compilation.load(self._name, text, content(*self._arguments)), *self._arguments)
        return self._native

    def _look(self) -> None:
        self._asked += 1
        if self._asked == 1:
            found = compilation.kept(self._name, content(*self._arguments))
            self._native = None if found is None else Native(found, *self._arguments)
        elif self._asked == _ENOUGH and compilation.compiler() is not None:
            text = library_source(*self._arguments)  # here and not in the thread: CasADi's symbols are of one thread
            self._build = compilation.start(self._name, lambda: text, content(*self._arguments))
        elif self._build is not None and self._build.ready():
            library = self._build.result()
            assert library is not None
            self._native, self._build = Native(library, *self._arguments), None


@cache
def library(tubes: int, body: bool) -> Library:
    """The library of this process."""
    return Library(tubes, LoadKind(body=body))


def _renewed() -> None:
    library.cache_clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renewed)
