"""C text made into loaded libraries: compiled once per machine, kept on disk, in the background if wanted."""

from __future__ import annotations

import ctypes
import hashlib
import json
import logging
import platform
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from ..errors import CompilationError as CompilationError
from .cache import DIRECTORY, Kept, cache_directory
from .compiler import FLAGS, TUNINGS, leaving, private_directory, required, switched_off
from .compiler import Compiler as Compiler
from .compiler import compiler as compiler
from .compiler import on_request_only as on_request_only

_LOG = logging.getLogger(__name__)
_loaded: dict[str, ctypes.CDLL] = {}  # by key
_said: dict[str, object] = {}


class Source:
    """C text, or a function that writes it, which is called only where the text must be seen.

    Parameters
    ----------
    text
        C11, with the functions to call exported; or what writes it.
    origin
        A digest of everything that the text is written from. The cache notes which text came of it: where it is noted,
        a library is loaded without writing the text.
    """

    def __init__(self, text: str | Callable[[], str], origin: str | None = None) -> None:
        self._text, self.origin = text, origin

    @cached_property
    def text(self) -> str:
        """The text, written now if need be."""
        return self._text if isinstance(self._text, str) else self._text()


def load(name: str, source: Source | str) -> ctypes.CDLL:
    """The library compiled from C ``source``: from this process, from the cache on disk, or compiled now.

    A library depends on its text, the compiler and the machine; equal text is never compiled again. Of processes that
    start at once one compiles, and the others wait for it. A cache that cannot be used or trusted is done without,
    which is logged once.

    Parameters
    ----------
    name
        A word for the file's name, to tell entries apart when looking at them.
    source
        The text, or what writes it.

    Raises
    ------
    CompilationError
        There is no compiler, compilation is switched off, or the compiler failed: the message has its last lines.

    Examples
    --------
    >>> if compiler():
    ...     library = load("answer", "int answer(void) { return 42; }")
    ...     assert library.answer() == 42
    """
    chosen, source = required(), source if isinstance(source, Source) else Source(source)
    library = kept(name, source)
    if library is None:
        digest = _digest(source.text)
        key = _key(digest, chosen)
        if key not in _loaded:
            _loaded[key] = _load(name, key, source.text, chosen)
        library = _loaded[key]
        if source.origin is not None:
            with suppress(OSError):
                Kept(cache_directory(), name, source.origin).remember(digest)
    return library


def kept(name: str, source: Source) -> ctypes.CDLL | None:
    """The library of what was written from this origin, if it was compiled before.

    Nothing is written, compiled or logged.
    """
    chosen = compiler()
    if chosen is None or source.origin is None:
        return None
    try:
        digest = Kept(cache_directory(), name, source.origin).recall()
        key = None if digest is None else _key(digest, chosen)
        if key is not None and key not in _loaded:
            library = Kept(cache_directory(), name, key).load()
            if library is not None:
                _loaded[key] = library
    except OSError:
        return None
    return None if key is None else _loaded.get(key)


def _load(name: str, key: str, text: str, chosen: Compiler) -> ctypes.CDLL:
    try:
        entry = Kept(cache_directory(), name, key)
        library = entry.load()
    except OSError as error:
        entry, library = None, None
        _cannot_keep(error)
    return library or _build(entry, text, chosen)


def _build(entry: Kept | None, text: str, chosen: Compiler) -> ctypes.CDLL:
    """Compile in a private directory, into which no other process looks, and keep the result if possible."""
    built = None
    with private_directory() as directory:
        if entry is not None:
            try:
                with entry.lock():
                    library = entry.load()  # another process may have built it meanwhile
                    if library is not None:
                        return library
                    built = chosen.build(text, directory)
                    return entry.store(built)
            except OSError as error:
                _cannot_keep(error)
        built = built or chosen.build(text, directory)
        try:
            return ctypes.CDLL(str(built))  # stays loaded when its file is removed
        except OSError as error:
            raise CompilationError(f"the compiled library does not load: {error}") from error


def _cannot_keep(error: OSError) -> None:
    _warn_once(f"compiled code is not kept for the next time: {error}; {DIRECTORY} names another directory")


def _key(text: str, chosen: Compiler) -> str:
    """Digest of all that the library depends on, given that of its text.

    The tuning chosen follows from compiler and processor.
    """
    parts: list[Any] = [text, chosen.command, chosen.version, FLAGS, TUNINGS]
    return _digest(json.dumps([*parts, sys.platform, platform.machine(), _processor()]))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def _processor() -> str:
    """What tells processors apart for the compiler: on Linux the features, elsewhere the model."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(errors="replace").splitlines():
            if line.startswith(("flags", "Features")):
                return line.partition(":")[2].strip()
    return platform.processor()


class Build:
    """A library being built in a thread, which is never waited for unless asked; see :func:`load`.

    ``error`` says why there will be none; it was logged, once per process.
    """

    def __init__(self, name: str, source: Source) -> None:
        self._name, self._source = name, source
        self._library: ctypes.CDLL | None = None
        self.error: Exception | None = None
        self._thread = threading.Thread(target=self._work, name=f"ctr_opt compiles {name}", daemon=True)
        try:
            self._thread.start()
        except RuntimeError as error:  # no more threads, or the interpreter exits
            self._fail(error)

    def _work(self) -> None:
        try:
            required()  # before the source is written in vain
            self._library = load(self._name, self._source)
        except Exception as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        self.error = error
        if leaving.is_set() or switched_off() or compiler() is None:
            return  # nobody to tell, the user's choice, or told when the compiler was looked for
        _warn_once(f"compilation failed, and CasADi's virtual machine is used, about ten times slower: {error}")

    def ready(self) -> bool:
        """Whether the library is there; does not wait."""
        return self._library is not None

    def result(self, timeout: float | None = None) -> ctypes.CDLL | None:
        """The library, waited for at most ``timeout`` seconds; None if it is not there by then, or failed."""
        if self._thread.ident is not None:
            self._thread.join(timeout)
        return self._library


def _warn_once(message: str) -> None:
    mine = object()
    if _said.setdefault(message, mine) is mine:
        _LOG.warning(message)
