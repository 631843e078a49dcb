"""Values of an equilibrium along the arc length, read from the states of its shape."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from ..checks import Array, array, index, short
from ..errors import DefinitionError
from ..layout.configuration import Configuration
from ..transcription.shape import Shape, Values

_DISPLAY_STEPS = 100  # least number of steps of a grid to draw or save a shape


def places_of(s: Any) -> Array:
    """Check arc lengths: a number, or a one-dimensional array of numbers."""
    if isinstance(s, np.ma.MaskedArray):
        s = array(s, "s", (None,) * np.ndim(s))
    try:
        points = np.asarray(s, dtype=np.float64)
    except Exception:  # whatever the value's own conversion raises
        raise DefinitionError(f"s = {short(s)} must be a number or a one-dimensional array of numbers, in m") from None
    if points.ndim > 1:
        raise DefinitionError(f"s has shape {points.shape}, but must be a number or one-dimensional")
    return points


def read(shape: Shape, s: Any, of: Callable[[Values], Array], tube: int | None = None) -> Any:
    """Evaluate ``of`` at ``s``, within the robot or a tube: one value, or a leading axis for ``s (k,)``."""
    points = places_of(s)
    if points.size == 0:
        return read(shape, np.zeros(1), of, tube)[:0]
    configuration, flat = shape.configuration, np.atleast_1d(points)
    if tube is None:
        values = shape.at(shape.inside(flat, configuration.length, "the robot"))
    else:
        end = float(configuration.tube_ends[tube])
        flat = shape.inside(flat, end, f"tube {tube} ({configuration.robot.tubes[tube].name!r})")
        values = shape.at(flat, from_left=flat >= shape.inside(np.array([end]), configuration.length, "the robot"))
    result = np.asarray(of(values))
    if points.ndim == 0:
        return float(result[0]) if result.ndim == 1 else result[0]
    return result


def vectors(shape: Shape, s: Any, of: Callable[[Values], Array]) -> Array:
    """Evaluate a vector of the whole robot at ``s``."""
    return np.asarray(read(shape, s, of))


def of_tube(shape: Shape, tube: int, s: Any, of: Callable[[Values, int], Array]) -> Any:
    """Evaluate a quantity of one tube at ``s``, within that tube."""
    i = index(tube, "tube", shape.configuration.tube_count)
    return read(shape, s, lambda at: of(at, i), i)


def poses(shape: Shape, s: Any, tube: int | None) -> Array:
    """Material frames of a tube, or of the innermost one present, 4 x 4."""
    ends = shape.configuration.ends

    def of(at: Values, i: int | None = None) -> Array:
        tubes = ends.innermost_along(at.arc_length) if i is None else np.full(len(at.arc_length), i)
        result = np.tile(np.eye(4), (len(tubes), 1, 1))
        result[:, :3, :3] = rotations(at.state.orientation, at.state.angles[tubes, np.arange(len(tubes))])
        result[:, :3, 3] = at.state.position.T
        return result

    return vectors(shape, s, of) if tube is None else np.asarray(of_tube(shape, tube, s, of))


def moments(at: Values) -> Array:
    """Internal moments ``m (k, 3)`` in the world frame."""
    in_backbone_frame = np.vstack((at.state.bending, at.state.torsion.sum(axis=0)))
    frames = rotations(at.state.orientation, np.zeros(in_backbone_frame.shape[1]))
    return np.asarray(np.einsum("kij,jk->ki", frames, in_backbone_frame))


def grid(configuration: Configuration) -> Array:
    """Read-only arc lengths at which to draw or save a shape: every break point, and steps between them."""
    spacing, parts = configuration.length / _DISPLAY_STEPS, []
    for a, b in pairwise(configuration.break_points):
        parts.append(np.linspace(a, b, max(1, int(np.ceil((b - a) / spacing))), endpoint=False))
    points = np.concatenate((*parts, [configuration.length]))
    points.setflags(write=False)
    return points


def rotations(quaternions: Array, angles: Array) -> Array:
    """Rotations ``R(q) Rz(angle)``, ``(k, 3, 3)``, from quaternions ``(4, k)`` of any length."""
    (w, x, y, z), c, s = quaternions, np.cos(0.5 * angles), np.sin(0.5 * angles)
    w, x, y, z = w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s
    k = 2.0 / (w * w + x * x + y * y + z * z)
    rows = [
        [1.0 - k * (y * y + z * z), k * (x * y - w * z), k * (x * z + w * y)],
        [k * (x * y + w * z), 1.0 - k * (x * x + z * z), k * (y * z - w * x)],
        [k * (x * z - w * y), k * (y * z + w * x), 1.0 - k * (x * x + y * y)],
    ]
    return np.ascontiguousarray(np.array(rows).transpose(2, 0, 1))
