"""Experiments as CSV tables that a lab can fill: a line for each, units in the header."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .errors import DefinitionError
from .inverse.experiment import Experiment
from .inverse.measurements import Distal, Measurement, Place, PositionMeasurement, TangentMeasurement
from .reading import said_lines
from .robot.actuation import Actuation
from .robot.loads import PointWrench
from .units import to_si
from .writing import write_atomically

_COLUMN = re.compile(r"\s*([A-Za-z]\w*?)\s*(?:\[([^\]]*)\])?\s*")
_AXES = ("x", "y", "z")
_POINT = re.compile(r"base|tip|tube\d+")


def read_experiments(
    path: str | Path, tubes: int, *, sigma: Any = None, direction_sigma: float | None = None
) -> list[Experiment]:
    """Read a table of experiments.

    Parameters
    ----------
    path
        A CSV file. Its first line names the columns, each with its unit in brackets (without: SI): ``rotation_0 [deg]``
        and ``translation_0 [mm]`` for each tube; as far as there are any, ``force_x [N]``, ``force_y``, ``force_z``
        (world frame, at the innermost tube's tip) and what was measured: ``tip_x [mm]`` and so on, ``tube1_x``
        (the distal end of tube 1), ``base_x`` (the entry point), ``direction_x`` (the tangent
        at the tip, of any length); and ``name``. ``#`` begins a comment. An empty field is
        something that was not measured.
    tubes
        How many tubes the robot has.
    sigma, direction_sigma
        Standard deviations of positions (m; a number, one for each axis, or a covariance) and of the direction (rad).

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
    header, rows = _table(file)
    columns = _columns(file, header, tubes)
    found = []
    for line, row in rows:
        if len(row) != len(header):
            raise DefinitionError(
                f"{file}: line {line} has {len(row)} entries, but must have {len(header)}, one for each column"
            )
        values = {
            name: _value(file, line, name, row[k], factor) for name, (k, factor) in columns.items() if name != "name"
        }
        name = row[columns["name"][0]].strip() if "name" in columns else f"line {line}"
        found.append(_experiment(f"{file}: line {line}", values, tubes, name, sigma, direction_sigma))
    return found


def _table(file: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    rows = [(line, next(csv.reader([row]))) for line, row in said_lines(file)]
    if len(rows) < 2:
        raise DefinitionError(f"{file} must hold a line of names and lines of numbers")
    return rows[0][1], rows[1:]


def _columns(file: Path, header: list[str], tubes: int) -> dict[str, tuple[int, float]]:
    """Where each column stands, and by what its numbers are multiplied to be SI."""
    found: dict[str, tuple[int, float]] = {}
    for k, text in enumerate(header):
        match = _COLUMN.fullmatch(text)
        name = match[1] if match else text.strip()
        unit = _unit(name, tubes) if match else None
        if unit is None or name in found:
            what = "is given twice" if name in found else "is no column here"
            raise DefinitionError(
                f"{file}: column {text.strip()!r} {what}; the columns are name, rotation_i, translation_i, "
                "force_x, and of measurements base_x, tip_x, tube<i>_x, direction_x, with y and z likewise, for "
                f"tubes 0 to {tubes - 1}"
            )
        try:
            factor = to_si(f"1 {match[2]}", unit) if match and match[2] else 1.0
        except ValueError as error:
            raise DefinitionError(f"{file}: column {text.strip()!r} {error}") from None
        found[name] = k, factor
    needed = [f"{kind}_{i}" for kind in ("rotation", "translation") for i in range(tubes)]
    vectors = {name.rpartition("_")[0] for name in found if name[-2:] in ("_x", "_y", "_z")}
    needed += [f"{name}_{axis}" for name in vectors for axis in _AXES]
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
    if end not in _AXES:
        return None
    if stem in ("force", "direction"):
        return "N" if stem == "force" else "1"
    known = _POINT.fullmatch(stem) and (not stem.startswith("tube") or int(stem[4:]) < tubes)
    return "m" if known else None


def _value(file: Path, line: int, name: str, text: str, factor: float) -> float:
    text = text.strip()
    if not text:
        return float("nan")
    try:
        value = float(text)
    except ValueError:
        value = float("inf")
    if not np.isfinite(value):
        raise DefinitionError(f"{file}: line {line}, column {name!r}: {text!r} must be a finite number, or empty")
    return value * factor


def _experiment(
    where: str, values: dict[str, float], tubes: int, name: str, sigma: Any, direction_sigma: float | None
) -> Experiment:
    def read(stem: str, ends: Sequence[Any]) -> list[float]:
        return [values[f"{stem}_{end}"] for end in ends]

    joints = read("rotation", range(tubes)), read("translation", range(tubes))
    if not np.isfinite(joints).all():
        raise DefinitionError(f"{where}: rotations and translations must all be given")
    force = read("force", _AXES) if "force_x" in values else [0.0] * 3
    force = [0.0 if np.isnan(each) else each for each in force]
    points: list[tuple[Place, list[float]]] = []
    for column in values:
        stem = column[:-2]
        if column.endswith("_x") and _POINT.fullmatch(stem):
            place: Place = 0.0 if stem == "base" else None if stem == "tip" else Distal(int(stem[4:]))
            points.append((place, read(stem, _AXES)))
    measured: list[Measurement] = []
    complete = [(place, point) for place, point in points if np.isfinite(point).all()]
    if complete:
        at = np.array([point for _, point in complete])
        measured.append(PositionMeasurement([p for p, _ in complete], at, sigma=sigma))
    if "direction_x" in values and np.isfinite(read("direction", _AXES)).all():
        measured.append(TangentMeasurement(None, read("direction", _AXES), sigma=direction_sigma))
    if not measured:
        raise DefinitionError(f"{where}: nothing was measured")
    try:
        return Experiment(Actuation(*joints), [PointWrench(force=force)] if any(force) else [], measured, name=name)
    except DefinitionError as error:
        raise DefinitionError(f"{where}: {error}") from None


def write_experiments(path: str | Path, experiments: Sequence[Experiment], comment: str = "") -> None:
    """Write experiments with positions at the entry, tubes' ends and the tip to such a table, in mm, degrees and N."""
    tubes = len(experiments[0].actuation.rotations)
    first = [m for m in experiments[0].measurements if isinstance(m, PositionMeasurement)]
    stems = [_stem(place) for each in first for place in each.arc_length]
    header = ["name", *(f"rotation_{i} [deg]" for i in range(tubes)), *(f"translation_{i} [mm]" for i in range(tubes))]
    header += [f"force_{axis} [N]" for axis in _AXES]
    header += [f"{stem}_{axis} [mm]" for stem in stems for axis in _AXES]

    def write(part: Path) -> None:
        with part.open("w", encoding="utf-8", newline="") as file:
            for line in comment.splitlines():
                file.write(f"# {line}\n")
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(header)
            for each in experiments:
                force = sum((load.force for load in each.loads if isinstance(load, PointWrench)), np.zeros(3))
                points = np.vstack([m.position for m in each.measurements if isinstance(m, PositionMeasurement)])
                writer.writerow(
                    [each.name]
                    + [f"{x:.12g}" for x in np.rad2deg(each.actuation.rotations)]
                    + [f"{x:.12g}" for x in 1e3 * each.actuation.translations]
                    + [f"{x:.12g}" for x in force]
                    + [f"{x:.4f}" for x in 1e3 * points.ravel()]
                )

    write_atomically(Path(path), write)


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
