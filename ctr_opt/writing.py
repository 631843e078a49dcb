"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .errors import DefinitionError


def check_output(path: Path, suffixes: tuple[str, ...]) -> None:
    """Refuse a place that cannot be written."""
    if path.suffix not in suffixes:
        raise DefinitionError(f"output = {str(path)!r} must end in {', '.join(suffixes)}")
    if not path.parent.is_dir():
        raise DefinitionError(f"{path}: the folder {str(path.parent)!r} does not exist")
    if path.is_dir() or not os.access(path.parent, os.W_OK):
        raise DefinitionError(f"{path} cannot be written")


def write_atomically(path: Path, write: Callable[[Path], Any]) -> None:
    """Let ``write`` fill a temporary file beside ``path``, and put it in place only when it is whole.

    The temporary file is removed whatever happens, unless the process is killed: then ``.NAME.*.part.SUFFIX`` stays.
    """
    if not path.parent.is_dir():
        raise DefinitionError(f"{path}: the folder {str(path.parent)!r} does not exist")
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}.", suffix=f".part{path.suffix}")
        os.close(handle)
    except (OSError, ValueError) as error:
        raise DefinitionError(f"{str(path)!r} cannot be written: {error}") from None
    part = Path(name)
    try:
        write(part)
        part.chmod(path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_umask())
        part.replace(path)
    except OSError as error:
        raise DefinitionError(f"{path} cannot be written: {error.strerror or error}") from None
    finally:
        part.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
