"""Robot and problem files in TOML, with tables in CSV; contents are data and never executed."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from ..checks import Array, choice, number
from ..errors import DefinitionError
from ..forward.equilibrium import Equilibrium
from ..forward.problem import ForwardProblem
from ..loads import LOADS
from ..loads.kind import Load
from ..robot.actuation import Actuation
from ..robot.precurvature import PIECES, Piece
from ..robot.robot import ON_OVERLAP, Robot, report_overlaps
from ..robot.tube import STIFFNESSES, Tube
from .described import make, read
from .schemas import PROBLEM, ROBOT
from .text import at, check_output, keys_of, read_toml, write_atomically

_TOLERANCES = {
    "tip_position": "position_tolerance",
    "tip_height_and_distance": "position_tolerance",
    "tip_direction": "direction_tolerance",
    "base_torsions": "torsion_tolerance",
}


@attrs.frozen(eq=False)
class About:
    """Title, description and source of a file; those of a robot file are not kept.

    Attributes
    ----------
    path, title, description
        The file, its title, and its subject.
    source, does_not_claim
        The source of its numbers, and what they do not claim; empty if the file does not say.
    """

    path: Path = attrs.field(kw_only=True)
    title: str = attrs.field(kw_only=True)
    description: str = attrs.field(default="", kw_only=True)
    source: str = attrs.field(default="", kw_only=True)
    does_not_claim: str = attrs.field(default="", kw_only=True)


@attrs.frozen
class Problem(About):
    """A problem read from a file: a robot, its actuation and loads, with source and expected answer.

    Attributes
    ----------
    robot, actuation, loads, solver
        The problem to solve; ``solver`` holds arguments of :class:`~ctr_opt.ForwardProblem`.
    expected
        Known values of the answer, by name, with tolerances.
    """

    robot: Robot
    actuation: Actuation
    loads: tuple[Load, ...] = ()
    solver: dict[str, Any] = attrs.field(factory=dict)
    expected: dict[str, Any] = attrs.field(factory=dict)

    def with_solver(self, arguments: dict[str, Any]) -> Problem:
        """Copy the problem with some arguments of :class:`~ctr_opt.ForwardProblem` replaced."""
        return attrs.evolve(self, solver={**self.solver, **arguments})

    def solve(self, *, loaded: bool = True, throw: bool = True) -> Equilibrium:
        """Solve the problem, with or without its loads.

        Parameters
        ----------
        loaded
            Whether the loads act.
        throw
            Raise ``SolveError`` if the solve fails; otherwise return the failed equilibrium.
        """
        forward = ForwardProblem(self.robot, **self.solver)
        return forward.solve(self.actuation, self.loads if loaded else (), throw=throw)

    def deviations(self, equilibrium: Equilibrium) -> dict[str, tuple[float, float]]:
        """Largest deviation from each expected value, with its tolerance from the file."""
        torsions = [equilibrium.torsion(i, 0.0) for i in range(len(self.robot.tubes))]
        values = {
            "tip_position": equilibrium.tip_position,
            "tip_height_and_distance": _height_and_distance(equilibrium),
            "tip_direction": equilibrium.tip_pose[:3, 2],
            "base_torsions": np.array(torsions),
        }
        return {
            name: (float(np.abs(values[name] - self.expected[name]).max()), float(self.expected[tolerance]))
            for name, tolerance in _TOLERANCES.items()
            if name in self.expected
        }


def _height_and_distance(equilibrium: Equilibrium) -> Array:
    """Height of the tip along the entry's z axis and distance from it, m; independent of a turn of the robot."""
    base = equilibrium.robot.base_pose
    x, y, z = base[:3, :3].T @ (equilibrium.tip_position - base[:3, 3])
    return np.array([z, np.hypot(x, y)])


def load_robot(path: str | os.PathLike[str], *, on_overlap: str = "warn") -> Robot:
    """Read a robot file.

    Parameters
    ----------
    path
        A TOML file with ``[[tubes]]`` from the innermost to the outermost. Quantities are numbers in SI or texts with
        units (``"1.75 mm"``). CSV files that it names are expected beside it.
    on_overlap
        What to do if tubes do not nest: ``"warn"``, ``"error"`` or ``"ignore"``.

    Raises
    ------
    DefinitionError
        One sentence that names the file, the field, the value and what is allowed.

    Examples
    --------
    >>> load_robot("problems/rjw_s1/robot.toml").tubes[0].name
    'inner'
    """
    file = Path(path)
    data = at(file, "", lambda: read(ROBOT, read_toml(file)))
    tubes = [_tube(file, k, table) for k, table in enumerate(data["tubes"])]
    pose = data.get("base", {}).get("pose")
    robot = at(file, "", lambda: Robot(tubes, pose, on_overlap="ignore"))
    report_overlaps(robot, choice(on_overlap, "on_overlap", ON_OVERLAP), f"{file}: ")
    return robot


def save_robot(robot: Robot, path: str | os.PathLike[str]) -> None:
    """Write a robot file with SI numbers in full precision, which :func:`load_robot` reads back.

    Parameters
    ----------
    robot
        The robot.
    path
        The TOML file, in a folder that exists. An existing file is replaced.

    Raises
    ------
    DefinitionError
        ``robot`` is not a Robot, or the file cannot be written.
    """
    import tomli_w

    if not isinstance(robot, Robot):
        raise DefinitionError(f"robot = {robot!r} must be a Robot")
    tables = [_tube_table(tube) for tube in robot.tubes]
    data: dict[str, Any] = {"base": {"pose": robot.base_pose.tolist()}, "tubes": tables}
    write_atomically(Path(path), lambda file: file.write_bytes(tomli_w.dumps(data).encode()))


def load_problem(path: str | os.PathLike[str], *, on_overlap: str = "warn") -> Problem:
    """Read a problem file: the name of a robot file, actuation, loads, source and expected answer.

    Parameters
    ----------
    path
        A TOML file; see ``docs/reference/files.md``.
    on_overlap
        As in :func:`load_robot`.

    Raises
    ------
    DefinitionError
        One sentence that names the file, the field, the value and what is allowed.

    Examples
    --------
    >>> load_problem("problems/rjw_s1/fig9_loaded.toml").title
    'RJW-S1, Fig. 9, loaded'
    """
    if "cases" in keys_of(path):
        raise DefinitionError(f"{Path(path)} is a plan of many cases: read it with load_plan")
    file, data, robot = opened(path, PROBLEM, on_overlap)
    actuation = at(file, "actuation", lambda: Actuation(**data["actuation"]))
    loads = tuple(make(file, f"loads[{k}]", load, LOADS, robot) for k, load in enumerate(data.get("loads", [])))
    solver = data.get("solver", {})
    forward = at(file, "solver", lambda: ForwardProblem(robot, **solver))
    at(file, "", lambda: forward.check(actuation, loads))
    expected = _expected(file, robot, data.get("expected", {}))
    return Problem(**about(file, data), robot=robot, actuation=actuation, loads=loads, solver=solver, expected=expected)


def opened(path: str | os.PathLike[str], spec: Any, on_overlap: str) -> tuple[Path, dict[str, Any], Robot]:
    """Open a file that names a robot file: return its path, its checked contents, and the robot."""
    file = Path(path)
    data = at(file, "", lambda: read(spec, read_toml(file)))
    return file, data, load_robot(file.parent / data["robot"], on_overlap=on_overlap)


def about(file: Path, data: dict[str, Any]) -> dict[str, Any]:
    """Collect the arguments of :class:`About` from a file's contents."""
    source = data.get("source", {})
    return {
        "path": file,
        "title": data["title"],
        "description": data.get("description", ""),
        "source": source.get("text", ""),
        "does_not_claim": source.get("does_not_claim", ""),
    }


def check_file(path: str | os.PathLike[str], *, on_overlap: str = "warn") -> str:
    """Read a robot or problem file and summarize it in a few lines.

    Raises
    ------
    DefinitionError
        As :func:`load_robot` and :func:`load_problem`.
    """
    from ..forward.report import robot_report

    file = Path(path)
    if "title" not in read_toml(file):
        return robot_report(load_robot(file, on_overlap=on_overlap))
    problem = load_problem(file, on_overlap=on_overlap)
    loads = f"{len(problem.loads)} load{'' if len(problem.loads) == 1 else 's'}"
    length = ForwardProblem(problem.robot).check(problem.actuation, problem.loads).length
    lines = [robot_report(problem.robot), f"{problem.title}: length {1e3 * length:.3f} mm, {loads}"]
    return "\n".join([*lines, *(f"  {load}" for load in problem.loads)])


def find_problems(folder: str | os.PathLike[str]) -> list[Path]:
    """Find the problem files below a folder, in order; other TOML files (robots, plans, calibrations) are skipped."""
    root = Path(folder)
    if not root.is_dir():
        raise DefinitionError(f"the folder {str(root)!r} does not exist")
    return [file for file in sorted(root.rglob("*.toml")) if file.is_file() and _is_problem(file)]


def _is_problem(file: Path) -> bool:
    keys = keys_of(file)
    return {"title", "robot"} <= keys and not keys & {"cases", "experiments", "measurements"}


def save_shape(equilibrium: Equilibrium, path: str | os.PathLike[str]) -> None:
    """Write a solved shape as ``.csv``, ``.npz`` or ``.json``, SI.

    Rows are at :attr:`~ctr_opt.Equilibrium.arc_length`. Beyond a tube's end its torsion and angle are empty (CSV), null
    (JSON) or NaN (npz).

    Parameters
    ----------
    equilibrium
        The shape.
    path
        The file, in a folder that exists; the suffix selects the format. An existing file is replaced.

    Raises
    ------
    DefinitionError
        The suffix is not allowed, or the file cannot be written.
    """
    from .shapes import WRITERS

    file = Path(path)
    check_output(file, tuple(WRITERS))
    write_atomically(file, lambda temporary: WRITERS[file.suffix](equilibrium, temporary))


def _tube(file: Path, k: int, table: dict[str, Any]) -> Tube:
    place = f"tubes[{k}] ({table['name']!r})"
    pieces = [make(file, f"{place}.precurvature[{j}]", piece, PIECES) for j, piece in enumerate(table["precurvature"])]
    return at(file, f"tubes[{k}]", lambda: Tube(**{**table, "precurvature": pieces}))


def _expected(file: Path, robot: Robot, values: dict[str, Any]) -> dict[str, Any]:
    for name, tolerance in _TOLERANCES.items():
        if name in values and tolerance not in values:
            raise DefinitionError(f"{file}: expected.{name} is given without expected.{tolerance}")
        if tolerance in values:
            at(file, "expected", partial(number, values[tolerance], tolerance, above=0.0))
    if len(values.get("base_torsions", robot.tubes)) != len(robot.tubes):
        raise DefinitionError(f"{file}: expected.base_torsions must have {len(robot.tubes)} entries, one per tube")
    return values


def _tube_table(tube: Tube) -> dict[str, Any]:
    numbers = {name: getattr(tube, name) for name in Tube.entries if name not in STIFFNESSES}
    table = {"name": tube.name, **{name: value for name, value in numbers.items() if value is not None}}
    return {**table, **tube.given_stiffnesses, "precurvature": [_piece_table(piece) for piece in tube.precurvature]}


def _piece_table(piece: Piece) -> dict[str, Any]:
    return {"kind": piece.kind, **{name: np.asarray(getattr(piece, name)).tolist() for name in piece.entries}}
