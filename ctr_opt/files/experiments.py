"""CSV tables of experiments that a lab can fill: one line per experiment, units in the header."""

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
_UNIT = 1e-2  # allowed deviation of a quaternion's norm from one, by rounding
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
    """Read a CSV table of experiments.

    Parameters
    ----------
    path
        A CSV file. Its first line names the columns, each with its unit in brackets (default: SI). ``#`` begins a
        comment. An empty field was not measured. Columns are:

        - ``rotation_0 [deg]`` and ``translation_0 [mm]`` for each tube, required.
        - ``force_x [N]``, ``force_y``, ``force_z``: a known force on the innermost tube's tip, world frame.
        - ``tip_x [mm]`` and so on, ``tube1_x`` (the distal end of tube 1), ``base_x`` (the entry point): positions.
        - ``direction_x`` and so on: the tangent at the tip, of any length.
        - ``tip_qw, tip_qx, tip_qy, tip_qz`` instead, with ``tip_x``: a unit quaternion with the scalar ``qw`` that
          takes vectors of the tip's material frame to the world's.
        - ``name``: a name for reports.
    tubes
        Number of the robot's tubes.
    sigma, direction_sigma
        Standard deviations of positions (m; one number, one per axis, or a covariance) and of the angle of the
        direction or orientation (rad, about each axis).
    sensor
        Name of the sensor on the innermost tube, in an unknown pose, that measured tips, directions (its z axis) and
        orientations; None: the tip itself was measured. See :class:`~ctr_opt.PositionMeasurement`.
    sigmas
        Standard deviations of other vectors by the names of their columns, SI: one number, or one per axis.

    Raises
    ------
    DefinitionError
        The table is not valid; the message names the file, the line, the column and what is allowed.

    Examples
    --------
    >>> len(read_experiments("problems/rjw_s1/calibration.csv", 2, sigma=0.5e-3))
    80
    """
    file = Path(path)
    for name in sigmas or {}:
        if name not in COLUMNS:
            raise DefinitionError(f"sigmas has unknown vector {name!r}; allowed are {', '.join(COLUMNS) or 'none'}")
    header, rows = read_rows(file)
    columns = _columns(file, header, tubes)
    noise = {"sigma": sigma, "direction_sigma": direction_sigma, "sensor": sensor, "sigmas": sigmas or {}}
    experiments = []
    for line, row in rows:
        values = {
            name: value_of(file, line, name, row[k], factor) for name, (k, factor) in columns.items() if name != "name"
        }
        name = row[columns["name"][0]].strip() if "name" in columns else f"line {line}"
        experiments.append(_Row(f"{file}: line {line}", values, tubes, **noise).experiment(name))
    return experiments


def _columns(file: Path, header: list[str], tubes: int) -> dict[str, tuple[int, float]]:
    """Find the index of each column, and the factor that converts its numbers to SI."""
    allowed = (
        "name, rotation_i, translation_i, force_x, and of measurements base_x, tip_x, tube<i>_x, direction_x, "
        f"{''.join(f'{name}_x, ' for name in COLUMNS)}with y and z likewise, tip_qw, tip_qx, tip_qy, tip_qz, for tubes "
        f"0 to {tubes - 1}"
    )
    columns = columns_of(file, header, lambda name: _unit(name, tubes), allowed)
    needed = [f"{kind}_{i}" for kind in ("rotation", "translation") for i in range(tubes)]
    vectors = {name.rpartition("_")[0] for name in columns if name[-2:] in ("_x", "_y", "_z")}
    for kind in MEASUREMENTS:
        if not vectors.isdisjoint(kind.columns):  # a measurement needs all of its vectors
            vectors.update(kind.columns)
    needed += [f"{name}_{axis}" for name in sorted(vectors) for axis in _AXES]
    if any(name.startswith("tip_q") for name in columns):
        needed += [f"tip_{end}" for end in (*_AXES, *_QUATERNION)]
        if "direction_x" in columns:
            raise DefinitionError(f"{file}: give the tip's orientation by direction_x or by tip_qw, not by both")
    for name in needed:
        if name not in columns:
            raise DefinitionError(f"{file}: column {name!r} is missing")
    return columns


def _unit(name: str, tubes: int) -> str | None:
    """Return the SI unit of a column, None for an unknown name."""
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
    """Numbers of a line, SI, NaN for empty fields, with their standard deviations."""

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
        self._check_whole()
        force = np.nan_to_num(self.read("force", _AXES)).tolist()
        try:
            measured = [*self._points(), *self._tip(), *self._vectors()]
            if not measured:
                raise DefinitionError("nothing was measured")
            return Experiment(Actuation(*joints), [PointWrench(force=force)] if any(force) else [], measured, name=name)
        except DefinitionError as error:
            raise DefinitionError(f"{self.where}: {error}") from None

    def _check_whole(self) -> None:
        """Refuse what is given in part: it could not be used, and the rest of it would be lost without a word."""
        together = [[f"{column[:-2]}_{axis}" for axis in _AXES] for column in self.values if column.endswith("_x")]
        together.append([f"tip_{end}" for end in _QUATERNION])
        together += [[f"{name}_{axis}" for name in kind.columns for axis in _AXES] for kind in MEASUREMENTS]
        for columns in together:
            empty = [column for column in columns if np.isnan(self.values.get(column, np.nan))]
            if 0 < len(empty) < len(columns):
                filled = next(column for column in columns if column not in empty)
                raise DefinitionError(
                    f"{self.where}, column {empty[0]!r} is empty, but {filled!r} is given: fill in all of "
                    f"{', '.join(columns)}, or leave all of them empty"
                )

    def _points(self) -> list[Measurement]:
        """Position measurements, without those of a sensor or a pose."""
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
        """Whether the tip is measured separately from other points."""
        return self.sensor is not None or self._turned

    def _tip(self) -> list[Measurement]:
        """Measurements of a sensor, and of the tip's orientation."""
        measurements: list[Measurement] = []
        point, direction = self.read("tip", _AXES), self.read("direction", _AXES)
        if self._turned:
            measurements.append(PoseMeasurement(None, self._pose(point), self._pose_sigma, sensor=self.sensor))
        elif self._alone and np.isfinite(point).all():
            measurements.append(PositionMeasurement(None, point, self.sigma, self.sensor))
        if np.isfinite(direction).all():
            measurements.append(TangentMeasurement(None, direction, self.direction_sigma, self.sensor))
        return measurements

    def _vectors(self) -> list[Measurement]:
        """Measurements of kinds that define their own columns."""
        measurements = []
        for kind in MEASUREMENTS:
            vectors = {name: np.array(self.read(name, _AXES)) for name in kind.columns}
            if vectors and all(np.isfinite(vector).all() for vector in vectors.values()):
                measurements.append(kind.of_columns(vectors, {name: self.sigmas.get(name) for name in vectors}))
        return measurements

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
        """Covariance ``(6, 6)`` of a pose; None if no standard deviations are given."""
        if (self.sigma is None) != (self.direction_sigma is None):
            raise DefinitionError("sigma must be given for both positions and directions, or for neither")
        if self.sigma is None or self.direction_sigma is None:
            return None
        covariance = np.eye(6) * number(self.direction_sigma, "direction_sigma", above=0.0) ** 2
        (whitener,) = whitening(self.sigma, 1, 3)
        covariance[:3, :3] = np.linalg.inv(whitener.T @ whitener)
        return covariance


def write_experiments(
    path: str | Path, experiments: Sequence[Experiment], comment: str = "", *, decimals: int = 4
) -> None:
    """Write experiments to a CSV table that :func:`read_experiments` reads.

    Positions at the entry, the tubes' ends and the tip, and the tip's direction, have columns. Units are mm, degrees
    and N. Fields that an experiment does not have are empty.

    Parameters
    ----------
    path
        The CSV file, in a folder that exists. An existing file is replaced.
    experiments
        The experiments.
    comment
        Text for the first lines, written behind ``#``.
    decimals
        Number of decimals of measured values.

    Raises
    ------
    DefinitionError
        A position has no column, or the file cannot be written.
    """
    loaded = any(experiment.loads for experiment in experiments)
    rows = [_cells(experiment, loaded, decimals) for experiment in experiments]
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
    """Format the fields of an experiment by their columns."""
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
        f"arc_length = {place:g} m has no column in a table: only the entry, ends of tubes and the tip have one"
    )
