"""How far measured points are from every shape that a robot can have, as its backbone cannot be stretched."""

from __future__ import annotations

import numpy as np

from ..checks import Array
from ..estimation.experiment import Experiment
from ..estimation.measurements import PositionMeasurement
from ..layout.ends import Ends
from ..layout.observables import arc_length_of
from ..robot.robot import Robot


def unreachable(robot: Robot, experiment: Experiment, ends: Ends, based: bool) -> float:
    """The least sum of squared misfits, over their variances, whatever the shape: of points at known places.

    No two points are farther apart than the arc between them: each with its neighbour, or, where the base is known
    exactly (``based``), each with the entry point. What the largest of the variances along all directions leaves.
    """
    own = [each for each in experiment.measurements if isinstance(each, PositionMeasurement) and each.sensor is None]
    if not own:
        return 0.0
    s = np.array([arc_length_of(place, ends) for each in own for place in each.arc_length])
    order = np.argsort(s, kind="stable")
    s, points = s[order], np.concatenate([each.position for each in own])[order]
    weights = np.concatenate([np.linalg.svd(each.whitener, compute_uv=False)[:, -1] for each in own])[order]
    variances = weights**-2.0
    count = len(s) // 2 * 2
    gaps = _beyond(points[1:count:2] - points[:count:2], s[1:count:2] - s[:count:2])
    found = float((gaps**2 / (variances[:count:2] + variances[1:count:2])).sum())
    if based:
        found = max(found, float((_beyond(points - robot.base_pose[:3, 3], s) ** 2 / variances).sum()))
    return found


def _beyond(steps: Array, arcs: Array) -> Array:
    """By how much distances are longer than arcs."""
    return np.asarray(np.maximum(np.linalg.norm(steps, axis=1) - arcs, 0.0))
