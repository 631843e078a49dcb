"""Text files: TOML read as data, with errors that name the place, and atomic writing."""

from __future__ import annotations

import atexit
import os
import secrets
import tomllib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from ..errors import CtrOptError, DefinitionError

_T = TypeVar("_T")
_parts: set[Path] = set()  # temporary files of outputs that are being written


def read_text(file: Path, kind: str) -> str:
    """Read a text file; messages name the expected ``kind``."""
    try:
        return file.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise DefinitionError(f"{file} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise DefinitionError(f"{file} is not UTF-8 text, so it is not a {kind} file") from None
    except ValueError as error:
        raise DefinitionError(f"{str(file)!r} cannot be read: {error}") from None


def read_toml(file: Path) -> dict[str, Any]:
    """Read the tables of a TOML file."""
    try:
        return tomllib.loads(read_text(file, "TOML"))
    except tomllib.TOMLDecodeError as error:
        raise DefinitionError(f"{file} is not valid TOML, perhaps truncated: {error}") from None
    except RecursionError:
        raise DefinitionError(f"{file} is nested too deeply to be a robot or problem file") from None


def keys_of(path: str | os.PathLike[str]) -> set[str]:
    """Read the top-level keys of a TOML file, which distinguish kinds of files; empty if it cannot be read."""
    try:
        return set(read_toml(Path(path)))
    except DefinitionError:
        return set()


def at(file: Path, place: str, build: Callable[[], _T]) -> _T:
    """Call ``build``; an error then names the file and the place in it."""
    try:
        return build()
    except CtrOptError as error:
        text = str(error)
        raise DefinitionError(text if text.startswith(str(file)) else f"{file}: {_joined(place, text)}") from None
    except ValueError as error:
        raise DefinitionError(f"{file}: {(place + str(error)).lstrip('.: ').strip()}") from None


def _joined(place: str, text: str) -> str:
    return f"{place}: {text}" if place else text


def check_output(path: Path, suffixes: tuple[str, ...]) -> None:
    """Refuse an output path with a wrong suffix, or that cannot be written."""
    if path.suffix not in suffixes:
        raise DefinitionError(f"output = {str(path)!r} must end in {', '.join(suffixes)}")
    if not path.parent.is_dir():
        raise DefinitionError(f"{path}: the folder {str(path.parent)!r} does not exist")
    if path.is_dir() or not os.access(path.parent, os.W_OK):
        raise DefinitionError(f"{path} cannot be written")


def write_atomically(path: Path, write: Callable[[Path], Any]) -> None:
    """Let ``write`` fill a temporary file beside ``path``, and rename it only when it is complete.

    The temporary file is always removed, unless the process is killed: then ``.NAME.*.part.SUFFIX`` remains.
    """
    if not path.parent.is_dir():
        raise DefinitionError(f"{path}: the folder {str(path.parent)!r} does not exist")
    part = path.absolute().with_name(f".{path.stem}.{secrets.token_hex(8)}.part{path.suffix}")
    _parts.add(part)  # before it exists: a signal between the two would leave it behind
    try:
        _create(part, path)
        write(part)
        part.chmod(path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_umask())
        part.replace(path)
    except OSError as error:
        raise DefinitionError(f"{path} cannot be written: {error.strerror or error}") from None
    finally:
        _remove(part)


def _create(part: Path, path: Path) -> None:
    try:
        part.touch(0o600, exist_ok=False)
    except (OSError, ValueError) as error:
        raise DefinitionError(f"{str(path)!r} cannot be written: {error}") from None


def _remove(part: Path) -> None:
    with suppress(OSError, ValueError):  # ValueError: no file can have such a name
        part.unlink(missing_ok=True)
    _parts.discard(part)


@atexit.register
def _leave_no_parts() -> None:
    """Remove incomplete files when a signal ends the process."""
    for part in list(_parts):
        _remove(part)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_parts.clear)  # they are the parent's


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
