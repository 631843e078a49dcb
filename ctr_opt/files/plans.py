"""Plans of experiments: one robot in many actuations, with and without a force at its tip, from TOML and CSV."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from ..checks import number
from ..forward.problem import ForwardProblem
from ..forward.report import robot_report
from ..loads.point import PointWrench
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from .columns import read_columns
from .problem import About, Problem, about, opened
from .schemas import PLAN
from .text import at, keys_of

_AXES = ("x", "y", "z")


@attrs.frozen
class Plan(About):
    """A plan of experiments read from a file.

    Attributes
    ----------
    problems
        One problem for each line of the table, in its order; each can be solved and compared by itself.
    expected
        Source of the expected tips in the table (``text``), and their ``position_tolerance``, m.
    """

    robot: Robot
    problems: tuple[Problem, ...]
    expected: dict[str, Any] = attrs.field(factory=dict)


def load_plan(path: str | os.PathLike[str], *, on_overlap: str = "warn") -> Plan:
    """Read a plan of experiments: the name of a robot file, and a table with one line per experiment.

    Parameters
    ----------
    path
        A TOML file with ``cases``, the name of a CSV file beside it. Its first line names the columns: ``rotation_i``
        (rad) and ``translation_i`` (m) of each tube, ``force_x``, ``force_y``, ``force_z`` (N, world frame, at the
        innermost tube's tip; zeros: unloaded) and, with ``[expected]``, ``tip_x``, ``tip_y``, ``tip_z`` (m).
    on_overlap
        As in :func:`load_robot`.

    Raises
    ------
    DefinitionError
        One sentence that names the file, the line, the column, the value and what is allowed.

    Examples
    --------
    >>> plan = load_plan("problems/rjw_s1/plan.toml")
    >>> len(plan.problems)
    80
    >>> bool(abs(plan.problems[0].solve().tip_position[2] - 0.10096021) < 1e-8)
    True
    """
    file, data, robot = opened(path, PLAN, on_overlap)
    forward = at(file, "solver", lambda: ForwardProblem(robot, **data.get("solver", {})))
    expected, tubes = data.get("expected", {}), range(len(robot.tubes))
    if expected:
        at(file, "expected", partial(number, expected["position_tolerance"], "position_tolerance", above=0.0))
    units = {f"{name}_{i}": unit for name, unit in (("rotation", "rad"), ("translation", "m")) for i in tubes}
    measured = {"force": "N", **({"tip": "m"} if expected else {})}
    units |= {f"{name}_{axis}": unit for name, unit in measured.items() for axis in _AXES}
    head, held = about(file, data), Actuation(np.zeros(len(tubes)), np.zeros(len(tubes)))
    frame = Problem(**head, robot=robot, actuation=held, solver=data.get("solver", {}), expected=expected)
    table = file.parent / data["cases"]
    columns = read_columns(table, units)
    problems = [
        at(table, f"line {line:.0f}", partial(_case, frame, forward, k + 1, {name: columns[name][k] for name in units}))
        for k, line in enumerate(columns["line"])
    ]
    return Plan(**head, robot=robot, problems=tuple(problems), expected=expected)


def _case(frame: Problem, forward: ForwardProblem, case: int, values: dict[str, float]) -> Problem:
    def read(name: str, ends: Any) -> list[float]:
        return [values[f"{name}_{end}"] for end in ends]

    tubes = range(len(frame.robot.tubes))
    force = read("force", _AXES)
    problem = attrs.evolve(
        frame,
        title=f"{frame.title}, case {case}",
        actuation=Actuation(read("rotation", tubes), read("translation", tubes)),
        loads=(PointWrench(force=force),) if any(force) else (),
        expected={**frame.expected, "tip_position": read("tip", _AXES)} if frame.expected else {},
    )
    forward.check(problem.actuation, problem.loads)
    return problem


def check_plan(path: str | os.PathLike[str], *, on_overlap: str = "warn") -> str:
    """Read a plan and summarize it in a few lines."""
    plan = load_plan(path, on_overlap=on_overlap)
    ends = [t.length for t in plan.robot.tubes]
    lengths = [1e3 * float((ends + problem.actuation.translations).max()) for problem in plan.problems]
    loaded = sum(1 for problem in plan.problems if problem.loads)
    return (
        f"{robot_report(plan.robot)}\n{plan.title}: {len(plan.problems)} cases, {loaded} of them loaded, "
        f"lengths {min(lengths):.3f} to {max(lengths):.3f} mm"
    )


def is_plan(path: str | os.PathLike[str]) -> bool:
    """Whether a file is a plan: TOML with ``cases``."""
    return "cases" in keys_of(path)


def find_plans(folder: str | os.PathLike[str]) -> list[Path]:
    """Find the plans below a folder, in order."""
    return [file for file in sorted(Path(folder).rglob("*.toml")) if file.is_file() and is_plan(file)]
