"""One robot at rest under loads that are sought: its equations and predictions with derivatives, evaluated in place.

Where a shape is looked at again and again, as by a controller, nothing may be built anew: the numbers of loads and the
places of points are written into what the model reads.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import attrs
import numpy as np

from ..checks import Array
from ..errors import EstimationError
from ..estimation.models.compiled import compilable
from ..estimation.models.symbolic import SymbolicModel
from ..layout.configuration import Configuration
from ..layout.observables import Observable, ObservedList, Somewhere
from ..loads.kind import Load
from ..native.predictions import Predictions
from ..robot.actuation import Actuation
from ..robot.names import parameters
from ..robot.robot import Robot


@attrs.frozen(eq=False)
class Told:
    """Equations ``(n,)`` and their slopes ``(n, n + numbers)`` by base moments and numbers, SI; predictions."""

    residual: Array
    slopes: Array
    predictions: ObservedList


class LoadedModel(Protocol):
    """What both kinds of model can tell."""

    unknowns: int

    def actuated(self, actuation: Actuation) -> None:
        """From now on at another actuation."""

    def at(self, z: Array, values: Array, s: Array) -> Told:
        """At base moments, numbers of loads one behind the other, and arc lengths of points that are somewhere."""


def loaded_model(
    robot: Robot,
    actuation: Actuation,
    loads: Sequence[Load],
    names: Sequence[str],
    others: Sequence[str],
    observables: Sequence[Observable],
    compiled: bool | None,
    steps: Callable[[], int],
) -> LoadedModel:
    """A model with derivatives by the loads' numbers of these ``names``, which may change, and by the ``others``.

    ``steps``: in each section, where it is not compiled.
    """
    every = [*names, *others]
    if compilable(robot, loads, observables, every, compiled):
        return _Compiled(robot, actuation, loads, names, others, observables)
    return _Symbolic(robot, actuation, loads, names, others, observables, steps())


class _Compiled:
    def __init__(
        self,
        robot: Robot,
        actuation: Actuation,
        loads: Sequence[Load],
        names: Sequence[str],
        others: Sequence[str],
        observables: Sequence[Observable],
    ) -> None:
        self._model = Predictions(robot, [*names, *others], [(actuation, loads)], observables)
        somewhere = [k for k, one in enumerate(observables) if isinstance(one.place, Somewhere)]
        self._places = [self._model.numbers(f"observables[{k}].arc_length") for k in somewhere]
        self._loads = [self._model.numbers(name) for name in names]
        self._joints = [self._model.numbers(name) for name in ("rotations", "translations")]
        self.unknowns = self._model.unknowns

    def actuated(self, actuation: Actuation) -> None:
        self._joints[0][:], self._joints[1][:] = actuation.rotations, actuation.translations

    def at(self, z: Array, values: Array, s: Array) -> Told:
        start = 0
        for own in self._loads:
            own[:] = values[start : start + len(own)]
            start += len(own)
        for place, where in zip(self._places, s, strict=True):
            place[0] = where
        told = self._model.at(z[None])
        if told.failed[0]:
            raise EstimationError("compiled code refused these loads: its steps cannot be laid out")
        return Told(told.residual[0], told.slopes[0], told.observed)


class _Symbolic:
    def __init__(
        self,
        robot: Robot,
        actuation: Actuation,
        loads: Sequence[Load],
        names: Sequence[str],
        others: Sequence[str],
        observables: Sequence[Observable],
        steps: int,
    ) -> None:
        configuration = Configuration(robot, actuation, loads)
        self._model = SymbolicModel(configuration, observables, [*names, *others], steps)
        known = {name: each.value for name, each in parameters(robot, actuation, loads).items()}
        self._theta = self._model.numbers(known, actuation, loads, observables)
        count = sum(known[name].size for name in names)
        self._moving = np.array(self._model.active[:count], dtype=np.intp)
        self._places = np.array(self._model.somewhere, dtype=np.intp)
        parts = self._model.problem.parts
        self._joints = parts["rotations"], parts["translations"]
        self.unknowns = self._model.unknowns

    def actuated(self, actuation: Actuation) -> None:
        self._theta[self._joints[0]], self._theta[self._joints[1]] = actuation.rotations, actuation.translations

    def at(self, z: Array, values: Array, s: Array) -> Told:
        self._theta[self._moving] = values
        self._theta[self._places] = s
        residual, found, slopes = self._model.evaluate(z[None], self._theta[None])
        return Told(residual[0], slopes[0], found)
