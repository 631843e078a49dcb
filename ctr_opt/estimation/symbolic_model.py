"""The model of experiments of one kind, symbolically: residual and predictions, and their derivatives by what acts.

Experiments whose loads and measurements have the same structure differ by numbers alone, so that one CasADi function
serves them all: break points are sorted inside, and its unknowns are the base moments and what the numbers are.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from functools import cached_property
from typing import Any, cast

import attrs
import casadi as ca
import numpy as np

from ..checks import Array
from ..layout.configuration import Configuration
from ..loads.density import LoadTable
from ..loads.kind import Load
from ..mechanics.fields import material_frame
from ..mechanics.state import State
from ..robot.actuation import Actuation
from ..robot.names import Parameter, parameters, parsed
from ..robot.robot import Robot
from ..transcription.integrals import integral_functions
from ..transcription.parametric_problem import Discretized, ParametricProblem
from .measurements.kind import Distal, Prediction, Request, Somewhere

SIZES = {"pose": 12, "curvature": 3, "torque": 1, "force": 1}
_PROBES = "probes"
_INTEGRATOR = "RK8"


def structure(robot: Robot, actuation: Actuation, loads: Sequence[Load], requests: Sequence[Request]) -> Hashable:
    """Equal for experiments that one function serves; ``requests`` are framed."""
    known = parameters(robot, actuation, loads)
    own = tuple(_structure(load, f"loads[{k}].", known) for k, load in enumerate(loads))
    return own, tuple(attrs.evolve(r, place=0.0) if isinstance(r.place, float) else r for r in requests)


def _structure(load: Load, prefix: str, known: dict[str, Parameter]) -> Hashable:
    parts: list[Any] = [type(load)]
    for field in attrs.fields(cast(Any, type(load))):
        value = getattr(load, field.name)
        parameter = known.get(prefix + field.name)
        if parameter is not None and not parameter.idle:
            knots = value.arc_length.tobytes() if isinstance(value, LoadTable) else None
            parts.append((field.name, parameter.value.shape, knots))
        elif isinstance(value, np.ndarray):
            parts.append((field.name, value.tobytes()))
        else:
            parts.append((field.name, value if isinstance(value, (str, int, float, bool, type(None))) else id(value)))
    return tuple(parts)


def _numbers(requests: Sequence[Request]) -> Array:
    """The places that are numbers; zero where they are estimated."""
    return np.array([r.place if isinstance(r.place, float) else 0.0 for r in requests if _numbered(r)])


def _numbered(request: Request) -> bool:
    return isinstance(request.place, (float, Somewhere))


def _jumps(request: Request) -> bool:
    """Whether the prediction may jump where it is wanted, and is taken from one side."""
    return request.kind == "curvature" and request.place is not None


class GroupModel:
    """Residual and predictions of experiments with the structure of a configuration.

    ``requests`` are framed; ``acting`` are the names of the robot's and loads' parameters, ``"rotations"`` and
    ``"translations"``, by which derivatives are wanted.
    """

    def __init__(
        self, configuration: Configuration, requests: Sequence[Request], acting: Sequence[str], steps: int
    ) -> None:
        self.configuration = configuration
        self.requests = list(requests)
        self.acting = list(acting)
        known = parameters(configuration.robot, configuration.actuation, configuration.loads)
        of_loads = [name for name, one in known.items() if parsed(name)[0] == "loads" and not one.idle]
        data = ["rotations", "translations", *of_loads]
        places = _numbers(self.requests)
        probes = [Parameter(_PROBES, places)] if len(places) else []
        own = [known[name] for name in self.acting if name not in data]
        at = list(zip(places.tolist(), [r.on for r in self.requests if _numbered(r)], strict=True))
        self.problem = ParametricProblem(
            configuration, [*own, *(known[name] for name in data), *probes], _INTEGRATOR, at, clip=True
        )
        order = self.problem.sorted()
        cuts = [np.linspace(0.0, 1.0, steps + 1)] * order.sections
        self._pushed = [r.tube or 0 for r in self.requests if r.kind == "force"]
        self._sections = order.sections if self._curved or self._pushed else 0
        around = [(k, 1) for k in range(self._sections)] + [(k + 1, 0) for k in range(self._sections)]
        marks = self._marks()
        ends = [self.problem.parametric.tube_end(r.tube or 0) for r in self.requests if _jumps(r)]
        sides = list(zip([mark for mark, r in marks if _jumps(r)], ends, strict=True))
        self._discretized = Discretized(
            self.problem,
            order,
            cuts,
            around,
            integrals=bool(self._pushed),
            marks=[mark for mark, r in marks if not _jumps(r)],
            sides=sides,
        )
        scales = configuration.scales
        self.unit: Array = scales.unknowns(configuration.tube_count, configuration.kind.live)
        self.unknowns = len(self.unit)
        self._mapped: dict[int, ca.Function] = {}

    @property
    def _curved(self) -> bool:
        return any(request.kind == "curvature" for request in self.requests)

    def _marks(self) -> list[tuple[Any, Request]]:
        """The break points where predictions are wanted, but for the tip, and which."""
        marks, probe = [], 0
        for request in self.requests:
            if isinstance(request.place, Distal):
                marks.append((self.problem.parametric.tube_end(request.place.tube), request))
            elif request.place is not None:
                marks.append((("probe", probe), request))
                probe += 1
        return marks

    @cached_property
    def active(self) -> list[int]:
        """The numbers by which there are derivatives, behind those by the unknowns."""
        parts = self.problem.parts
        return [k for name in self.acting for k in range(parts[name].start, parts[name].stop)]

    @cached_property
    def somewhere(self) -> list[int]:
        """The numbers that are places which are estimated."""
        numbered = [request for request in self.requests if _numbered(request)]
        start = self.problem.parts[_PROBES].start if numbered else 0
        return [start + k for k, request in enumerate(numbered) if isinstance(request.place, Somewhere)]

    @cached_property
    def function(self) -> ca.Function:
        """``(z, theta) -> (residual, values, their derivatives)``, SI."""
        count, active = int(self.problem.theta.shape[0]), self.active
        z, theta = ca.MX.sym("z", self.unknowns), ca.MX.sym("theta", count)
        moved = ca.MX.sym("moved", self.unknowns + len(active))
        full = ca.MX(theta)
        if active:
            full[active] = moved[self.unknowns :]
        swept = self._discretized.swept(moved[: self.unknowns] / self.unit, full)
        told = ca.vertcat(swept.residual * self.unit, *self._values(swept))
        slopes = ca.Function("slopes", [moved, theta], [told, ca.densify(ca.jacobian(told, moved))])
        at = ca.vertcat(z, theta[active]) if active else z
        value, jacobian = slopes(at, theta)
        return ca.Function("model", [z, theta], [value, jacobian], ["z", "theta"], ["told", "slopes"])

    def _values(self, swept: Any) -> list[Any]:
        configuration = self.configuration
        tubes, length = configuration.tube_count, configuration.scales.length
        found, mark, side = [], 0, 0
        for request in self.requests:
            if request.kind == "torque":
                found.append(-swept.z[2 + (request.tube or 0)] * configuration.scales.moment)
                continue
            if request.kind == "force":
                found.append(self._force(swept, request.tube or 0))
                continue
            if request.kind == "curvature":
                weights = None if request.place is None else swept.sides[:, side]
                found.append(self._curvature(swept, weights, request.tube))
                side += int(_jumps(request))
                continue
            if request.place is None:
                vector = swept.left[:, -1]
            else:
                vector, mark = swept.right @ swept.weights[:, mark], mark + 1
            state = State.split(vector, tubes)
            angle = state.angles[request.frame or 0]
            found += [state.position * length, ca.vec(material_frame(state.orientation, angle))]
        return found

    def _curvature(self, swept: Any, weights: Any, tube: int | None) -> Any:
        """``u_x, u_y`` in a tube's frame, and the tube's own ``u_z``, 1/m; ``weights`` of sides, None at the tip."""
        places = ca.horzcat(*swept.locals.values())
        states = ca.horzcat(swept.right[:, : self._sections], swept.left)
        vector, local = (each[:, -1] if weights is None else each @ weights for each in (states, places))
        bent, twisted, _, _ = self.problem.functions.local(vector, local)
        angle = State.split(vector, self.configuration.tube_count).angles[tube]
        c, s = ca.cos(angle), ca.sin(angle)
        rotated = ca.vertcat(c * bent[0] + s * bent[1], c * bent[1] - s * bent[0], twisted[tube])
        return rotated / self.configuration.scales.length

    def _force(self, swept: Any, tube: int) -> Any:
        """On a tube's base: as ``actuator_wrench`` has it, its break points wherever they stand in the order."""
        scales, discretized = self.configuration.scales, self._discretized
        functions = integral_functions(self.configuration.tube_count, _INTEGRATOR, discretized.kind)
        *_, forces = functions.step.map(len(discretized.steps))(swept.begins, swept.columns, swept.slopes)
        states = ca.horzcat(swept.right[:, : self._sections], swept.left)
        energies = functions.hamiltonian.map(2 * self._sections)(states, ca.horzcat(*swept.locals.values()))
        weights, behind = self.problem.actuated(tube, discretized.order)(swept.theta, swept.z[2 + tube] * scales.moment)
        return (ca.sum2(forces[tube, :]) + energies @ weights) * scales.force + behind

    # -- numbers ---------------------------------------------------------------------------------------------------

    def numbers(
        self, values: dict[str, Array], actuation: Actuation, loads: Sequence[Load], requests: Sequence[Request]
    ) -> Array:
        """The numbers of an experiment as the function takes them."""
        known = parameters(self.configuration.robot, actuation, loads)
        theta = np.empty(int(self.problem.theta.shape[0]))
        for name, part in self.problem.parts.items():
            if name == _PROBES:
                theta[part] = _numbers(requests)
            elif name in values:
                theta[part] = np.ravel(values[name])
            else:
                theta[part] = known[name].value.ravel()
        return theta

    def evaluate(self, z: Array, theta: Array) -> tuple[Array, list[Prediction], Array]:
        """Of experiments ``z (E, unknowns)``, ``theta (E, k)``: residuals, predictions, and the residuals' slopes."""
        count, n = len(z), self.unknowns
        if count not in self._mapped:
            self._mapped[count] = self.function.map(count)
        told, slopes = (part.full() for part in self._mapped[count](z.T, theta.T))
        slopes = np.moveaxis(slopes.reshape(len(slopes), count, -1), 1, 0)
        found, start = [], n
        for request in self.requests:
            part = slice(start, start + SIZES[request.kind])
            value, rates, start = told[part].T, slopes[:, part], part.stop
            found.append(_poses(value, rates) if request.kind == "pose" else Prediction(value, rates))
        return told[:n].T, found, slopes[:, :n]


def _poses(numbers: Array, slopes: Array) -> Prediction:
    """Poses ``(E, 3, 4)`` and their six rates from positions and frames, column by column."""
    count = len(numbers)
    frames = np.swapaxes(numbers[:, 3:].reshape(count, 3, 3), 1, 2)
    rates = slopes[:, 3:].reshape(count, 3, 3, -1)  # [column, row]
    turn = np.einsum("ecrk,eqc->erqk", rates, frames)  # dR R^T
    turned = 0.5 * np.stack(
        (turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]), axis=1
    )
    poses = np.concatenate((frames, numbers[:, :3, None]), axis=2)
    return Prediction(poses, np.concatenate((slopes[:, :3], turned), axis=1))
