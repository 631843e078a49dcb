"""What the tests of derivatives share: problems with one parameter changed, and differences of solved problems."""

import attrs
import numpy as np

import ctr_opt as ctr
from ctr_opt.robot.names import loads_with, robot_with

TIGHT = 1e-11  # tolerance of solves that are differenced: the smallest there is


def changed(made, actuation, loads, name, value):
    """Robot, actuation and loads with one parameter at another value."""
    loads = list(loads)
    if name in ("rotations", "translations"):
        return made, attrs.evolve(actuation, **{name: value}), loads
    if name == "base.translation":
        return attrs.evolve(made, base_pose=_moved(made.base_pose, value)), actuation, loads
    if name == "base.rotation":
        return attrs.evolve(made, base_pose=made.base_pose @ _turned(value)), actuation, loads
    if name.startswith("loads["):
        return made, actuation, list(loads_with(loads, {name: value}))
    return robot_with(made, {name: value}), actuation, loads


def _moved(pose, by):
    result = np.array(pose)
    result[:3, 3] += by
    return result


def _turned(angles):
    result = np.eye(4)
    for k, angle in enumerate(angles):
        c, s = np.cos(angle), np.sin(angle)
        a, b = [(1, 2), (2, 0), (0, 1)][k]
        turn = np.eye(3)
        turn[a, a] = turn[b, b] = c
        turn[b, a], turn[a, b] = s, -s
        result[:3, :3] = result[:3, :3] @ turn
    return result


def central(values, h, zero=0.0):
    """The derivative at zero of ``values(x)``: fourth order from four points, error ``h^4 f^(5) / 30``."""
    near, far = values(h) - values(-h), values(2.0 * h) - values(-2.0 * h)
    return (8.0 * near - far) / (12.0 * h)


def one_sided(values, h):
    """The derivative at zero toward the side of ``h``: fourth order, error ``h^4 f^(5) / 5``."""
    weights = np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / 12.0
    return sum(w * values(k * h) for k, w in enumerate(weights)) / h


def rotation_vector(frame, reference):
    """Of the turn from one frame to another, world axes, to the third order in its angle."""
    turn = frame @ reference.T
    return 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])


def pose_vector(pose, reference):
    """Position, and rotation from a reference pose."""
    return np.concatenate((pose[:3, 3], rotation_vector(pose[:3, :3], reference[:3, :3])))


def loads_for_all(tubes):
    """Loads of every kind, live ones included, that fit any robot of ``physics.random_problem`` with the actuation."""
    return [
        ctr.Gravity([2.0, -3.0, -9.0]),
        ctr.PointMass(0.004, tube=tubes - 1),
        ctr.DistributedMass(0.02, start=0.001),
        ctr.PointWrench([0.05, 0.02, -0.03], [0.002, 0.001, 0.003], tube=tubes - 1, frame="body"),
    ]
