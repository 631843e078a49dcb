"""Residuals and predictions of many experiments at given unknowns, with exact derivatives, by compiled code.

What estimates need of one robot that was seen in several experiments: not equilibria, but how far given moments at the
entry point are from one, where the robot would then be, and how both change with the unknowns and with parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any, TypeAlias

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array, array, index, number
from ..errors import DefinitionError
from ..layout.ends import Ends
from ..loads.kind import Load
from ..mechanics.kind import constant_kind
from ..robot.actuation import Actuation
from ..robot.names import chosen, parameters, parsed
from ..robot.robot import Robot
from . import abi
from .calls import LoadRows, robot_table
from .directions import Directions, supported
from .library import library

__all__ = ["Predicted", "Predictions", "Probe", "piecewise_constant", "supported"]


@attrs.frozen
class Probe:
    """Where something is predicted: an arc length, m, or ``None``: the distal end, of a tube or (``None``) the robot.

    ``Probe()`` is the tip. An arc length stays where it is when tubes are moved, a distal end moves along. What is
    predicted is seen in the ``frame`` of a tube; default: that tube, or the innermost that is there. Past its end a
    tube's frame is carried on without twist.
    """

    arc_length: float | None = None
    tube: int | None = None
    frame: int | None = None


_CURVATURES, _FORCES = ("curvatures", "curvature_rates"), ("forces", "force_rates")  # told where asked for

Experiment: TypeAlias = tuple[Actuation, Sequence[Load]]
_Place: TypeAlias = tuple[float | None, int, int]


@attrs.frozen(eq=False)
class Predicted:
    """What the model says of ``e`` experiments; rows of failed ones are not numbers.

    Attributes
    ----------
    residual, slopes
        ``(e, unknowns)``, N m and N: what is left of the conditions at the tip; its derivatives ``(e, unknowns,
        unknowns + parameters)``.
    poses, rates
        ``(e, probes, 3, 4)``: orientation of the tube's material frame and position, m; ``(e, probes, 6, unknowns +
        parameters)``: derivatives of the position, and world angular velocities.
    curvatures, curvature_rates
        ``(e, probes, 3)``: of the tube in its material frame, 1/m, behind any load there; at the tube's end the limit
        from within it; ``(e, probes, 3, unknowns + parameters)``. None unless they were asked for.
    forces, force_rates
        ``(e, tubes)``: of the actuators on the tubes' bases, N, as ``Equilibrium.actuator_wrench`` has them, where the
        precurvatures are constant piece by piece; ``(e, tubes, unknowns + parameters)``. None unless asked for.
    failed
        ``(e,)``: zero, or why there is nothing.
    """

    residual: Array
    slopes: Array
    poses: Array
    rates: Array
    failed: NDArray[np.intc]
    curvatures: Array | None = None
    curvature_rates: Array | None = None
    forces: Array | None = None
    force_rates: Array | None = None


class Predictions:
    """Experiments with one robot before its compiled model.

    Parameters
    ----------
    robot
        The robot.
    names
        Parameters by which derivatives are taken, see ``supported``; those of loads are of each experiment's own.
        ``"probes[k].arc_length"``: of a probe, where it has one.
    experiments
        Actuation and loads of each.
    probes
        Probes, or pairs of an arc length and a tube: the same in every experiment, or one list for each, alike long.
    refinements
        How often the steps are halved.

    Raises
    ------
    DefinitionError
        A name that is not supported; a load that compiled code does not know; a probe that is not on its tube.
    CompilationError
        There is no compiler.

    Examples
    --------
    >>> import ctr_opt as ctr
    >>> from ctr_opt.native.predictions import Predictions, Probe
    >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)
    >>> push = ctr.PointWrench(force=[0.01, 0.0, 0.0])
    >>> model = Predictions(ctr.Robot([tube]), ["loads[0].force"], [(ctr.Actuation([0.0], [0.0]), [push])], [Probe()])
    >>> model.at([[0.0, 1e-3, 0.0]]).rates.shape  # of one experiment, one probe, by three unknowns and a force
    (1, 1, 6, 6)
    """

    def __init__(
        self,
        robot: Robot,
        names: Sequence[str],
        experiments: Sequence[Experiment],
        probes: Sequence[Probe | tuple[float | None, int | None]] | Sequence[Sequence[Probe]],
        refinements: int = 0,
    ) -> None:
        self.robot, self.refinements = robot, index(refinements, "refinements")
        kind = constant_kind(load for _, loads in experiments for load in loads)
        self._native = library(len(robot.tubes), kind).built()
        self.unknowns = self._native.sizes.unknowns
        self._table = robot_table(robot)
        every = zip(experiments, _each(probes, experiments), strict=True)
        places = [_places(robot, actuation, own) for (actuation, _), own in every]
        self._rows = [_rows(robot, loads, own) for (_, loads), own in zip(experiments, places, strict=True)]
        self._addresses = np.array([rows.address for rows in self._rows], dtype=np.uintp)
        self._loads = [tuple(loads) for _, loads in experiments]
        self._actuations = np.array([np.concatenate((a.rotations, a.translations)) for a, _ in experiments])
        _check(robot, names, *experiments[0])
        self._ask(self._directions(names, experiments, len(places[0])), places)

    def _ask(self, asked: list[Directions], places: list[list[_Place]]) -> None:
        """The questions of every experiment; its probes' rows are the first of its point loads."""
        self._combination = asked[0].combination
        self.parameters = self._combination.shape[1]
        self._plain = np.array_equal(self._combination, np.eye(len(self._combination)))
        frames = [[(k, frame) for k, (*_, frame) in enumerate(each)] for each in places]
        own = np.array(frames, dtype=np.intc).reshape(len(asked), -1, 2)
        directions = np.array([each.rows for each in asked], dtype=np.intc).reshape(len(asked), -1, 3)
        lists = {"directions": directions, "tables": np.ascontiguousarray(asked[0].tables), "probes": own}
        self._asked = abi.Table(abi.Asked, **lists, count=directions.shape[1], probe_count=own.shape[1])
        self._sizes = len(asked), own.shape[1], directions.shape[1]

    def moved(self, robot: Robot, actuations: Array, places: Mapping[int, Array] | None = None) -> Predictions:
        """The same with another robot of equal pieces and actuations ``(e, 2 tubes)``, rotations and translations.

        Loads stay, so that tubes' weights must be as they were, and so do probes, but for those with ``places``: arc
        lengths ``(e,)`` by their numbers, each on the probe's tube.
        """
        other = copy(self)
        other.robot, other._table, other._actuations = robot, robot_table(robot), actuations
        if places:
            numbers, where = list(places), np.stack(list(places.values()), axis=1)
            other._rows = [rows.placed(numbers, own) for rows, own in zip(self._rows, where, strict=True)]
            other._addresses = np.array([rows.address for rows in other._rows], dtype=np.uintp)
        return other

    def numbers(self, name: str, experiment: int = 0) -> Array:
        """A view of an experiment's own numbers; what is written there counts from then on.

        ``"loads[k].force"``, ``"loads[k].moment"``, ``"loads[k].arc_length"``, ``"probes[k].arc_length"``,
        ``"rotations"`` or ``"translations"``. Copies that were ``moved`` see it, too.
        """
        tubes = len(self.robot.tubes)
        if name in ("rotations", "translations"):
            own = self._actuations[experiment]
            return np.asarray(own[:tubes] if name == "rotations" else own[tubes:])
        rows = self._rows[experiment]
        match parsed(name):
            case ("probes", int(k), "arc_length"):
                return rows.numbers(None, k, "arc_length")
            case ("loads", int(k), "force" | "moment" | "arc_length" as field):
                return rows.numbers(self._loads[experiment][k], rows.rows[k], field)
        raise DefinitionError(f"{name!r} names no numbers of a load, a probe or an actuation")

    def _directions(self, names: Sequence[str], experiments: Sequence[Experiment], probes: int) -> list[Directions]:
        """Of each experiment; those whose loads are alike share them."""
        made: dict[tuple[Any, ...], Directions] = {}
        found = []
        for (_, loads), rows in zip(experiments, self._rows, strict=True):
            key = tuple(
                (type(load), getattr(load, "arc_length", None) is None, rows.rows.get(k))
                for k, load in enumerate(loads)
            )
            if key not in made:
                made[key] = Directions.of(self.robot, loads, rows.rows, names, probes)
            found.append(made[key])
        if len({each.combination.shape for each in found}) > 1:
            raise DefinitionError("experiments: loads of one name must be of one kind in all of them")
        return found

    def at(self, unknowns: Array, *, curvatures: bool = False, forces: bool = False) -> Predicted:
        """Everything at unknowns ``(experiments, unknowns)``, N m and N, in the order of ``Equilibrium.unknowns``."""
        if forces and not piecewise_constant(self.robot):
            raise DefinitionError("forces: compiled code tells them of precurvatures that are constant piece by piece")
        count, probes, directions = self._sizes
        z = np.ascontiguousarray(array(unknowns, "unknowns", (count, self.unknowns)))
        sizes = {"unknowns": self.unknowns, "columns": self.unknowns + directions, "probes": probes}
        sizes["tubes"] = len(self.robot.tubes)
        left_out = [*([] if curvatures else _CURVATURES), *([] if forces else _FORCES)]
        shapes = {name: shape for name, shape in abi.ANSWER.items() if name not in left_out}
        values = {name: np.empty([count, *(sizes.get(n, n) for n in shape)]) for name, shape in shapes.items()}
        failed = np.empty(count, dtype=np.intc)
        case = (self._table.address, self._addresses.ctypes.data, self._actuations.ctypes.data, z.ctypes.data, count)
        asked, answer = (self.refinements, self._asked.address), abi.Table(abi.Answer, **values)
        if self._native.models(*case, *asked, answer.address, failed.ctypes.data):
            for numbers in values.values():
                numbers[failed != 0] = np.nan
        return Predicted(failed=failed, **{name: self._combined(name, x) for name, x in values.items()})

    def _combined(self, name: str, rates: Array) -> Array:
        """From derivatives by directions to those by parameters."""
        if self._plain or abi.ANSWER[name][-1] != "columns":
            return rates
        return np.concatenate((rates[..., : self.unknowns], rates[..., self.unknowns :] @ self._combination), axis=-1)


def piecewise_constant(robot: Robot) -> bool:
    """Whether the tubes' precurvatures are constant piece by piece, so that compiled code tells actuators' forces."""
    return all(len(tube.shape.coefficients) == 1 for tube in robot.tubes)


def _each(probes: Sequence[object], experiments: Sequence[Experiment]) -> list[list[Probe]]:
    """The probes of every experiment."""
    if not experiments:
        raise DefinitionError("experiments is empty")
    own = bool(probes) and isinstance(probes[0], list)
    every = list(probes) if own else [probes] * len(experiments)
    made = [[each if isinstance(each, Probe) else Probe(*each) for each in row] for row in every]  # type: ignore[attr-defined]
    if len(made) != len(experiments) or len({len(row) for row in made}) > 1:
        raise DefinitionError("probes must be one list, or one of the same length for each experiment")
    return made


def _places(robot: Robot, actuation: Actuation, probes: Sequence[Probe]) -> list[_Place]:
    """Arc lengths, or None for the end, the tubes that they are on, and those in whose frame they are."""
    ends, found = Ends.of_robot(robot, actuation.translations), []
    for k, each in enumerate(probes):
        s, tube = each.arc_length, each.tube if each.tube is None else index(each.tube, "tube", len(robot.tubes))
        if s is not None:
            s = number(s, f"probes[{k}].arc_length", least=0.0, most=ends.of(tube) + ends.slack, unit="m")
        frame = ends.innermost(s) if tube is None else tube
        found.append((s, ends.innermost() if tube is None else tube, frame if each.frame is None else each.frame))
    return found


def _rows(robot: Robot, loads: Sequence[Load], places: list[_Place]) -> LoadRows:
    rows = LoadRows.of(robot, loads, [place[:2] for place in places])
    if rows is None:
        raise DefinitionError("loads: compiled code knows those that are constant or fixed to a tube alone")
    return rows


def _check(robot: Robot, names: Sequence[str], actuation: Actuation, loads: Sequence[Load]) -> None:
    """Raise an error for names that are none, stand twice, or do not act."""
    own = [name for name in names if parsed(name)[:1] != ("probes",)]
    chosen(parameters(robot, actuation, loads), own)
