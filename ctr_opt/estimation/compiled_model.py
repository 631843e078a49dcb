"""The same model by compiled code, for the parameters and measurements that it knows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..errors import EstimationError
from ..layout.ends import SAME_POINT, innermost
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
        (piecewise_constant(robot) or all(request.kind != "force" for request in requests))
        and all(supported(name, robot, loads) for name in acting)
        and LoadRows.of(robot, loads) is not None
    )


class CompiledModel:
    """Residuals and predictions of experiments, and derivatives by the ``acting`` parameters, in one call.

    ``requests``: those of each experiment, framed, alike except for arc lengths; ``sizes``: of the parameters by name.
    """

    def __init__(self, requests: Sequence[Sequence[Request]], sizes: Mapping[str, int]) -> None:
        self.requests = requests[0]
        self._requests = [probed(own) for own in requests]
        self._asked = asked(requests[0])
        self._numbers = np.array([[arc_length(each) for each in own] for own in self._requests])
        self.acting = list(sizes)
        starts = dict(zip(sizes, np.cumsum([0, *sizes.values()]), strict=False))
        self._turned = starts.get("base.rotation")
        self._somewhere = [k for k, each in enumerate(self._requests[0]) if isinstance(each.place, Somewhere)]
        self._kept: tuple[list[int], Array, Predictions] | None = None
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
        joints = np.array([np.concatenate((a.rotations, a.translations)) for a, _ in experiments])
        told = self._model(robot, experiments, joints, s).at(z, **self._asked)
        if told.failed.any():
            joints = _parted(robot, joints, np.flatnonzero(told.failed))
            told = self._model(robot, experiments, joints, s).at(z, **self._asked)
        if told.failed.any():
            k = int(np.flatnonzero(told.failed)[0])
            raise EstimationError(f"compiled code refused experiment {k}: its steps cannot be laid out")
        if self._turned is not None:
            first = z.shape[1] + int(self._turned)
            part, turn = slice(first, first + 3), euler_rates(angles)
            for rates in (told.slopes, told.rates, told.curvature_rates, told.force_rates):
                if rates is not None:
                    rates[..., part] = rates[..., part] @ turn
        return told.residual, predicted(self.requests, told, z), told.slopes

    def _model(
        self, robot: Robot, experiments: Sequence[tuple[Actuation, Sequence[Load]]], joints: Array, s: Array
    ) -> Predictions:
        """The predictions, built again only where loads, or what follows from the robot's numbers, have changed."""
        ends = joints[:, len(robot.tubes) :] + [tube.length for tube in robot.tubes]
        longest, places = innermost(ends).tolist(), self._places(ends, s)
        if self._kept is None or not self._fixed or self._kept[0] != longest:
            both = zip(self._requests, places.tolist(), strict=True)
            probes = [[probe_of(*each) for each in zip(*one, strict=True)] for one in both]
            self._kept = longest, places, Predictions(robot, self.acting, experiments, probes)
        _, before, model = self._kept
        same = (places == before) | (np.isnan(places) & np.isnan(before))
        return model.moved(robot, joints, {int(k): places[:, k] for k in np.flatnonzero(~same.all(axis=0))})

    def _places(self, ends: Array, s: Array) -> Array:
        """Arc lengths of the probes ``(E, probes)``; not numbers where they are at the end of what they are on."""
        length = ends.max(axis=1)
        places = self._numbers.copy()
        places[:, self._somewhere] = np.minimum(s, length[:, None])
        for k, request in enumerate(self._requests[0]):
            most = length if request.on is None else ends[:, request.on]
            places[places[:, k] > most + SAME_POINT * length, k] = np.nan
        return places


def _parted(robot: Robot, joints: Array, those: NDArray[np.intp]) -> Array:
    """Joints ``(E, 2 tubes)`` with the tubes of ``those`` experiments drawn back a little, outer ones by more.

    Where break points coincide, derivatives by translations have two sides: this chooses one.
    """
    joints, tubes = joints.copy(), len(robot.tubes)
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


def arc_length(request: Request) -> float:
    """Where it is asked for; zero where that is estimated, not a number at an end."""
    return (
        request.place if isinstance(request.place, float) else 0.0 if isinstance(request.place, Somewhere) else np.nan
    )


def probe_of(request: Request, s: float) -> Probe:
    """A pose or a curvature that is asked for: at ``s`` or, if not a number, at the end of what the place is on."""
    on = request.place.tube if isinstance(request.place, Distal) else request.tube
    return Probe(None if np.isnan(s) else s, on, request.tube if request.frame is None else request.frame)


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
