"""Plans of experiments: one robot in many actuations, with and without a force at its tip, from TOML and CSV."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from ..checks import number
from ..errors import DefinitionError
from ..forward.problem import ForwardProblem
from ..forward.report import robot_report
from ..loads.point import PointWrench
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from .problem import Problem, load_robot
from .text import at, read_table, read_toml

_AXES = ("x", "y", "z")


@attrs.frozen
class Plan:
    """A plan of experiments read from a file.

    Attributes
    ----------
    title, description, source, does_not_claim
        What it is, where its numbers come from, what they do not claim.
    problems
        One problem for each line of the table, in its order; each can be solved and compared by itself.
    expected
        How the expected tips of the table are known (``text``), and their ``position_tolerance``, m.
    """

    path: Path
    title: str
    robot: Robot
    problems: tuple[Problem, ...]
    description: str = ""
    source: str = ""
    does_not_claim: str = ""
    expected: dict[str, Any] = attrs.field(factory=dict)


def load_plan(path: str | os.PathLike[str], *, on_overlap: str = "warn") -> Plan:
    """Read a plan of experiments: a robot file's name, and a table with a line for each experiment.

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
    from .schemas import PlanSchema, load_checked

    file = Path(path)
    data = at(file, "", lambda: load_checked(PlanSchema, read_toml(file)))
    robot = load_robot(file.parent / data["robot"], on_overlap=on_overlap)
    forward = at(file, "solver", lambda: ForwardProblem(robot, **data.get("solver", {})))
    source, expected = data["source"], data.get("expected", {})
    if expected:
        at(file, "expected", partial(number, expected["position_tolerance"], "position_tolerance", above=0.0))
    columns = [f"{name}_{i}" for name in ("rotation", "translation") for i in range(len(robot.tubes))]
    columns += [f"{name}_{axis}" for name in ("force", *(["tip"] if expected else [])) for axis in _AXES]
    frame = Problem(
        file,
        data["title"],
        robot,
        Actuation(np.zeros(len(robot.tubes)), np.zeros(len(robot.tubes))),
        solver=data.get("solver", {}),
        description=data.get("description", ""),
        source=source["text"],
        does_not_claim=source.get("does_not_claim", ""),
        expected=expected,
    )
    table = file.parent / data["cases"]
    problems = tuple(
        at(table, f"line {line}", partial(_case, frame, forward, case, values))
        for case, (line, values) in enumerate(read_table(table, columns), start=1)
    )
    return Plan(file, frame.title, robot, problems, frame.description, frame.source, frame.does_not_claim, expected)


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
    """Read a plan and say in a few lines what it holds."""
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
    try:
        return "cases" in read_toml(Path(path))
    except DefinitionError:
        return False


def find_plans(folder: str | os.PathLike[str]) -> list[Path]:
    """The plans below a folder, in order."""
    return [file for file in sorted(Path(folder).rglob("*.toml")) if file.is_file() and is_plan(file)]
