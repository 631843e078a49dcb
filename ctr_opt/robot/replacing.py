"""Robots, actuations and loads with other numbers in the place of their parameters: see ``parameters.py``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, cast

import attrs
import numpy as np

from ..checks import Array
from ..loads.wrenches import Load, LoadTable
from .precurvature import PrecurvaturePiece, SampledCurvature
from .robot import Robot
from .tube import Tube

_TUBE = re.compile(r"tubes\[(\d+)\]\.(?:precurvature\[(\d+)\]\.)?(\w+)")
_LOAD = re.compile(r"loads\[(\d+)\]\.(\w+)")


def robot_with(robot: Robot, values: Mapping[str, Any]) -> Robot:
    """A robot with other numbers under some of its parameters' names, ``"tubes[0].bending_stiffness"`` and so on.

    >>> import ctr_opt as ctr
    >>> rod = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)
    >>> robot_with(ctr.Robot([rod]), {"tubes[0].precurvature[0].length": 0.2}).tubes[0].length
    0.2
    """
    tubes = list(robot.tubes)
    own: dict[int, dict[str, float]] = {}
    for name, value in values.items():
        if found := _TUBE.fullmatch(name):
            i, field = int(found[1]), found[3]
            if found[2] is None:
                own.setdefault(i, {})[field] = float(value)
            else:
                tubes[i] = _with_piece(tubes[i], int(found[2]), field, value)
    for i, fields in own.items():
        tubes[i] = attrs.evolve(tubes[i], **cast(Any, fields))
    pose = robot.base_pose
    if "base.translation" in values or "base.rotation" in values:
        pose = moved(pose, values.get("base.translation", np.zeros(3)), values.get("base.rotation", np.zeros(3)))
    return attrs.evolve(robot, tubes=tubes, base_pose=pose, on_overlap="ignore")


def loads_with(loads: Sequence[Load], values: Mapping[str, Any]) -> tuple[Load, ...]:
    """Loads with other numbers under some of their parameters' names, ``"loads[0].force"`` and so on."""
    changed = list(loads)
    for name, value in values.items():
        if found := _LOAD.fullmatch(name):
            k, field = int(found[1]), found[2]
            old = getattr(changed[k], field)
            given: Any = float(value) if np.ndim(value) == 0 else value
            new: Any = LoadTable(old.arc_length, given) if isinstance(old, LoadTable) else given
            changed[k] = attrs.evolve(cast(Any, changed[k]), **{field: new})
    return tuple(changed)


def moved(pose: Array, translation: Iterable[float], angles: Iterable[float]) -> Array:
    """A pose moved along the world's axes, and turned by XYZ Euler angles applied on its right."""
    from scipy.spatial.transform import Rotation

    result = np.array(pose)
    result[:3, 3] += np.asarray(translation)
    result[:3, :3] = pose[:3, :3] @ Rotation.from_euler("XYZ", np.asarray(angles)).as_matrix()
    return result


def _with_piece(tube: Tube, k: int, field: str, value: Any) -> Tube:
    pieces: list[PrecurvaturePiece] = list(tube.precurvature)
    piece = pieces[k]
    if field == "length" and isinstance(piece, SampledCurvature):
        pieces[k] = attrs.evolve(piece, arc_length=piece.arc_length * (float(value) / piece.length))
    else:
        pieces[k] = attrs.evolve(cast(Any, piece), **{field: float(value) if field == "length" else value})
    return attrs.evolve(tube, precurvature=tuple(pieces))
