"""Libraries from C text: compiled once per machine, kept on disk, in the background on request."""

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
from .compiler import FLAGS, SLOWER, TUNINGS, leaving, private_directory, required, switched_off
from .compiler import Compiler as Compiler
from .compiler import compiler as compiler
from .compiler import on_request_only as on_request_only

_LOG = logging.getLogger(__name__)
_loaded: dict[str, ctypes.CDLL] = {}  # by key
_said: dict[str, object] = {}


class Source:
    """C text, or a function that writes it and is called only when the text is needed.

    Parameters
    ----------
    text
        C11 with exported functions, or a function that returns it.
    origin
        A digest of everything that the text is written from. The cache notes which text resulted from it. A library
        whose origin is noted is loaded without writing the text.
    """

    def __init__(self, text: str | Callable[[], str], origin: str | None = None) -> None:
        self._text, self.origin = text, origin

    @cached_property
    def text(self) -> str:
        """The text, written now if necessary."""
        return self._text if isinstance(self._text, str) else self._text()


def load(name: str, source: Source | str) -> ctypes.CDLL:
    """Load the library for C ``source``: from this process, from the cache on disk, or compiled now.

    A library depends on its text, the compiler and the machine; equal text is compiled once. If processes start
    together, one compiles and the others wait for it. A cache that cannot be used or trusted is bypassed, which is
    logged once.

    Parameters
    ----------
    name
        A word for the file's name, by which people can distinguish entries.
    source
        The text, or a :class:`Source`.

    Raises
    ------
    CompilationError
        There is no compiler, compilation is switched off, or the compiler failed. The message has its last lines.

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
    """The library for the source's origin, if it was compiled before.

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
    """Compile in a private directory and keep the result if possible."""
    built = None
    with private_directory() as directory:
        if entry is not None:
            try:
                with entry.lock():
                    library = entry.load()  # another process may have built it in the meantime
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
    _warn_once(f"compiled code is not kept for later processes: {error}; to use another directory, set {DIRECTORY}")


def _key(text: str, chosen: Compiler) -> str:
    """Digest of everything that the library depends on, from the digest of its text.

    The tuning follows from compiler and processor.
    """
    parts: list[Any] = [text, chosen.command, chosen.version, FLAGS, TUNINGS]
    return _digest(json.dumps([*parts, sys.platform, platform.machine(), _processor()]))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def _processor() -> str:
    """The processor as far as the compiler depends on it: its features on Linux, its model elsewhere."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(errors="replace").splitlines():
            if line.startswith(("flags", "Features")):
                return line.partition(":")[2].strip()
    return platform.processor()


class Build:
    """A library that a thread builds in the background; see :func:`load`.

    ``error`` says why the build failed; it was logged, once per process.
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
            required()  # first, as writing the source would be in vain
            self._library = load(self._name, self._source)
        except Exception as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        self.error = error
        if leaving.is_set() or switched_off() or compiler() is None:
            return  # at exit, by the user's choice, or already logged when the compiler was searched
        _warn_once(f"compilation failed, so ctr_opt runs in CasADi's virtual machine, {SLOWER}: {error}")

    def ready(self) -> bool:
        """Whether the library is built; does not wait."""
        return self._library is not None

    def result(self, timeout: float | None = None) -> ctypes.CDLL | None:
        """The library, after at most ``timeout`` seconds; None if it is not built by then, or failed."""
        if self._thread.ident is not None:
            self._thread.join(timeout)
        return self._library


def _warn_once(message: str) -> None:
    mine = object()
    if _said.setdefault(message, mine) is mine:
        _LOG.warning(message)
