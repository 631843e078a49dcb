"""Robots and problems in TOML files, with tables in CSV; contents are data and never executed."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from ..checks import Array, choice, number
from ..errors import DefinitionError
from ..forward.equilibrium import Equilibrium
from ..forward.problem import ForwardProblem
from ..loads.distributed import DistributedLoad
from ..loads.gravity import Gravity
from ..loads.kind import Load
from ..loads.masses import DistributedMass, PointMass
from ..loads.point import PointWrench
from ..loads.spring import Spring
from ..robot.actuation import Actuation
from ..robot.precurvature import Arc, PolynomialCurvature, PrecurvaturePiece, SampledCurvature, Straight
from ..robot.robot import ON_OVERLAP, Robot, report_overlaps
from ..robot.tube import Tube
from .text import at as _at
from .text import check_output, read_csv, write_atomically
from .text import read_toml as _read_toml

_TOLERANCES = {
    "tip_position": "position_tolerance",
    "tip_height_and_distance": "position_tolerance",
    "tip_direction": "direction_tolerance",
    "base_torsions": "torsion_tolerance",
}


@attrs.frozen
class Problem:
    """A problem read from a file: what to solve, where it comes from, what a right answer is.

    Attributes
    ----------
    robot, actuation, loads, solver
        What to solve; ``solver`` holds arguments of :class:`~ctr_opt.ForwardProblem`.
    title, description, source, does_not_claim
        What it is, where its numbers come from, what they do not claim.
    expected
        The right answer as far as known, by name, with tolerances.
    """

    path: Path
    title: str
    robot: Robot
    actuation: Actuation
    loads: tuple[Load, ...] = ()
    solver: dict[str, Any] = attrs.field(factory=dict)
    description: str = ""
    source: str = ""
    does_not_claim: str = ""
    expected: dict[str, Any] = attrs.field(factory=dict)

    def with_solver(self, arguments: dict[str, Any]) -> Problem:
        """The problem with other arguments of :class:`~ctr_opt.ForwardProblem`."""
        return attrs.evolve(self, solver={**self.solver, **arguments})

    def solve(self, *, loaded: bool = True, throw: bool = True) -> Equilibrium:
        """Solve it, or the same robot without its loads."""
        forward = ForwardProblem(self.robot, **self.solver)
        return forward.solve(self.actuation, self.loads if loaded else (), throw=throw)

    def deviations(self, equilibrium: Equilibrium) -> dict[str, tuple[float, float]]:
        """Largest deviation from each expected value, and the tolerance the file gives it."""
        torsions = [equilibrium.torsion(i, 0.0) for i in range(len(self.robot.tubes))]
        found = {
            "tip_position": equilibrium.tip_position,
            "tip_height_and_distance": _height_and_distance(equilibrium),
            "tip_direction": equilibrium.tip_pose[:3, 2],
            "base_torsions": np.array(torsions),
        }
        return {
            name: (float(np.abs(found[name] - self.expected[name]).max()), float(self.expected[tolerance]))
            for name, tolerance in _TOLERANCES.items()
            if name in self.expected
        }


def _height_and_distance(equilibrium: Equilibrium) -> Array:
    """The tip's height along the entry's z axis and its distance from it, m: the same however the robot is turned."""
    base = equilibrium.robot.base_pose
    x, y, z = base[:3, :3].T @ (equilibrium.tip_position - base[:3, 3])
    return np.array([z, np.hypot(x, y)])


def load_robot(path: str | os.PathLike[str], *, on_overlap: str = "warn") -> Robot:
    """Read a robot file.

    Parameters
    ----------
    path
        A TOML file with ``[[tubes]]`` from the innermost to the outermost; quantities are numbers in SI or texts with
        units (``"1.75 mm"``). CSV files it names are looked for beside it.
    on_overlap
        What to do where tubes do not nest: ``"warn"``, ``"error"`` or ``"ignore"``.

    Raises
    ------
    DefinitionError
        One sentence that names the file, the field, the value and what is allowed.

    Examples
    --------
    >>> load_robot("problems/rjw_s1/robot.toml").tubes[0].name
    'inner'
    """
    from .schemas import RobotSchema, load_checked

    file = Path(path)
    data = _at(file, "", lambda: load_checked(RobotSchema, _read_toml(file)))
    tubes = [_tube(file, k, table) for k, table in enumerate(data["tubes"])]
    pose = data.get("base", {}).get("pose")
    robot = _at(file, "", lambda: Robot(tubes, pose, on_overlap="ignore"))
    report_overlaps(robot, choice(on_overlap, "on_overlap", ON_OVERLAP), f"{file}: ")
    return robot


def save_robot(robot: Robot, path: str | os.PathLike[str]) -> None:
    """Write a robot file, SI numbers in full precision; :func:`load_robot` reads the same robot back."""
    import tomli_w

    if not isinstance(robot, Robot):
        raise DefinitionError(f"robot = {robot!r} must be a Robot")
    tables = [_tube_table(tube) for tube in robot.tubes]
    data: dict[str, Any] = {"base": {"pose": robot.base_pose.tolist()}, "tubes": tables}
    write_atomically(Path(path), lambda file: file.write_bytes(tomli_w.dumps(data).encode()))


def load_problem(path: str | os.PathLike[str], *, on_overlap: str = "warn") -> Problem:
    """Read a problem file: a robot file's name, actuation, loads, source and expected answer.

    Parameters
    ----------
    path
        A TOML file; see ``docs/files.md``.
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
    from .schemas import ProblemSchema, load_checked

    file = Path(path)
    table = _read_toml(file)
    if "cases" in table:
        raise DefinitionError(f"{file} is a plan of many cases: read it with load_plan")
    data = _at(file, "", lambda: load_checked(ProblemSchema, table))
    robot = load_robot(file.parent / data["robot"], on_overlap=on_overlap)
    actuation = _at(file, "actuation", lambda: Actuation(**data["actuation"]))
    loads = tuple(read_load(file, robot, k, table) for k, table in enumerate(data.get("load_tables", [])))
    solver = data.get("solver", {})
    forward = _at(file, "solver", lambda: ForwardProblem(robot, **solver))
    _at(file, "", lambda: forward.check(actuation, loads))
    return Problem(
        file,
        data["title"],
        robot,
        actuation,
        loads,
        solver,
        data.get("description", ""),
        data["source"]["text"],
        data["source"].get("does_not_claim", ""),
        _expected(file, robot, data.get("expected", {})),
    )


def check_file(path: str | os.PathLike[str], *, on_overlap: str = "warn") -> str:
    """Read a robot or problem file and say in a few lines what it holds.

    Raises
    ------
    DefinitionError
        As :func:`load_robot` and :func:`load_problem`.
    """
    from ..forward.report import robot_report

    file = Path(path)
    if "title" not in _read_toml(file):
        return robot_report(load_robot(file, on_overlap=on_overlap))
    problem = load_problem(file, on_overlap=on_overlap)
    loads = f"{len(problem.loads)} load{'' if len(problem.loads) == 1 else 's'}"
    length = ForwardProblem(problem.robot).check(problem.actuation, problem.loads).length
    lines = [robot_report(problem.robot), f"{problem.title}: length {1e3 * length:.3f} mm, {loads}"]
    return "\n".join([*lines, *(f"  {load}" for load in problem.loads)])


def find_problems(folder: str | os.PathLike[str]) -> list[Path]:
    """The problem files below a folder, in order; other TOML files (robots, plans, calibrations) are passed over."""
    root = Path(folder)
    if not root.is_dir():
        raise DefinitionError(f"there is no folder {str(root)!r}")
    return [file for file in sorted(root.rglob("*.toml")) if file.is_file() and _is_problem(file)]


def _is_problem(file: Path) -> bool:
    try:
        keys = set(_read_toml(file))
    except DefinitionError:
        return False
    return {"title", "robot"} <= keys and not keys & {"cases", "experiments", "measurements"}


def save_shape(equilibrium: Equilibrium, path: str | os.PathLike[str]) -> None:
    """Write the shape at :attr:`~ctr_opt.Equilibrium.arc_length` as ``.csv``, ``.npz`` or ``.json``; SI.

    Past a tube's end its torsion and angle are empty (CSV), null (JSON) or NaN (npz).
    """
    from .shapes import WRITERS

    file = Path(path)
    check_output(file, tuple(WRITERS))
    write_atomically(file, lambda temporary: WRITERS[file.suffix](equilibrium, temporary))


def _tube(file: Path, k: int, table: dict[str, Any]) -> Tube:
    place = f"tubes[{k}] ({table['name']!r})"
    pieces = [_piece(file, f"{place}.precurvature[{j}]", piece) for j, piece in enumerate(table["precurvature"])]
    return _at(file, f"tubes[{k}]", lambda: Tube(**{**table, "precurvature": pieces}))


def _piece(file: Path, place: str, table: Any) -> PrecurvaturePiece:
    from .schemas import PIECE_SCHEMAS, load_kind

    kind, values = _at(file, place, lambda: load_kind(PIECE_SCHEMAS, table))
    if kind == "sampled":
        values = _at(file, place, lambda: _sampled(file, values))
    kinds: dict[str, Callable[..., PrecurvaturePiece]] = {
        "straight": Straight,
        "arc": Arc,
        "polynomial": PolynomialCurvature,
        "sampled": SampledCurvature,
    }
    return _at(file, place, lambda: kinds[kind](**values))


def _sampled(file: Path, values: dict[str, Any]) -> dict[str, Any]:
    if "file" in values:
        if len(values) > 1:
            raise ValueError(".file is given beside lists: give one of them")
        table = read_csv(file.parent / values["file"], 4)
        return {"arc_length": table[:, 0], "curvature": table[:, 1:]}
    for name in ("arc_length", "curvature"):
        if name not in values:
            raise ValueError(f".{name} is missing: give arc_length and curvature, or file")
    return values


def read_load(file: Path, robot: Robot, k: int, table: Any) -> Load:
    """A load from its table, the k-th of a file."""
    from .schemas import LOAD_SCHEMAS, load_kind

    place = f"loads[{k}]"
    kind, values = _at(file, place, lambda: load_kind(LOAD_SCHEMAS, table))
    if "tube" in values:
        values["tube"] = _at(file, place, lambda: tube_index(robot, values["tube"]))
    if "file" in values:
        if "force" in values or "moment" in values:
            raise DefinitionError(f"{file}: {place}.file is given beside force or moment: give one of them")
        rows = read_csv(file.parent / values.pop("file"), 7)
        values["force"], values["moment"] = (rows[:, 0], rows[:, 1:4]), (rows[:, 0], rows[:, 4:])
    kinds: dict[str, Callable[..., Load]] = {
        "point": PointWrench,
        "distributed": DistributedLoad,
        "gravity": Gravity,
        "point_mass": PointMass,
        "distributed_mass": DistributedMass,
        "spring": Spring,
    }
    return _at(file, place, lambda: kinds[kind](**values))


def tube_index(robot: Robot, tube: Any) -> int:
    """Which tube is meant by a name or an index; ``ValueError`` where none is."""
    names = [each.name for each in robot.tubes]
    if isinstance(tube, str) and tube in names:
        return names.index(tube)
    if isinstance(tube, int) and not isinstance(tube, bool) and 0 <= tube < len(names):
        return tube
    raise ValueError(f".tube = {tube!r} must be a tube's name ({', '.join(names)}) or index (0 to {len(names) - 1})")


def _expected(file: Path, robot: Robot, values: dict[str, Any]) -> dict[str, Any]:
    for name, tolerance in _TOLERANCES.items():
        if name in values and tolerance not in values:
            raise DefinitionError(f"{file}: expected.{name} is given without expected.{tolerance}")
        if tolerance in values:
            _at(file, "expected", partial(number, values[tolerance], tolerance, above=0.0))
    if len(values.get("base_torsions", robot.tubes)) != len(robot.tubes):
        raise DefinitionError(f"{file}: expected.base_torsions must have {len(robot.tubes)} entries, one for each tube")
    return values


def _tube_table(tube: Tube) -> dict[str, Any]:
    names = ("name", "outer_diameter", "inner_diameter", "youngs_modulus", "shear_modulus", "poisson_ratio", "density")
    table = {name: getattr(tube, name) for name in names if getattr(tube, name) is not None}
    return {**table, **tube.given_stiffnesses, "precurvature": [_piece_table(piece) for piece in tube.precurvature]}


def _piece_table(piece: PrecurvaturePiece) -> dict[str, Any]:
    if isinstance(piece, Straight):
        return {"kind": "straight", "length": piece.length}
    if isinstance(piece, Arc):
        return {"kind": "arc", "length": piece.length, "curvature": piece.curvature.tolist()}
    if isinstance(piece, PolynomialCurvature):
        return {"kind": "polynomial", "length": piece.length, "coefficients": piece.coefficients.tolist()}
    return {"kind": "sampled", "arc_length": piece.arc_length.tolist(), "curvature": piece.curvature.tolist()}
