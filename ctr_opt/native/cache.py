"""Compiled libraries on disk, for all processes of one user.

An entry is a library with a record: the key of its source, and the digest of its bytes. Both are written under other
names and then renamed, so a killed process leaves no partial file under an entry's name. A library that does not match
its record is never loaded. A note says which text was written from an origin, as writing the text can take longer than
loading its library.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import re
import shutil
import stat
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import attrs
from filelock import FileLock
from platformdirs import user_cache_dir

from .compiler import SUFFIX

DIRECTORY = "CTR_OPT_CACHE"  # environment variable: directory of libraries, instead of the user's cache directory

_KEPT = 90 * 86400.0  # seconds for which an unused entry is kept
_PATIENCE = 150.0  # seconds to wait for another process to compile, longer than a compilation may take
_KEY_LETTERS = 32  # of the key are in an entry's name
_OURS = re.compile(rf"\w+-[0-9a-f]{{{_KEY_LETTERS}}}\.(so|dll|record|lock|note)(\..*\.tmp)?")


@attrs.frozen
class Kept:
    """One library of the cache: its directory, its name (a word), and the key of its source."""

    directory: Path
    name: str
    key: str

    @property
    def library(self) -> Path:
        """The file with the library."""
        return self._path(SUFFIX)

    @property
    def record(self) -> Path:
        """The file that says what the library must contain."""
        return self._path(".record")

    def _path(self, suffix: str) -> Path:
        return self.directory / f"{self.name}-{self.key[:_KEY_LETTERS]}{suffix}"

    def lock(self) -> FileLock:
        """The lock for the process that builds the entry; the system releases it when the process ends."""
        path = self._path(".lock")
        _make_way(path)
        return FileLock(path, timeout=_PATIENCE, mode=0o600)

    def load(self) -> ctypes.CDLL | None:
        """Load the library; None if it is absent, does not match its record or this key, or does not load."""
        try:
            if _read(self.record) != self._record_of(_read(self.library)):
                return None
            for path in (self.library, self.record):  # mark them as used
                with suppress(OSError):
                    os.utime(path)
            return ctypes.CDLL(str(self.library))
        except OSError:
            return None

    def store(self, library: Path) -> ctypes.CDLL:
        """Keep a new library, remove entries unused for long, and load it.

        Raises
        ------
        OSError
            It cannot be written, or not be loaded from there.
        """
        content = library.read_bytes()
        _write(self.library, content)
        _write(self.record, self._record_of(content))
        _prune(self.directory)
        return ctypes.CDLL(str(self.library))

    def recall(self) -> str | None:
        """The word noted under this key; None if there is no valid note."""
        path = self._path(".note")
        try:
            note = re.fullmatch(rf"key {self.key}\nnote (\w+)\n", _read(path).decode())
            with suppress(OSError):
                os.utime(path)
        except (OSError, UnicodeDecodeError):
            return None
        return note[1] if note else None

    def remember(self, word: str) -> None:
        """Note a word under this key; raises ``OSError`` if it cannot be written."""
        _write(self._path(".note"), f"key {self.key}\nnote {word}\n".encode())

    def _record_of(self, content: bytes) -> bytes:
        return f"key {self.key}\nsha256 {hashlib.sha256(content).hexdigest()}\n".encode()


def cache_directory() -> Path:
    """The directory of the cache, created if necessary.

    Raises
    ------
    OSError
        It cannot be created, or other users could put libraries there, which would be run.
    """
    chosen = os.environ.get(DIRECTORY)
    path = Path(chosen).absolute() if chosen else Path(user_cache_dir("ctr_opt"))
    if not path.is_absolute():
        raise OSError("there is no home directory")
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not (_is_ours(path.stat()) and _is_ours(path.lstat())):
        raise OSError(f"{path} belongs to another user, or other users may write there (chmod 700 makes it private)")
    return path


def _is_ours(status: os.stat_result) -> bool:
    """Whether only this user can write there; the permissions of a link have no meaning."""
    if os.name != "posix":
        return True
    shared = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not stat.S_ISLNK(status.st_mode)
    return status.st_uid == os.geteuid() and not shared


def _read(path: Path) -> bytes:
    status = path.lstat()
    if not (stat.S_ISREG(status.st_mode) and _is_ours(status)):  # reading a pipe would wait
        raise OSError(f"{path} is not a file of this user")
    return path.read_bytes()


def _write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    _make_way(path)
    descriptor, name = tempfile.mkstemp(prefix=f"{path.name}.", suffix=".tmp", dir=path.parent)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
        Path(name).replace(path)
    except BaseException:
        with suppress(OSError):
            Path(name).unlink()
        raise


def _make_way(path: Path) -> None:
    """Remove a directory at this path, as a file cannot replace it."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)


def _prune(directory: Path) -> None:
    """Remove the files of entries unused for long.

    A process that is about to load such a file finds it missing and builds it again. A process that holds so old a lock
    builds at the same time as another, and both write whole files.
    """
    oldest = time.time() - _KEPT
    for path in directory.iterdir():
        with suppress(OSError):
            if _OURS.fullmatch(path.name) and path.lstat().st_mtime < oldest:
                path.unlink()
