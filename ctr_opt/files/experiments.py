"""CSV tables of experiments that a lab can fill: one line per experiment, units in the header."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from ..checks import Array, number, whole
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
from ..loads.kind import Load
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
    path: str | Path, experiments: Sequence[Experiment], comment: str = "", *, decimals: int | None = None
) -> None:
    """Write experiments to a CSV table that :func:`read_experiments` reads.

    Units are mm, degrees, N and N mm. Fields that an experiment does not have are empty.

    Parameters
    ----------
    path
        The CSV file, in a folder that exists. An existing file is replaced.
    experiments
        The experiments. Loads must be forces at the innermost tube's tip. Measurements must be positions at the entry,
        at tubes' ends or at the tip, the tip's direction or pose, and kinds with columns of their own, like
        :class:`~ctr_opt.BaseWrenchMeasurement`. A sensor must be at the tip, and the same in all experiments. Standard
        deviations and a sensor's name have no place in a table: give them to ``read_experiments``.
    comment
        Text for the first lines, written behind ``#``.
    decimals
        Number of decimals of measured values; default: all digits, so that reading gives the same numbers to rounding.

    Raises
    ------
    DefinitionError
        Names the experiment, and the load or measurement that a table cannot hold; or the file cannot be written.
    """
    if not experiments:
        raise DefinitionError("experiments = [] must hold at least one experiment")
    if decimals is not None:
        whole(decimals, "decimals", 0, 17)
    loaded = any(experiment.loads for experiment in experiments)
    rows, common = [], _Common()
    for k, experiment in enumerate(experiments):
        try:
            common.check(experiment)
            rows.append(_cells(experiment, loaded, decimals))
        except DefinitionError as error:
            raise DefinitionError(f"experiments[{k}].{error}") from None
    columns = list(dict.fromkeys(name for row in rows for name in row))

    def write(part: Path) -> None:
        with part.open("w", encoding="utf-8", newline="") as file:
            for line in comment.splitlines():
                file.write(f"# {line}\n")
            writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)

    write_atomically(Path(path), write)


class _Common:
    """What all experiments of a table have in common, taken from the first that has it."""

    def __init__(self) -> None:
        self.first_seen: dict[str, tuple[Any, str]] = {}

    def check(self, experiment: Experiment) -> None:
        """Refuse an experiment that differs from those before."""
        self._same("tubes", len(experiment.actuation.rotations), "actuation")
        for k, one in enumerate(experiment.measurements):
            if isinstance(one, (PositionMeasurement, TangentMeasurement, PoseMeasurement)) and None in one.arc_length:
                self._same("sensor", one.sensor, f"measurements[{k}]")
            if isinstance(one, (TangentMeasurement, PoseMeasurement)):
                self._same("kind of the tip's orientation", type(one).__name__, f"measurements[{k}]")

    def _same(self, what: str, value: Any, where: str) -> None:
        first, there = self.first_seen.setdefault(what, (value, where))
        if value != first:
            raise DefinitionError(
                f"{where}: {what} = {value!r}, but a table has one {what} for all experiments, and it was {first!r} "
                f"before ({there})"
            )


def _cells(experiment: Experiment, loaded: bool, decimals: int | None) -> dict[str, str]:
    """Format the fields of an experiment by their columns."""
    joints, exact, rounded = experiment.actuation, "{:.15g}", "{:.15g}" if decimals is None else f"{{:.{decimals}f}}"
    if "#" in experiment.name or len(experiment.name.splitlines()) > 1:
        raise DefinitionError(f"name = {experiment.name!r} must be one line without '#', which begins a comment")
    cells = {"name": experiment.name}

    def add(names: Sequence[str], numbers: Array, form: str = rounded) -> None:
        if names[0] in cells:
            raise DefinitionError(f"{names[0]!r} is measured more than once, but a table has one column for it")
        cells.update({name: form.format(x) for name, x in zip(names, numbers.tolist(), strict=True)})

    tubes = range(len(joints.rotations))
    add([f"rotation_{i} [deg]" for i in tubes], np.rad2deg(joints.rotations), exact)
    add([f"translation_{i} [mm]" for i in tubes], 1e3 * joints.translations, exact)
    if loaded:
        forces = [_force_at_tip(load, f"loads[{k}]") for k, load in enumerate(experiment.loads)]
        add(_axes("force", " [N]"), sum(forces, np.zeros(3)), exact)
    order = sorted(enumerate(experiment.measurements), key=lambda one: not isinstance(one[1], PositionMeasurement))
    for k, measured in order:
        try:
            for names, numbers in _vectors_of(measured):
                add(names, numbers)
        except DefinitionError as error:
            raise DefinitionError(f"measurements[{k}]: {error}") from None
    return cells


def _force_at_tip(load: Load, where: str) -> Array:
    """The force of a load that is nothing else."""
    at_tip = isinstance(load, PointWrench) and load.arc_length is None and load.tube == 0
    if not isinstance(load, PointWrench) or not at_tip or load.frame != "world" or load.moment.any():
        raise DefinitionError(
            f"{where} = {load!r} has no column in a table: it must be a PointWrench on tube 0 with arc_length None, "
            "frame 'world' and no moment"
        )
    return load.force


def _vectors_of(measured: Measurement) -> Iterator[tuple[list[str], Array]]:
    """Columns of a measurement, and their numbers."""
    if isinstance(measured, PositionMeasurement):
        for place, point in zip(measured.arc_length, measured.position, strict=True):
            if place is not None and measured.sensor is not None:
                raise DefinitionError(f"sensor = {measured.sensor!r} must be at the tip, arc_length None")
            yield _axes(_stem(place), " [mm]"), 1e3 * point
    elif isinstance(measured, (TangentMeasurement, PoseMeasurement)):
        if measured.arc_length[0] is not None or getattr(measured, "tube", None) is not None:
            raise DefinitionError(f"{type(measured).__name__} must be of the tip, arc_length None, and of no tube")
        if isinstance(measured, TangentMeasurement):
            yield _axes("direction"), measured.direction
        else:
            from scipy.spatial.transform import Rotation

            quaternion = Rotation.from_matrix(measured.pose[:3, :3]).as_quat(canonical=True)
            yield _axes("tip", " [mm]"), 1e3 * measured.pose[:3, 3]
            yield [f"tip_{end}" for end in _QUATERNION], np.roll(quaternion, 1)
    elif measured.columns:
        vectors = measured.to_columns()
        for name, unit in measured.columns.items():
            factor, written = shown(unit)
            yield _axes(name, f" [{written.replace(' ', '*')}]"), factor * vectors[name]
    else:
        raise DefinitionError(f"{type(measured).__name__} has no columns in a table")


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
