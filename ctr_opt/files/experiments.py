"""Experiments as CSV tables that a lab can fill: a line for each, units in the header."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from ..checks import Array, number
from ..errors import DefinitionError
from ..estimation.experiment import Experiment
from ..estimation.measurements import (
    COLUMNS,
    MEASUREMENTS,
    Measurement,
    PoseMeasurement,
    PositionMeasurement,
    TangentMeasurement,
)
from ..estimation.measurements.kind import whitening
from ..layout.observables import Distal, Place
from ..loads.point import PointWrench
from ..robot.actuation import Actuation
from ..robot.names import shown
from .columns import columns_of, read_rows, value_of
from .text import write_atomically

_AXES = ("x", "y", "z")
_QUATERNION = ("qw", "qx", "qy", "qz")
_UNIT = 1e-2  # a quaternion's norm may be so far from one by rounding
_POINT = re.compile(r"base|tip|tube\d+")


def read_experiments(
    path: str | Path,
    tubes: int,
    *,
    sigma: Any = None,
    direction_sigma: float | None = None,
    sensor: str | None = None,
    sigmas: Mapping[str, Any] | None = None,
) -> list[Experiment]:
    """Read a table of experiments.

    Parameters
    ----------
    path
        A CSV file. Its first line names the columns, each with its unit in brackets (without: SI): ``rotation_0 [deg]``
        and ``translation_0 [mm]`` for each tube; as far as there are any, ``force_x [N]``, ``force_y``, ``force_z``
        (world frame, at the innermost tube's tip) and what was measured: ``tip_x [mm]`` and so on, ``tube1_x``
        (the distal end of tube 1), ``base_x`` (the entry point), ``direction_x`` (the tangent
        at the tip, of any length) or ``tip_qw, tip_qx, tip_qy, tip_qz`` (with ``tip_x``: a unit quaternion, its scalar
        ``qw``, that takes vectors of the tip's material frame to the world's); and ``name``. ``#`` begins a comment.
        An empty field is something that was not measured.
    tubes
        How many tubes the robot has.
    sigma, direction_sigma
        Standard deviations of positions (m; a number, one for each axis, or a covariance) and of the direction's or
        orientation's angle (rad, about each axis).
    sensor
        A name, if tips, directions (its z axis) and orientations are those of a sensor on the innermost tube, in an
        unknown pose: see :class:`~ctr_opt.PositionMeasurement`.
    sigmas
        Standard deviations of other vectors, SI, numbers or one for each axis, by the names of their columns.

    Raises
    ------
    DefinitionError
        Names the file, the line, the column and what is allowed.

    Examples
    --------
    >>> len(read_experiments("problems/rjw_s1/calibration.csv", 2, sigma=0.5e-3))
    80
    """
    file = Path(path)
    for name in sigmas or {}:
        if name not in COLUMNS:
            raise DefinitionError(f"sigmas has {name!r}, which is no vector of a table: {', '.join(COLUMNS) or 'none'}")
    header, rows = read_rows(file)
    columns = _columns(file, header, tubes)
    noise = {"sigma": sigma, "direction_sigma": direction_sigma, "sensor": sensor, "sigmas": sigmas or {}}
    found = []
    for line, row in rows:
        values = {
            name: value_of(file, line, name, row[k], factor) for name, (k, factor) in columns.items() if name != "name"
        }
        name = row[columns["name"][0]].strip() if "name" in columns else f"line {line}"
        found.append(_Row(f"{file}: line {line}", values, tubes, **noise).experiment(name))
    return found


def _columns(file: Path, header: list[str], tubes: int) -> dict[str, tuple[int, float]]:
    """Where each column stands, and by what its numbers are multiplied to be SI."""
    allowed = (
        "name, rotation_i, translation_i, force_x, and of measurements base_x, tip_x, tube<i>_x, direction_x, "
        f"{''.join(f'{name}_x, ' for name in COLUMNS)}with y and z likewise, tip_qw, tip_qx, tip_qy, tip_qz, for tubes "
        f"0 to {tubes - 1}"
    )
    found = columns_of(file, header, lambda name: _unit(name, tubes), allowed)
    needed = [f"{kind}_{i}" for kind in ("rotation", "translation") for i in range(tubes)]
    vectors = {name.rpartition("_")[0] for name in found if name[-2:] in ("_x", "_y", "_z")}
    needed += [f"{name}_{axis}" for name in vectors for axis in _AXES]
    if any(name.startswith("tip_q") for name in found):
        needed += [f"tip_{end}" for end in (*_AXES, *_QUATERNION)]
        if "direction_x" in found:
            raise DefinitionError(f"{file}: give the tip's orientation by direction_x or by tip_qw, not by both")
    for name in needed:
        if name not in found:
            raise DefinitionError(f"{file}: column {name!r} is missing")
    return found


def _unit(name: str, tubes: int) -> str | None:
    """The SI unit of a column, None for a name that is none."""
    if name == "name":
        return "1"
    stem, _, end = name.rpartition("_")
    if stem in ("rotation", "translation") and end.isdigit() and int(end) < tubes:
        return "rad" if stem == "rotation" else "m"
    if stem == "tip" and end in _QUATERNION:
        return "1"
    if end not in _AXES:
        return None
    if stem in COLUMNS:
        return COLUMNS[stem]
    if stem in ("force", "direction"):
        return "N" if stem == "force" else "1"
    known = _POINT.fullmatch(stem) and (not stem.startswith("tube") or int(stem[4:]) < tubes)
    return "m" if known else None


@attrs.frozen
class _Row:
    """The numbers of a line, SI, NaN where empty, and what is known of their noise."""

    where: str
    values: dict[str, float]
    tubes: int
    sigma: Any
    direction_sigma: float | None
    sensor: str | None
    sigmas: Mapping[str, Any]

    def read(self, stem: str, ends: Sequence[Any]) -> list[float]:
        return [self.values.get(f"{stem}_{end}", np.nan) for end in ends]

    def experiment(self, name: str) -> Experiment:
        joints = self.read("rotation", range(self.tubes)), self.read("translation", range(self.tubes))
        if not np.isfinite(joints).all():
            raise DefinitionError(f"{self.where}: rotations and translations must all be given")
        force = np.nan_to_num(self.read("force", _AXES)).tolist()
        try:
            measured = [*self._points(), *self._tip(), *self._vectors()]
            if not measured:
                raise DefinitionError("nothing was measured")
            return Experiment(Actuation(*joints), [PointWrench(force=force)] if any(force) else [], measured, name=name)
        except DefinitionError as error:
            raise DefinitionError(f"{self.where}: {error}") from None

    def _points(self) -> list[Measurement]:
        """Positions, but for a sensor's or a pose's."""
        places: list[Place] = []
        points = []
        for column in self.values:
            stem = column[:-2]
            if not column.endswith("_x") or not _POINT.fullmatch(stem) or (stem == "tip" and self._alone):
                continue
            point = self.read(stem, _AXES)
            if np.isfinite(point).all():
                places.append(0.0 if stem == "base" else None if stem == "tip" else Distal(int(stem[4:])))
                points.append(point)
        return [PositionMeasurement(places, np.array(points), sigma=self.sigma)] if places else []

    @property
    def _turned(self) -> bool:
        """Whether the tip's orientation was measured."""
        return bool(np.isfinite(self.read("tip", _QUATERNION)).all())

    @property
    def _alone(self) -> bool:
        """Whether the tip is measured apart from other points."""
        return self.sensor is not None or self._turned

    def _tip(self) -> list[Measurement]:
        """What a sensor shows, and the tip's orientation."""
        found: list[Measurement] = []
        point, direction = self.read("tip", _AXES), self.read("direction", _AXES)
        if self._turned:
            found.append(PoseMeasurement(None, self._pose(point), self._pose_sigma, sensor=self.sensor))
        elif self._alone and np.isfinite(point).all():
            found.append(PositionMeasurement(None, point, self.sigma, self.sensor))
        if np.isfinite(direction).all():
            found.append(TangentMeasurement(None, direction, self.direction_sigma, self.sensor))
        return found

    def _vectors(self) -> list[Measurement]:
        """What kinds of measurements have columns of their own."""
        found = []
        for kind in MEASUREMENTS:
            vectors = {name: np.array(self.read(name, _AXES)) for name in kind.columns}
            if vectors and all(np.isfinite(vector).all() for vector in vectors.values()):
                found.append(kind.of_columns(vectors, {name: self.sigmas.get(name) for name in vectors}))
        return found

    def _pose(self, point: list[float]) -> Array:
        from scipy.spatial.transform import Rotation

        quaternion = np.array(self.read("tip", _QUATERNION))
        if not np.isfinite(point).all():
            raise DefinitionError("tip_qw needs tip_x, tip_y and tip_z beside it")
        if abs(np.linalg.norm(quaternion) - 1.0) > _UNIT:
            raise DefinitionError(f"tip_qw, ... = {quaternion.tolist()} must have a norm of 1 (allowed: {_UNIT:g})")
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = Rotation.from_quat(np.roll(quaternion, -1)).as_matrix(), point
        return pose

    @property
    def _pose_sigma(self) -> Array | None:
        """Covariance of a pose."""
        if (self.sigma is None) != (self.direction_sigma is None):
            raise DefinitionError("sigma: give it for positions and directions, or for none")
        if self.sigma is None or self.direction_sigma is None:
            return None
        covariance = np.eye(6) * number(self.direction_sigma, "direction_sigma", above=0.0) ** 2
        (whitener,) = whitening(self.sigma, 1, 3)
        covariance[:3, :3] = np.linalg.inv(whitener.T @ whitener)
        return covariance


def write_experiments(
    path: str | Path, experiments: Sequence[Experiment], comment: str = "", *, decimals: int = 4
) -> None:
    """Write experiments with positions at the entry, tubes' ends and the tip, and its direction, to such a table.

    In mm, degrees and N; ``decimals`` of what was measured. What an experiment does not have is left empty.
    """
    rows = [_cells(each, any(one.loads for one in experiments), decimals) for each in experiments]
    columns = list(dict.fromkeys(name for row in rows for name in row))

    def write(part: Path) -> None:
        with part.open("w", encoding="utf-8", newline="") as file:
            for line in comment.splitlines():
                file.write(f"# {line}\n")
            writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)

    write_atomically(Path(path), write)


def _cells(experiment: Experiment, loaded: bool, decimals: int) -> dict[str, str]:
    """The fields of an experiment by their columns."""
    joints, exact, rounded = experiment.actuation, "{:.12g}", f"{{:.{decimals}f}}"
    cells = {"name": experiment.name}

    def add(names: Sequence[str], numbers: Array, form: str = rounded) -> None:
        cells.update({name: form.format(x) for name, x in zip(names, numbers.tolist(), strict=True)})

    tubes = range(len(joints.rotations))
    add([f"rotation_{i} [deg]" for i in tubes], np.rad2deg(joints.rotations), exact)
    add([f"translation_{i} [mm]" for i in tubes], 1e3 * joints.translations, exact)
    if loaded:
        forces = [load.force for load in experiment.loads if isinstance(load, PointWrench)]
        add(_axes("force", " [N]"), sum(forces, np.zeros(3)), exact)
    for measured in experiment.measurements:
        if isinstance(measured, PositionMeasurement):
            for place, point in zip(measured.arc_length, measured.position, strict=True):
                add(_axes(_stem(place), " [mm]"), 1e3 * point)
    for measured in experiment.measurements:
        if isinstance(measured, TangentMeasurement):
            add(_axes("direction"), measured.direction)
        for name, unit in measured.columns.items():
            factor, written = shown(unit)
            add(_axes(name, f" [{written.replace(' ', '*')}]"), factor * measured.to_columns()[name])
    return cells


def _axes(stem: str, unit: str = "") -> list[str]:
    return [f"{stem}_{axis}{unit}" for axis in _AXES]


def _stem(place: Place) -> str:
    if place is None:
        return "tip"
    if isinstance(place, Distal):
        return f"tube{place.tube}"
    if place == 0.0:
        return "base"
    raise DefinitionError(
        f"arc_length = {place:g} m has no column in a table: only the entry, ends of tubes and the tip"
    )
