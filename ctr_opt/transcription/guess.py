"""Where an optimizer starts: the straight robot, or another shape."""

from __future__ import annotations

import attrs
import numpy as np

from ..checks import Array
from ..layout.configuration import Configuration
from ..mechanics.state import State, stacked, state_scales
from .shape import Shape


@attrs.frozen(eq=False)
class Guess:
    """Dimensionless states at the ends and at inner points of ``steps``, and the curvatures at those points.

    ``nodes (size, steps + 1)``; ``inner (size, points, steps)``; ``curvatures (2 + tubes, points, steps)``. Steps past
    the mesh, which fill the program up, stay at the tip.
    """

    nodes: Array
    inner: Array
    curvatures: Array


def straight(configuration: Configuration, mesh: Array, points: Array, steps: int) -> Guess:
    """The straight robot, its tubes free of torque: the guess that needs no thought."""
    parts, pose = State.parts(configuration.tube_count), configuration.robot.base_pose
    ends, inner = _places(mesh / configuration.length, points, steps)

    def states(s: Array) -> Array:
        x = np.zeros((State.size(configuration.tube_count), s.size))
        x[parts["position"]] = pose[:3, 3:] / configuration.length + np.outer(pose[:3, 2], s.ravel(order="F"))
        x[parts["orientation"]] = configuration.robot.base_quaternion[:, None]
        x[parts["angles"]] = (configuration.actuation.rotations + configuration.transmission_twist)[:, None]
        return x.reshape((len(x), *s.shape), order="F")

    return Guess(states(ends), states(inner), np.zeros((2 + configuration.tube_count, *inner.shape)))


def like(configuration: Configuration, mesh: Array, points: Array, steps: int, shape: Shape) -> Guess:
    """States and curvatures of another shape, its arc length stretched to this robot's."""
    scales, length = configuration.scales, shape.configuration.length
    unit = state_scales(configuration.tube_count, scales.length, scales.moment, scales.force)
    ends, inner = _places(mesh * (length / scales.length), points, steps)

    at = shape.at(np.minimum(np.append(ends, inner.ravel(order="F")), length))
    states = stacked(at.state) / unit[:, None]
    curvatures = np.vstack((at.bent, at.twisted)) * scales.length

    def inside(values: Array) -> Array:
        return values[:, steps + 1 :].reshape((len(values), *inner.shape), order="F")

    filled = inside(curvatures)
    filled[:, :, len(mesh) :] = 0.0
    return Guess(states[:, : steps + 1], inside(states), filled)


def _places(mesh: Array, points: Array, steps: int) -> tuple[Array, Array]:
    """Arc lengths of the nodes ``(steps + 1,)`` and of the points inside ``(points, steps)``, filled up at the tip."""
    idle = np.full((steps - len(mesh), 2), mesh[-1, 1])
    filled = np.vstack((mesh, idle))
    inner = filled[:, 0] + np.outer(points, filled[:, 1] - filled[:, 0])
    return np.append(filled[:, 0], mesh[-1, 1]), inner
