"""One robot in equilibrium under unknown loads: equations and predictions with derivatives, evaluated in place.

A controller estimates loads repeatedly, so that nothing may be built again. Numbers of loads and places of points are
therefore written into arrays that the model reads.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import attrs

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
class Evaluation:
    """Residual ``(n,)``, its slopes ``(n, n + numbers)`` by base moments and numbers, SI, and predictions."""

    residual: Array
    slopes: Array
    predictions: ObservedList


@attrs.frozen(eq=False)
class LoadedModel:
    """A model with the arrays of numbers that it reads, and its evaluation at base moments ``(1, n)``."""

    compiled: bool
    unknowns: int
    joints: list[Array]
    loads: list[Array]
    places: list[Array]
    evaluate: Callable[[Array], tuple[Array, ObservedList, Array]]

    def actuated(self, actuation: Actuation) -> None:
        """Set the actuation."""
        self.joints[0][:], self.joints[1][:] = actuation.rotations, actuation.translations

    def at(self, z: Array, values: Array, s: Array) -> Evaluation:
        """Evaluate at base moments, stacked numbers of loads, and estimated arc lengths of points."""
        start = 0
        for numbers in self.loads:
            numbers[:] = values[start : start + len(numbers)]
            start += len(numbers)
        for place, where in zip(self.places, s, strict=True):
            place[0] = where
        residual, predictions, slopes = self.evaluate(z[None])
        return Evaluation(residual[0], slopes[0], predictions)


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
    """Build a model with derivatives by changing numbers of loads, ``names``, and by fixed numbers, ``others``.

    ``steps`` returns the number of steps in each section; only a model that is not compiled calls it.
    """
    acting, joints = [*names, *others], ("rotations", "translations")
    if compilable(robot, loads, observables, acting, compiled):
        model = Predictions(robot, acting, [(actuation, loads)], observables)
        somewhere = [k for k, one in enumerate(observables) if isinstance(one.place, Somewhere)]
        places = [model.numbers(f"observables[{k}].arc_length") for k in somewhere]
        of_joints, of_loads = ([model.numbers(name) for name in group] for group in (joints, names))
        return LoadedModel(True, model.unknowns, of_joints, of_loads, places, partial(_compiled, model))
    symbolic = SymbolicModel(Configuration(robot, actuation, loads), observables, acting, steps())
    known = {name: one.value for name, one in parameters(robot, actuation, loads).items()}
    theta, parts = symbolic.numbers(known, actuation, loads, observables), symbolic.problem.parts
    of_joints, of_loads = ([theta[parts[name]] for name in group] for group in (joints, names))
    places = [theta[k : k + 1] for k in symbolic.somewhere]
    evaluate = partial(symbolic.evaluate, theta=theta[None])
    return LoadedModel(False, symbolic.unknowns, of_joints, of_loads, places, evaluate)


def _compiled(model: Predictions, z: Array) -> tuple[Array, ObservedList, Array]:
    predicted = model.at(z)
    if predicted.failed[0]:
        raise EstimationError("compiled code cannot lay out integration steps under these loads")
    return predicted.residual, predicted.observed, predicted.slopes
