"""Residuals and predictions of many experiments at given unknowns, with exact derivatives, by compiled code.

Estimates from several experiments with one robot use these instead of equilibria. For given moments at the entry point
they give the residual of the equilibrium conditions and the predicted measurements, and the derivatives of both by the
unknowns and by parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any, TypeAlias

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array, array, index, number, whole
from ..errors import DefinitionError
from ..layout.ends import Ends
from ..layout.observables import Distal, Observable, Observed, ObservedList, Somewhere, Stacked
from ..loads.kind import Load
from ..mechanics.kind import kind_of
from ..robot.actuation import Actuation, joints_of
from ..robot.names import chosen, parameters, parsed
from ..robot.robot import Robot
from . import abi
from .calls import LoadRows, robot_table
from .directions import Directions, supported
from .library import library

__all__ = ["ModelValues", "Predictions", "predictable", "supported"]

_ANSWERS = {  # the answers that contain each quantity and its derivatives
    "pose": ("poses", "rates"),
    "tube_curvature": ("curvatures", "curvature_rates"),
    "actuator_force": ("forces", "force_rates"),
    "base_wrench": ("wrench", "wrench_rates"),
}
Experiment: TypeAlias = tuple[Actuation, Sequence[Load]]
_Probe: TypeAlias = tuple[float, int, int]
"""An arc length (NaN: the end), its tube, and the tube in whose frame something is observed."""


@attrs.frozen(eq=False)
class ModelValues:
    """The model's answers for ``e`` experiments; rows of failed experiments are NaN.

    Attributes
    ----------
    residual, slopes
        Residual of the conditions at the tip, ``(e, unknowns)``, N m and N, and its derivatives
        ``(e, unknowns, unknowns + parameters)``.
    observed
        Values of the observables, and their derivatives by unknowns and parameters.
    failed
        ``(e,)``: zero, or the reason of failure.
    rates
        All arrays of derivatives; the ones above are views of them.
    """

    residual: Array
    slopes: Array
    observed: ObservedList
    failed: NDArray[np.intc]
    rates: list[Array]


class Predictions:
    """Residuals and predictions of experiments with one robot, by its compiled model.

    Parameters
    ----------
    robot
        The robot.
    names
        Parameters by which derivatives are taken, see ``supported``. Names of loads refer to each experiment's loads.
    experiments
        The actuation and loads of each experiment.
    observables
        The observables predicted in every experiment, see ``predictable``.
    places
        ``(e, k)``, m: arc lengths of the observables at places, in their order, in each experiment; NaN: the end of the
        tube. Default: those of the observables, and 0 if their place is estimated.
    refinements
        Number of times that all steps are halved.
    side
        Side of the derivatives where break points coincide: +1 for a growing parameter, -1 for a shrinking one.

    Raises
    ------
    DefinitionError
        A parameter, load or observable that compiled code does not support; a place beyond its tube.
    CompilationError
        There is no compiler.

    Examples
    --------
    >>> import ctr_opt as ctr
    >>> from ctr_opt.layout.observables import Observable
    >>> from ctr_opt.native.predictions import Predictions
    >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)
    >>> held, push = ctr.Actuation([0.0], [0.0]), ctr.PointWrench(force=[0.01, 0.0, 0.0])
    >>> model = Predictions(ctr.Robot([tube]), ["loads[0].force"], [(held, [push])], [Observable("pose")])
    >>> model.at([[0.0, 1e-3, 0.0]]).observed[0].slopes.shape  # of one experiment, by three unknowns and a force
    (1, 6, 6)
    """

    def __init__(
        self,
        robot: Robot,
        names: Sequence[str],
        experiments: Sequence[Experiment],
        observables: Sequence[Observable],
        places: Array | None = None,
        refinements: int = 0,
        side: int = 1,
    ) -> None:
        if not experiments:
            raise DefinitionError("experiments is empty")
        self.robot, self.refinements, self.side = robot, whole(refinements, "refinements", 0), side
        kind = kind_of(load for _, loads in experiments for load in loads)
        self._native = library(len(robot.tubes), kind).built()
        self.observables = list(observables)
        self.unknowns = self._native.sizes.unknowns
        self._table = robot_table(robot)
        self._check(names, experiments[0])
        every = [None] * len(experiments) if places is None else list(places)
        ends = [Ends.of_robot(robot, actuation.translations) for actuation, _ in experiments]
        probes = [_probes(own, self.observables, s) for own, s in zip(ends, every, strict=True)]
        self._rows = [_rows(robot, loads, of_one) for (_, loads), of_one in zip(experiments, probes, strict=True)]
        self._addresses = np.array([rows.address for rows in self._rows], dtype=np.uintp)
        self._loads = [tuple(loads) for _, loads in experiments]
        self._actuations = np.array([joints_of(actuation) for actuation, _ in experiments])
        self._ask(self._directions(names, experiments), probes)

    def _check(self, names: Sequence[str], experiment: Experiment) -> None:
        """Raise an error for unknown, repeated or inactive names, and for observables that are not predictable."""
        chosen(parameters(self.robot, *experiment), names)
        for k, one in enumerate(self.observables):
            if not predictable(one, self.robot):
                raise DefinitionError(f"observables[{k}] = {one!r}: compiled code cannot predict it for this robot")

    def _ask(self, asked: list[Directions], probes: list[list[_Probe]]) -> None:
        """Prepare the queries of all experiments; the rows of probes are the first point loads."""
        self._combination = asked[0].combination
        self.parameters = self._combination.shape[1]
        self._plain = np.array_equal(self._combination, np.eye(len(self._combination)))
        frames = [[(k, frame) for k, (*_, frame) in enumerate(of_one)] for of_one in probes]
        rows = np.array(frames, dtype=np.intc).reshape(len(asked), -1, 2)
        directions = np.array([of_one.rows for of_one in asked], dtype=np.intc).reshape(len(asked), -1, 3)
        lists = {"directions": directions, "tables": np.ascontiguousarray(asked[0].tables), "probes": rows}
        counts = directions.shape[1], rows.shape[1]
        self._asked = abi.Structure(abi.Asked, **lists, count=counts[0], probe_count=counts[1])
        sizes = {"unknowns": self.unknowns, "columns": self.unknowns + counts[0], "probes": counts[1]}
        sizes["tubes"] = len(self.robot.tubes)
        names = [one.name for one in self.observables]
        left_out = [part for name, parts in _ANSWERS.items() if name not in ("pose", *names) for part in parts]
        kept = {name: shape for name, shape in abi.ANSWER.items() if name not in left_out}
        self._shapes = {name: [len(asked), *(sizes.get(n, n) for n in shape)] for name, shape in kept.items()}
        places = iter(range(len(names)))
        self._probe = {k: next(places) for k, one in enumerate(self.observables) if one.quantity.at == "place"}
        self._alike = _ANSWERS[names[0]] if len(set(names)) == 1 and len(self._probe) == len(names) else None

    def moved(self, robot: Robot, actuations: Array, places: Array | None = None) -> Predictions:
        """A copy with another robot of equal pieces and other actuations ``(e, 2 tubes)``.

        Loads stay, so tubes' weights must not change. Observables stay too, unless ``places`` are given.
        """
        copied = copy(self)
        copied.robot, copied._table, copied._actuations = robot, robot_table(robot), actuations
        if places is not None:
            rows = list(range(places.shape[1]))
            copied._rows = [loads.placed(rows, of_one) for loads, of_one in zip(self._rows, places, strict=True)]
            copied._addresses = np.array([rows.address for rows in copied._rows], dtype=np.uintp)
        return copied

    def numbers(self, name: str, experiment: int = 0) -> Array:
        """A writable view of an experiment's numbers; changes take effect in later calls.

        ``"loads[k].force"``, ``"loads[k].moment"``, ``"loads[k].arc_length"``, ``"observables[k].arc_length"``,
        ``"rotations"`` or ``"translations"``. Copies from ``moved`` share the numbers.
        """
        tubes = len(self.robot.tubes)
        if name in ("rotations", "translations"):
            actuation = self._actuations[experiment]
            return np.asarray(actuation[:tubes] if name == "rotations" else actuation[tubes:])
        rows = self._rows[experiment]
        match parsed(name):
            case ("observables", int(k), "arc_length"):
                return rows.numbers(None, self._probe[k], "arc_length")
            case ("loads", int(k), "force" | "moment" | "arc_length" as field):
                return rows.numbers(self._loads[experiment][k], rows.rows[k], field)
        raise DefinitionError(f"{name!r} does not name numbers of a load, an observable or an actuation")

    def _directions(self, names: Sequence[str], experiments: Sequence[Experiment]) -> list[Directions]:
        """The directions of each experiment; experiments with similar loads share them."""
        made: dict[tuple[Any, ...], Directions] = {}
        directions = []
        for (_, loads), rows in zip(experiments, self._rows, strict=True):
            key = tuple(
                (type(load), getattr(load, "arc_length", None) is None, rows.rows.get(k))
                for k, load in enumerate(loads)
            )
            if key not in made:
                made[key] = Directions.of(self.robot, loads, rows.rows, names)
            directions.append(made[key])
        if len({shared.combination.shape for shared in directions}) > 1:
            raise DefinitionError("experiments: loads of one name must be of one kind in all experiments")
        return directions

    def at(self, unknowns: Array) -> ModelValues:
        """Evaluate the model at unknowns ``(experiments, unknowns)``, ordered as ``Equilibrium.unknowns``."""
        count = len(self._rows)
        z = np.ascontiguousarray(array(unknowns, "unknowns", (count, self.unknowns)))
        values = {name: np.empty(shape) for name, shape in self._shapes.items()}
        failed = np.empty(count, dtype=np.intc)
        case = (self._table.address, self._addresses.ctypes.data, self._actuations.ctypes.data, z.ctypes.data, count)
        asked, answer = (self.refinements, self.side, self._asked.address), abi.Structure(abi.Answer, **values)
        if self._native.models(*case, *asked, answer.address, failed.ctypes.data):
            for numbers in values.values():
                numbers[failed != 0] = np.nan
        values = {name: self._combined(name, x) for name, x in values.items()}
        rates = [x for name, x in values.items() if abi.ANSWER[name][-1] == "columns"]
        return ModelValues(values["residual"], values["slopes"], self._observed(values, z), failed, rates)

    def _combined(self, name: str, rates: Array) -> Array:
        """Derivatives by parameters, from those by directions."""
        if self._plain or abi.ANSWER[name][-1] != "columns":
            return rates
        return np.concatenate((rates[..., : self.unknowns], rates[..., self.unknowns :] @ self._combination), axis=-1)

    def _observed(self, values: Mapping[str, Array], z: Array) -> ObservedList:
        """The values of the observables, from the model's answers."""
        if self._alike:
            return Stacked(*(values[part] for part in self._alike))
        return [self._one(k, one, values, z) for k, one in enumerate(self.observables)]

    def _one(self, k: int, one: Observable, values: Mapping[str, Array], z: Array) -> Observed:
        if one.name == "actuator_torque":  # the unknown itself
            slopes = np.zeros((len(z), 1, values["slopes"].shape[2]))
            slopes[:, 0, 2 + (one.tube or 0)] = -1.0
            return Observed(-z[:, 2 + (one.tube or 0), None], slopes)
        value, rates = (values[part] for part in _ANSWERS[one.name])
        if one.quantity.at == "place":
            return Observed(value[:, self._probe[k]], rates[:, self._probe[k]])
        if one.quantity.at == "tube":
            return Observed(value[:, one.tube, None], rates[:, one.tube, None])
        return Observed(value, rates)


def predictable(one: Observable, robot: Robot) -> bool:
    """Whether compiled code predicts an observable; forces require piecewise constant precurvatures."""
    if one.name == "actuator_force":
        return all(len(tube.shape.coefficients) == 1 for tube in robot.tubes)
    return one.name in _ANSWERS or one.name == "actuator_torque"


def arc_length(one: Observable) -> float:
    """The arc length of an observable; zero if it is estimated, NaN at an end."""
    return one.place if isinstance(one.place, float) else 0.0 if isinstance(one.place, Somewhere) else np.nan


def _probes(ends: Ends, observables: Sequence[Observable], places: Array | None) -> list[_Probe]:
    """The probes of observables at places."""
    probes: list[_Probe] = []
    for k, one in enumerate(observables):
        if one.quantity.at != "place":
            continue
        s = arc_length(one) if places is None else float(places[len(probes)])
        tube = one.place.tube if isinstance(one.place, Distal) else one.tube
        tube = tube if tube is None else index(tube, "tube", len(ends.points))
        if not np.isnan(s):
            s = number(s, f"observables[{k}].place", least=0.0, most=ends.of(tube) + ends.slack, unit="m")
        inner = ends.innermost(None if np.isnan(s) else s) if tube is None else tube
        frame = inner if one.carrier is None else one.carrier
        probes.append((s, ends.innermost() if tube is None else tube, frame))
    return probes


def _rows(robot: Robot, loads: Sequence[Load], probes: list[_Probe]) -> LoadRows:
    rows = LoadRows.of(robot, loads, [(s, tube) for s, tube, _ in probes])
    if rows is None:
        raise DefinitionError("loads: compiled code supports only loads that are constant or fixed to a tube")
    return rows
