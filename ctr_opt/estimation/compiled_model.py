"""The same model by compiled code, for the parameters and measurements that it knows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..errors import EstimationError
from ..layout.ends import SAME_POINT
from ..loads.kind import Load
from ..native import compile as compilation
from ..native.calls import LoadRows
from ..native.predictions import Predicted as Told
from ..native.predictions import Predictions, Probe, piecewise_constant, supported
from ..robot.actuation import Actuation
from ..robot.names import parsed
from ..robot.robot import Robot
from .measurements.kind import Distal, Prediction, Request, Somewhere

_PROBED = ("pose", "curvature")
_SOURCES = ("modulus", "poisson_ratio", "diameter", "density")  # derivatives by these change with the robot
_APART = 10.0 * SAME_POINT  # of the longest tube


def compilable(
    robot: Robot, loads: Sequence[Load], requests: Sequence[Request], acting: Sequence[str], wanted: bool | None
) -> bool:
    """Whether compiled code serves experiments with such loads, measurements and parameters.

    ``wanted``: True waits for the compiler and raises ``CompilationError`` where there is none, None uses compiled code
    where there is a compiler, unless it works on request only.
    """
    if wanted is False or (wanted is None and (compilation.on_request_only() or compilation.compiler() is None)):
        return False
    return (
        all(_known(request, robot) for request in requests)
        and all(supported(name, robot, loads) for name in acting)
        and LoadRows.of(robot, loads) is not None
    )


def _known(request: Request, robot: Robot) -> bool:
    """Whether a force is of tubes whose precurvatures are constant, and an end that of the tube that ends there."""
    if request.kind == "force":
        return piecewise_constant(robot)
    return not isinstance(request.place, Distal) or request.tube in (None, request.place.tube)


class CompiledModel:
    """Residuals and predictions of experiments, and derivatives by the ``acting`` parameters, in one call.

    ``requests``: those of each experiment, alike but for arc lengths; ``sizes``: of the parameters by their names.
    """

    def __init__(self, requests: Sequence[Sequence[Request]], sizes: Mapping[str, int]) -> None:
        self.requests = requests[0]
        self._requests = [probed(own) for own in requests]
        self._asked = asked(requests[0])
        self._numbers = np.array(
            [[each.place if isinstance(each.place, float) else np.nan for each in own] for own in self._requests]
        )
        self.acting = list(sizes)
        starts = dict(zip(sizes, np.cumsum([0, *sizes.values()]), strict=False))
        self._turned = starts.get("base.rotation")
        self._kept: tuple[list[int], Predictions] | None = None
        self._fixed = not any(parsed(name)[0] == "loads" or name.endswith(_SOURCES) for name in sizes)

    def evaluate(
        self,
        robot: Robot,
        experiments: Sequence[tuple[Actuation, Sequence[Load]]],
        z: Array,
        angles: Array,
        s: Array,
    ) -> tuple[Array, list[Prediction], Array]:
        """As :meth:`GroupModel.evaluate`.

        ``angles`` are those of the base, by which the robot is turned already; ``s (E, k)``: arc lengths of the points
        that are somewhere.
        """
        model = self._model(robot, experiments, s)
        told = model.at(z, **self._asked)
        if told.failed.any():
            joints = _parted(robot, experiments, np.flatnonzero(told.failed))
            ends = joints[:, len(robot.tubes) :] + [tube.length for tube in robot.tubes]
            places = self._places(np.minimum(s, ends.max(axis=1)[:, None])) | self._beyond(ends)
            told = model.moved(robot, joints, places).at(z, **self._asked)
        if told.failed.any():
            k = int(np.flatnonzero(told.failed)[0])
            raise EstimationError(f"compiled code refused experiment {k}: its steps cannot be laid out")
        if self._turned is not None:
            first = model.unknowns + int(self._turned)
            part, turn = slice(first, first + 3), euler_rates(angles)
            for rates in (told.slopes, told.rates, told.curvature_rates, told.force_rates):
                if rates is not None:
                    rates[..., part] = rates[..., part] @ turn
        return told.residual, predicted(self.requests, told, z), told.slopes

    def _model(self, robot: Robot, experiments: Sequence[tuple[Actuation, Sequence[Load]]], s: Array) -> Predictions:
        """The predictions, made anew only where loads, or what follows from the robot's numbers, are others."""
        ends = np.array([actuation.translations for actuation, _ in experiments])
        ends += [tube.length for tube in robot.tubes]
        longest, beyond = ends.argmax(axis=1).tolist(), self._beyond(ends)
        if self._kept is not None and self._fixed and self._kept[0] == longest:
            return self._kept[1].moved(robot, _joints(experiments), self._places(s) | beyond)
        probes = [
            _probes(own, tube, places) for own, tube, places in zip(self._requests, longest, s.tolist(), strict=True)
        ]
        for k, where in beyond.items():
            for e in np.flatnonzero(np.isnan(where)):
                probes[e][k] = Probe(None, probes[e][k].tube)
        model = Predictions(robot, self.acting, experiments, probes)
        self._kept = None if beyond else (longest, model)
        return model

    def _places(self, s: Array) -> dict[int, Array]:
        """Arc lengths of the probes that are somewhere, by their numbers."""
        somewhere = [k for k, request in enumerate(self._requests[0]) if isinstance(request.place, Somewhere)]
        return dict(zip(somewhere, s.T, strict=True))

    def _beyond(self, ends: Array) -> dict[int, Array]:
        """The arc lengths of probes that lie beyond their tubes' ends in some experiments; NaN there: at the end."""
        length = ends.max(axis=1)
        own = np.array([length if request.tube is None else ends[:, request.tube] for request in self._requests[0]])
        beyond = self._numbers > own.T.reshape(self._numbers.shape) + SAME_POINT * length[:, None]
        return {int(k): np.where(beyond[:, k], np.nan, self._numbers[:, k]) for k in np.flatnonzero(beyond.any(axis=0))}


def _joints(experiments: Sequence[tuple[Actuation, Sequence[Load]]]) -> Array:
    return np.array([np.concatenate((a.rotations, a.translations)) for a, _ in experiments])


def _parted(robot: Robot, experiments: Sequence[tuple[Actuation, Sequence[Load]]], those: NDArray[np.intp]) -> Array:
    """Joints with the tubes of ``those`` experiments drawn back a little, each by more than the one inside it.

    Where break points coincide, derivatives by translations have two sides: this chooses one.
    """
    joints, tubes = _joints(experiments), len(robot.tubes)
    joints[those, tubes:] -= _APART * max(tube.length for tube in robot.tubes) * np.arange(1, tubes + 1)
    return joints


def probed(requests: Sequence[Request]) -> list[Request]:
    """Those that are predicted at a probe each."""
    return [request for request in requests if request.kind in _PROBED]


def asked(requests: Sequence[Request]) -> dict[str, bool]:
    """What is asked for beside poses."""
    kinds = {request.kind for request in requests}
    return {"curvatures": "curvature" in kinds, "forces": "force" in kinds}


def predicted(requests: Sequence[Request], told: Told, z: Array) -> list[Prediction]:
    """The predictions asked for, at base moments ``z (E, unknowns)``."""
    found, probe = [], 0
    for request in requests:
        if request.kind in _PROBED:
            value, rates = of_probes(request.kind, told)
            found.append(Prediction(value[:, probe], rates[:, probe]))
            probe += 1
            continue
        tube = request.tube or 0
        if request.kind == "torque":
            found.append(_torque(z, tube, told.slopes.shape[2]))
            continue
        assert told.forces is not None
        assert told.force_rates is not None
        found.append(Prediction(told.forces[:, tube, None], told.force_rates[:, tube, None]))
    return found


def of_probes(kind: str, told: Told) -> tuple[Array, Array]:
    """Poses or curvatures at all probes, and their derivatives."""
    if kind == "pose":
        return told.poses, told.rates
    assert told.curvatures is not None
    assert told.curvature_rates is not None
    return told.curvatures, told.curvature_rates


def _torque(z: Array, tube: int, columns: int) -> Prediction:
    """An actuator's torque, by base moments ``z (E, unknowns)`` alone, and as many columns of slopes."""
    slopes = np.zeros((len(z), 1, columns))
    slopes[:, 0, 2 + tube] = -1.0
    return Prediction(-z[:, 2 + tube, None], slopes)


def probe_of(request: Request, longest: int, s: float = 0.0) -> Probe:
    """Where a pose or a curvature is asked for; that of a point somewhere on the ``longest`` tube at ``s``."""
    if isinstance(request.place, Somewhere):
        return Probe(s, longest)
    if isinstance(request.place, Distal):
        return Probe(None, request.place.tube)
    return Probe(request.place, request.tube)


def _probes(requests: Sequence[Request], longest: int, s: list[float]) -> list[Probe]:
    """The probes of an experiment, those of points somewhere on its longest tube."""
    somewhere = iter(s)
    return [probe_of(each, longest, next(somewhere) if isinstance(each.place, Somewhere) else 0.0) for each in requests]


def euler_rates(angles: Array) -> Array:
    """Takes rates of XYZ Euler angles to the angular velocity in the turned frame."""
    _, b, c = angles
    return np.array(
        [
            [np.cos(b) * np.cos(c), np.sin(c), 0.0],
            [-np.cos(b) * np.sin(c), np.cos(c), 0.0],
            [np.sin(b), 0.0, 1.0],
        ]
    )
