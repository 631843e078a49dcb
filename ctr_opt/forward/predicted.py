"""Sensitivities of a compiled solve: predictions at the solution by compiled code, and their implicit derivatives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..checks import Array
from ..layout.ends import Ends
from ..layout.observables import Observable
from ..native.predictions import Predictions, predictable, supported
from ..transcription.closure import NEGLIGIBLE
from .compiled import CompiledRecord, Record
from .record import PoseRate

_JOINTS = ("rotations", "translations")


def predicted(record: Record, wanted: Observable, names: Sequence[str], side: int) -> Array | None:
    """Derivatives of an output by named parameters, in succession; None if they need symbols."""
    if not isinstance(record, CompiledRecord) or not record.compiled:
        return None
    robot, loads = record.robot, record.loads
    parts = _parts(wanted)
    if parts is None or not all(predictable(one, robot) for one, _ in parts):
        return None
    if not all(supported(name, robot, loads) for name in names):
        return None
    if wanted.name in ("position", "pose") and wanted.tube is None:
        if set(names) <= set(_JOINTS):
            return _by_joints(record, wanted, names, side)
        if "translations" in names and _several_end_at(record.ends, wanted):
            return None  # the frame may become that of another tube
    place = wanted.place if isinstance(wanted.place, float) else np.nan
    if wanted.tube is not None and place >= record.ends.of(wanted.tube) - record.ends.slack:
        return None  # the limit within the tube, also if it is drawn back
    if wanted.name == "torsion" and np.abs(record.configuration.break_points - place).min() <= record.ends.slack:
        return None  # the torsion itself has two sides
    rates = record.rates(PoseRate())
    if wanted.name == "actuator_wrench" and (rates is None or rates.coincide.any()):
        return None  # the force itself has two sides
    observables = [one for one, _ in parts]
    experiment = (record.actuation, loads)
    model = Predictions(robot, names, [experiment], observables, refinements=record.refinements, side=side)
    values = model.at(record.unknowns[None])
    if values.failed[0]:
        return None
    count, unit = model.unknowns, record.unit
    tip = values.slopes[0]
    if np.linalg.svd(tip[:, :count] * unit / unit[:, None], compute_uv=False)[-1] <= NEGLIGIBLE:
        return None  # symbols say why
    moved = -np.linalg.solve(tip[:, :count], tip[:, count:])
    slopes = np.concatenate([values.observed[k].slopes[0][rows] for k, (_, rows) in enumerate(parts)])
    return np.asarray(slopes[:, count:] + slopes[:, :count] @ moved)


def _by_joints(record: CompiledRecord, wanted: Observable, names: Sequence[str], side: int) -> Array | None:
    """Derivatives of a pose or a position by rotations or translations."""
    rates = record.rates(PoseRate(wanted.place if isinstance(wanted.place, float) else None, side=side))
    if rates is None:
        return None
    joints = dict(zip(_JOINTS, np.hsplit(rates.jacobian, 2), strict=True))
    return np.hstack([joints[name] for name in names])[: wanted.quantity.rates]


def _parts(wanted: Observable) -> list[tuple[Observable, slice]] | None:
    """Predictable observables, and their rows, that make up an output."""
    whole, place, tube = slice(None), wanted.place, wanted.tube
    match wanted.name:
        case "position":
            return [(Observable("pose", place, frame=0), slice(3))]
        case "pose":
            return [(Observable("pose", place, tube), whole)]
        case "torsion":
            return [(Observable("tube_curvature", place, tube), slice(2, 3))]
        case "actuator_wrench":
            return [(Observable(name, None, tube), whole) for name in ("actuator_force", "actuator_torque")]
        case "base_wrench":
            return [(wanted, whole)]
    return None


def _several_end_at(ends: Ends, wanted: Observable) -> bool:
    """Whether a tube ends at a fixed place, or several at the tip: then the pose may become that of another tube."""
    place = wanted.place if isinstance(wanted.place, float) else ends.length
    count = sum(abs(end - place) <= ends.slack for end in ends.points)
    return count > int(wanted.place is None)
