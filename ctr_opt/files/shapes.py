"""A solved shape as a table: CSV, npz or JSON."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..checks import Array
from ..forward.equilibrium import Equilibrium


def shape_columns(equilibrium: Equilibrium) -> dict[str, Array]:
    """Columns of a shape over the arc length, SI; NaN beyond a tube's end.

    They are position, curvature, internal force and moment, the quaternion of the innermost tube's frame, and each
    tube's torsion and angle.
    """
    from scipy.spatial.transform import Rotation

    s = equilibrium.arc_length
    vectors = {
        "position": equilibrium.position(s),
        "curvature": equilibrium.curvature(s)[:, :2],
        "force": equilibrium.internal_force(s),
        "moment": equilibrium.internal_moment(s),
    }
    columns = {"s": s}
    for name, values in vectors.items():
        columns |= {f"{name}_{axis}": column for axis, column in zip("xyz", values.T, strict=False)}
    quaternions = Rotation.from_matrix(equilibrium.pose(s)[:, :3, :3]).as_quat(canonical=True)
    columns |= {f"q_{axis}": column for axis, column in zip("xyzw", quaternions.T, strict=True)}
    for i, end in enumerate(equilibrium.configuration.tube_ends):
        inside = s <= end
        for name, of in (("torsion", equilibrium.torsion), ("angle", equilibrium.tube_angle)):
            column = np.full(len(s), np.nan)
            column[inside] = of(i, s[inside])
            columns[f"{name}_{i}"] = column
    return columns


def shape_facts(equilibrium: Equilibrium) -> dict[str, Any]:
    """Facts about the solve that a file contains besides its columns."""
    return {
        "status": equilibrium.status.name,
        "path": equilibrium.path,
        "length": equilibrium.length,
        "residual_norm": equilibrium.residual_norm,
        "discretization_error": equilibrium.discretization_error,
        "is_stable": equilibrium.is_stable,
        "unstable_directions": equilibrium.unstable_directions,
        "energy": equilibrium.energy,
        "load_work": equilibrium.load_work,
    }


def _write_csv(equilibrium: Equilibrium, path: Path) -> None:
    columns = shape_columns(equilibrium)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow(["" if np.isnan(value) else repr(float(value)) for value in row])


def _write_npz(equilibrium: Equilibrium, path: Path) -> None:
    contents: dict[str, Any] = {**shape_columns(equilibrium), **shape_facts(equilibrium)}
    np.savez(path, **{name: value for name, value in contents.items() if value is not None})


def _write_json(equilibrium: Equilibrium, path: Path) -> None:
    columns = {
        name: [None if np.isnan(value) else float(value) for value in column]
        for name, column in shape_columns(equilibrium).items()
    }
    text = json.dumps({**shape_facts(equilibrium), "units": "SI", "columns": columns}, indent=1, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


WRITERS: dict[str, Callable[[Equilibrium, Path], None]] = {".csv": _write_csv, ".npz": _write_npz, ".json": _write_json}
