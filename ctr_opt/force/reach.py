"""Distance of measured points from all possible shapes, given that the backbone is inextensible."""

from __future__ import annotations

import numpy as np

from ..checks import Array
from ..estimation.experiment import Experiment
from ..estimation.measurements import PositionMeasurement
from ..layout.ends import Ends
from ..layout.observables import arc_length_of
from ..robot.robot import Robot


def unreachable(robot: Robot, experiment: Experiment, ends: Ends, based: bool) -> float:
    """Lower bound, over all shapes, of the sum of squared misfits over variances for points at known places.

    Two points cannot be farther apart than the arc between them. Pairs of neighbours are used, or, if the base is
    known exactly (``based``), each point and the entry point. Each point counts with its largest directional variance.
    """
    on_backbone = [m for m in experiment.measurements if isinstance(m, PositionMeasurement) and m.sensor is None]
    if not on_backbone:
        return 0.0
    s = np.array([arc_length_of(place, ends) for m in on_backbone for place in m.arc_length])
    order = np.argsort(s, kind="stable")
    s, points = s[order], np.concatenate([m.position for m in on_backbone])[order]
    weights = np.concatenate([np.linalg.svd(m.whitener, compute_uv=False)[:, -1] for m in on_backbone])[order]
    variances = weights**-2.0
    count = len(s) // 2 * 2
    gaps = _beyond(points[1:count:2] - points[:count:2], s[1:count:2] - s[:count:2])
    least = float((gaps**2 / (variances[:count:2] + variances[1:count:2])).sum())
    if based:
        least = max(least, float((_beyond(points - robot.base_pose[:3, 3], s) ** 2 / variances).sum()))
    return least


def _beyond(steps: Array, arcs: Array) -> Array:
    """Excess of distances over arc lengths, at least zero."""
    return np.asarray(np.maximum(np.linalg.norm(steps, axis=1) - arcs, 0.0))
