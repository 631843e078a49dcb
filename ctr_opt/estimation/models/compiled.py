"""Compiled model of experiments, for the parameters and observables that compiled code supports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ...checks import Array
from ...errors import EstimationError
from ...layout.ends import SAME_POINT, chained, innermost
from ...layout.observables import Observable, ObservedList, Somewhere
from ...loads.kind import Load
from ...native import compile as compilation
from ...native.calls import LoadRows
from ...native.predictions import Predictions, arc_length, predictable, supported
from ...robot.actuation import Actuation, actuation_of, joints_of
from ...robot.names import euler_rates, field_of, parsed
from ...robot.robot import Robot
from ...robot.tube import SOURCES

_CHANGING = {*SOURCES, "density"}  # derivatives by these change with the robot
_APART = 10.0 * SAME_POINT  # of the longest tube


def compilable(
    robot: Robot, loads: Sequence[Load], observables: Sequence[Observable], acting: Sequence[str], wanted: bool | None
) -> bool:
    """Whether compiled code supports these loads, observables and parameters.

    ``wanted=True`` waits for the compiler and raises ``CompilationError`` without one. ``wanted=None`` uses compiled
    code if there is a compiler, unless compilation is on request only.
    """
    if wanted is False or (wanted is None and (compilation.on_request_only() or compilation.compiler() is None)):
        return False
    return (
        all(predictable(one, robot) for one in observables)
        and all(supported(name, robot, loads) for name in acting)
        and LoadRows.of(robot, loads) is not None
    )


class CompiledModel:
    """Residuals and observables of all experiments, and derivatives by the ``acting`` parameters, in one call.

    ``observables`` holds the framed observables of each experiment, which differ in arc lengths only. ``sizes`` are the
    parameters' sizes by name.
    """

    def __init__(self, observables: Sequence[Sequence[Observable]], sizes: Mapping[str, int]) -> None:
        self.observables = observables[0]
        placed = [[one for one in of_experiment if one.quantity.at == "place"] for of_experiment in observables]
        self._numbers = np.array([[arc_length(one) for one in of_experiment] for of_experiment in placed])
        self._on = [one.on for one in placed[0]]
        self._somewhere = [k for k, one in enumerate(placed[0]) if isinstance(one.place, Somewhere)]
        self.acting = list(sizes)
        starts = dict(zip(sizes, np.cumsum([0, *sizes.values()]), strict=False))
        self._turned = starts.get("base.rotation")
        self._kept: dict[tuple[tuple[str, ...], bytes], tuple[Array, Predictions]] = {}
        self._fixed = not any(parsed(name)[0] == "loads" or field_of(name) in _CHANGING for name in sizes)

    def evaluate(
        self,
        robot: Robot,
        experiments: Sequence[tuple[Actuation, Sequence[Load]]],
        z: Array,
        angles: Array,
        s: Array,
    ) -> tuple[Array, ObservedList, Array]:
        """Residuals, observables and slopes, as :meth:`SymbolicModel.evaluate` returns them.

        ``angles`` are the base's Euler angles, which ``robot`` already contains. ``s (E, k)`` are estimated arc
        lengths.
        """
        joints = np.array([joints_of(actuation) for actuation, _ in experiments])
        values = self._model(self.acting, robot, experiments, joints, s).at(z)
        if values.failed.any():  # derivatives have sides: choose one; values are those of the joints as they are
            parted = _parted(robot, joints, np.flatnonzero(values.failed))
            values = self._model(self.acting, robot, experiments, parted, s).at(z)
            whole = self._model([], robot, experiments, joints, s).at(z)
            values.residual[:] = whole.residual
            for k in range(len(self.observables)):
                values.observed[k].value[:] = whole.observed[k].value
        if values.failed.any():
            k = int(np.flatnonzero(values.failed)[0])
            raise EstimationError(f"compiled code cannot lay out integration steps for experiment {k}")
        if self._turned is not None:
            first = z.shape[1] + int(self._turned)
            part, turn = slice(first, first + 3), euler_rates(angles)
            for rates in values.rates:
                rates[..., part] = rates[..., part] @ turn
        return values.residual, values.observed, values.slopes

    def _model(
        self,
        names: Sequence[str],
        robot: Robot,
        experiments: Sequence[tuple[Actuation, Sequence[Load]]],
        joints: Array,
        s: Array,
    ) -> Predictions:
        """Predictions with derivatives by the named parameters, at joints ``(E, 2 tubes)``.

        They are built again only if loads, or numbers derived from the robot's, have changed.
        """
        ends = chained(joints[:, len(robot.tubes) :] + [tube.length for tube in robot.tubes])
        places, key = self._places(ends, s), (tuple(names), innermost(ends).tobytes())
        if key not in self._kept or not self._fixed:
            cases = [(actuation_of(at), loads) for at, (_, loads) in zip(joints, experiments, strict=True)]
            self._kept[key] = places, Predictions(robot, names, cases, self.observables, places)
        before, model = self._kept[key]
        return model.moved(robot, joints, None if np.array_equal(places, before, equal_nan=True) else places)

    def _places(self, ends: Array, s: Array) -> Array:
        """Arc lengths of placed observables ``(E, k)``; not a number at the end of the tube or robot."""
        length = ends.max(axis=1)
        places = self._numbers.copy()
        places[:, self._somewhere] = np.minimum(s, length[:, None])
        for k, tube in enumerate(self._on):
            most = length if tube is None else ends[:, tube]
            places[places[:, k] > most + SAME_POINT * length, k] = np.nan
        return places


def _parted(robot: Robot, joints: Array, moved: NDArray[np.intp]) -> Array:
    """Joints ``(E, 2 tubes)`` with the tubes of the ``moved`` experiments slightly advanced, outer tubes by more.

    This separates coinciding break points in the order in which symbols are sorted, and derivatives by translations
    become one-sided. A tube whose base is at the entry point is retracted instead, an inner tube by more.
    """
    joints, tubes = joints.copy(), len(robot.tubes)
    step = _APART * max(tube.length for tube in robot.tubes)
    ahead, back = step * np.arange(1, tubes + 1), -step * np.arange(tubes, 0, -1)
    joints[moved, tubes:] += np.where(joints[moved, tubes:] + ahead <= 0.0, ahead, back)
    return joints
