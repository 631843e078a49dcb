"""What an equilibrium is asked for along the arc length: values read from the states of its shape."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from ..checks import Array, index
from ..errors import DefinitionError
from ..layout.configuration import Configuration
from ..transcription.shape import Shape, Values

_DISPLAY_STEPS = 100  # a grid to draw or save a shape at has at least so many steps


def read(shape: Shape, s: Any, of: Callable[[Values], Array], tube: int | None = None) -> Any:
    """``of`` the values at ``s``, within the robot or within a tube: one value, or a leading axis for ``s (k,)``."""
    try:
        points = np.asarray(s, dtype=np.float64)
    except (TypeError, ValueError):
        raise DefinitionError(f"s = {s!r} must be a number or a one-dimensional array of numbers, in m") from None
    if points.ndim > 1:
        raise DefinitionError(f"s has shape {points.shape}, but must be a number or one-dimensional")
    if points.size == 0:
        return read(shape, np.zeros(1), of, tube)[:0]
    own, flat = shape.configuration, np.atleast_1d(points)
    if tube is None:
        values = shape.at(shape.inside(flat, own.length, "the robot"))
    else:
        end = float(own.tube_ends[tube])
        flat = shape.inside(flat, end, f"tube {tube} ({own.robot.tubes[tube].name!r})")
        values = shape.at(flat, from_left=flat >= shape.inside(np.array([end]), own.length, "the robot"))
    result = np.asarray(of(values))
    if points.ndim == 0:
        return float(result[0]) if result.ndim == 1 else result[0]
    return result


def vectors(shape: Shape, s: Any, of: Callable[[Values], Array]) -> Array:
    """Vectors of the whole robot."""
    return np.asarray(read(shape, s, of))


def of_tube(shape: Shape, tube: int, s: Any, of: Callable[[Values, int], Array]) -> Any:
    """Values of a tube, within it."""
    i = index(tube, "tube", shape.configuration.tube_count)
    return read(shape, s, lambda at: of(at, i), i)


def poses(shape: Shape, s: Any, tube: int | None) -> Array:
    """Material frames of a tube, or of the innermost one present, 4 x 4."""
    ends = shape.configuration.ends

    def of(at: Values, i: int | None = None) -> Array:
        tubes = ends.innermost_along(at.arc_length) if i is None else np.full(len(at.arc_length), i)
        result = np.tile(np.eye(4), (len(tubes), 1, 1))
        result[:, :3, :3] = _rotations(at.state.orientation, at.state.angles[tubes, np.arange(len(tubes))])
        result[:, :3, 3] = at.state.position.T
        return result

    return vectors(shape, s, of) if tube is None else np.asarray(of_tube(shape, tube, s, of))


def moments(at: Values) -> Array:
    """``m (k, 3)``, world frame."""
    own = np.vstack((at.state.bending, at.state.torsion.sum(axis=0)))
    frames = _rotations(at.state.orientation, np.zeros(own.shape[1]))
    return np.asarray(np.einsum("kij,jk->ki", frames, own))


def grid(configuration: Configuration) -> Array:
    """Arc lengths to draw or save a shape at, not to be written to: every break point, and steps between them."""
    spacing, parts = configuration.length / _DISPLAY_STEPS, []
    for a, b in pairwise(configuration.break_points):
        parts.append(np.linspace(a, b, max(1, int(np.ceil((b - a) / spacing))), endpoint=False))
    points = np.concatenate((*parts, [configuration.length]))
    points.setflags(write=False)
    return points


def _rotations(quaternions: Array, angles: Array) -> Array:
    """``R(q) Rz(angle)``, ``(k, 3, 3)``, from quaternions ``(4, k)``."""
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0]))
    frames = Rotation.from_quat(np.roll(quaternions, -1, axis=0).T) * turns
    return np.asarray(frames.as_matrix())
