"""Force problems in files: a robot's actuation, what was measured on it, and the loads that are sought."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from .errors import DefinitionError
from .files import load_robot, read_load, tube_index
from .inverse.force_estimate import ForceEstimate
from .inverse.force_estimation import ForceEstimationProblem
from .inverse.measurements import (
    BackboneMeasurement,
    CurvatureMeasurement,
    ForceMeasurement,
    Measurement,
    PositionMeasurement,
    TangentMeasurement,
    TorqueMeasurement,
)
from .inverse.unknown_loads import PointForce, TipForce, TipWrench, UnknownLoad
from .reading import at, read_toml
from .robot.actuation import Actuation
from .robot.loads import Load
from .robot.robot import Robot
from .unit_tables import read_columns

_MOST = 4.0  # standard errors that an estimate from synthetic data may be off the truth
_POINTS, _CURVATURES = {"x": "m", "y": "m", "z": "m"}, {"s": "m", "u_x": "1/m", "u_y": "1/m"}


@attrs.frozen(eq=False)
class ForceProblem:
    """A force problem read from a file.

    Attributes
    ----------
    problem, actuation, measurements, loads
        What is solved: ``loads`` are the known ones.
    truth, expected
        Of synthetic data, what they were made with and what an estimate should say of them.
    title, description, source, does_not_claim
        What it is, where its numbers come from, what they do not claim.
    """

    path: Path
    title: str
    problem: ForceEstimationProblem
    actuation: Actuation
    measurements: tuple[Measurement, ...]
    loads: tuple[Load, ...]
    truth: dict[str, Any]
    expected: dict[str, Any]
    description: str = ""
    source: str = ""
    does_not_claim: str = ""

    def solve(self) -> ForceEstimate:
        """The estimate."""
        return self.problem.solve(self.actuation, self.measurements, self.loads)

    def verdicts(self, estimate: ForceEstimate) -> dict[str, bool]:
        """What the file says of the answer, in words, and whether it is so."""
        found: dict[str, bool] = {}
        if "force" in self.truth:
            off = np.atleast_2d(estimate.force)[0] - self.truth["force"]
            covariance = np.reshape(estimate.force_covariance, (-1, 3, 3))[0]
            size = float(np.sqrt(off @ np.linalg.solve(covariance, off)))
            told = f"force {np.linalg.norm(off):.2g} N off the truth, {size:.1f} standard errors ({_MOST:g} allowed)"
            found[told] = size <= _MOST
        if "arc_length" in self.truth:
            (place, *_), (error, *_) = np.atleast_1d(estimate.arc_length), np.atleast_1d(estimate.arc_length_error)
            off = abs(place - self.truth["arc_length"])
            told = f"place {1e3 * off:.2g} mm off the truth, {off / error:.1f} standard errors ({_MOST:g} allowed)"
            found[told] = off <= _MOST * error
        if "standard_errors" in self.expected:
            ratios = estimate.deviations / np.array(self.expected["standard_errors"])
            share = self.expected.get("share", 0.2)
            told = f"standard errors {ratios.min():.2f} to {ratios.max():.2f} times those expected"
            found[told] = bool((np.abs(ratios - 1.0) <= share).all())
        if "consistent" in self.expected:
            found["consistent" if estimate.consistent else "not consistent"] = (
                estimate.consistent is self.expected["consistent"]
            )
        if "undetermined" in self.expected:
            words = [each.split(":")[0] for each in estimate.undetermined]
            found[f"undetermined: {', '.join(words) or 'nothing'}"] = words == self.expected["undetermined"]
        return found


def load_force_problem(path: str | os.PathLike[str], *, on_overlap: str = "warn") -> ForceProblem:
    """Read a force problem.

    Parameters
    ----------
    path
        A TOML file with a robot, ``[actuation]``, ``[[measurements]]``, ``[[unknown]]`` and, if any are known,
        ``[[loads]]``; see ``docs/files.md``. Tables that it names are looked for beside it.
    on_overlap
        As in :func:`load_robot`.

    Raises
    ------
    DefinitionError
        One sentence that names the file, the place, the value and what is allowed.

    Examples
    --------
    >>> load_force_problem("problems/force_tip/problem.toml").problem.unknown
    (TipForce(prior=None),)
    """
    from .schemas import ForceSchema, load_checked

    file = Path(path)
    data = at(file, "", lambda: load_checked(ForceSchema, read_toml(file)))
    robot = load_robot(file.parent / data["robot"], on_overlap=on_overlap)
    joints = data["actuation"]
    sigmas = {name: joints.pop(name, None) for name in ("rotation_sigma", "translation_sigma")}
    actuation = at(file, "actuation", lambda: Actuation(**joints))
    unknown = tuple(_unknown(file, robot, k, table) for k, table in enumerate(data["unknown_loads"]))
    measured = tuple(_measurement(file, robot, k, table) for k, table in enumerate(data["measurements"]))
    loads = tuple(read_load(file, robot, k, table) for k, table in enumerate(data.get("load_tables", [])))
    loss = data.get("loss", "squared")
    problem = at(file, "", lambda: ForceEstimationProblem(robot, unknown, loss=loss, **sigmas))
    at(file, "", lambda: problem.check(actuation, measured, loads))
    return ForceProblem(
        file,
        data["title"],
        problem,
        actuation,
        measured,
        loads,
        data.get("truth", {}),
        data.get("expected", {}),
        data.get("description", ""),
        data["source"]["text"],
        data["source"].get("does_not_claim", ""),
    )


def _unknown(file: Path, robot: Robot, k: int, table: Any) -> UnknownLoad:
    from .schemas import UNKNOWN_LOAD_SCHEMAS, load_kind

    place = f"unknown[{k}]"
    kind, values = at(file, place, lambda: load_kind(UNKNOWN_LOAD_SCHEMAS, table))
    if "tube" in values:
        values["tube"] = at(file, place, lambda: tube_index(robot, values["tube"]))
    if "prior" in values:
        values["prior"] = values["prior"]["mean"], values["prior"]["sigma"]
    kinds: dict[str, Callable[..., UnknownLoad]] = {
        "tip_force": TipForce,
        "tip_wrench": TipWrench,
        "point_force": PointForce,
    }
    return at(file, place, lambda: kinds[kind](**values))


def _measurement(file: Path, robot: Robot, k: int, table: Any) -> Measurement:
    from .schemas import MEASUREMENT_SCHEMAS, load_kind

    place = f"measurements[{k}]"
    kind, values = at(file, place, lambda: load_kind(MEASUREMENT_SCHEMAS, table))
    if "tube" in values:
        values["tube"] = at(file, place, lambda: tube_index(robot, values["tube"]))
    kinds: dict[str, Callable[..., Measurement]] = {
        "points": lambda **own: _points(file, **own),
        "tip_position": lambda **own: PositionMeasurement(None, **own),
        "tip_direction": lambda **own: TangentMeasurement(None, **own),
        "curvatures": lambda **own: _curvatures(file, **own),
        "torque": TorqueMeasurement,
        "force": ForceMeasurement,
    }
    return at(file, place, lambda: kinds[kind](**values))


def _points(beside: Path, file: str, sigma: Any, ordered: bool = False) -> Measurement:
    columns = read_columns(beside.parent / file, _POINTS, {"s": "m"})
    points = np.column_stack([columns[axis] for axis in "xyz"])
    if "s" not in columns:
        return BackboneMeasurement(points, sigma, ordered=ordered)
    if ordered:
        raise DefinitionError("ordered is for points whose arc lengths nobody knows, but the table has a column s")
    return PositionMeasurement(columns["s"], points, sigma)


def _curvatures(beside: Path, file: str, sigma: Any, tube: int = 0) -> Measurement:
    columns = read_columns(beside.parent / file, _CURVATURES)
    return CurvatureMeasurement(columns["s"], np.column_stack((columns["u_x"], columns["u_y"])), sigma, tube)
