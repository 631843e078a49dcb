"""Calibrated cameras from files."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from ..errors import DefinitionError
from ..files.text import at, read_toml
from .cameras import Camera

_KEYS = ("intrinsics", "distortion", "pose", "rotation", "translation", "resolution")


def load_cameras(file: str | Path) -> tuple[Camera, ...]:
    """Cameras from a TOML file with a table ``[[cameras]]`` for each.

    A table holds ``intrinsics`` and perhaps ``distortion``, ``resolution``, and either ``pose`` (world from camera) or
    ``rotation`` and ``translation`` (camera from world, as OpenCV has it); lengths in m.

    Raises
    ------
    DefinitionError
        A file that cannot be read, an unknown key, or what :class:`Camera` refuses, with the table's number.
    """
    path = Path(file)
    tables = read_toml(path).get("cameras")
    if not isinstance(tables, list) or not tables:
        raise DefinitionError(f"{path} must hold a table [[cameras]] for each camera")
    return tuple(at(path, f"cameras[{k}]", partial(_camera, table)) for k, table in enumerate(tables))


def _camera(table: Any) -> Camera:
    if not isinstance(table, dict) or "intrinsics" not in table:
        raise DefinitionError("intrinsics is missing")
    for key in table:
        if key not in _KEYS:
            raise DefinitionError(f"{key} is unknown, must be one of {', '.join(_KEYS)}")
    if "pose" not in table:
        return Camera.from_opencv(**table)
    if "rotation" in table or "translation" in table:
        raise DefinitionError("pose and rotation, translation say the same thing: give one of them")
    return Camera(**table)
