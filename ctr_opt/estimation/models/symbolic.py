"""Symbolic model of experiments: residual and predictions, and their derivatives by the acting parameters.

Experiments whose loads and measurements have the same structure differ in numbers only. One CasADi function therefore
serves them all: it sorts break points itself, and its arguments are the base moments and the numbers.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from functools import cached_property
from typing import Any, cast

import attrs
import casadi as ca
import numpy as np

from ...checks import Array
from ...layout.configuration import Configuration
from ...layout.observables import Observable, Observed, Somewhere, posed
from ...loads.density import LoadTable
from ...loads.kind import Load
from ...robot.actuation import Actuation
from ...robot.names import NamedNumber, parameters, parsed
from ...robot.robot import Robot
from ...transcription.observing import Observer
from ...transcription.parametric_problem import ParametricProblem

_PROBES = "probes"
_INTEGRATOR = "RK8"


def structure(robot: Robot, actuation: Actuation, loads: Sequence[Load], observables: Sequence[Observable]) -> Hashable:
    """A key that is equal for experiments that one function serves; ``observables`` are framed."""
    known = parameters(robot, actuation, loads)
    of_loads = tuple(_structure(load, f"loads[{k}].", known) for k, load in enumerate(loads))
    return of_loads, tuple(attrs.evolve(one, place=0.0) if isinstance(one.place, float) else one for one in observables)


def _structure(load: Load, prefix: str, known: dict[str, NamedNumber]) -> Hashable:
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


def _numbers(observables: Sequence[Observable]) -> Array:
    """Arc lengths of the observables with a place, m; zero if the place is estimated."""
    return np.array([one.place if isinstance(one.place, float) else 0.0 for one in observables if one.placed])


class SymbolicModel:
    """Residual and observables of all experiments that share the structure of a configuration.

    ``observables`` are framed. Derivatives are by the ``acting`` parameters: names of parameters of robot and loads,
    ``"rotations"`` and ``"translations"``.
    """

    def __init__(
        self, configuration: Configuration, observables: Sequence[Observable], acting: Sequence[str], steps: int
    ) -> None:
        self.configuration = configuration
        self.observables = list(observables)
        self.acting = list(acting)
        known = parameters(configuration.robot, configuration.actuation, configuration.loads)
        of_loads = [name for name, one in known.items() if parsed(name)[0] == "loads" and not one.idle]
        data = ["rotations", "translations", *of_loads]
        places = _numbers(self.observables)
        probes = [NamedNumber(_PROBES, places)] if len(places) else []
        of_robot = [known[name] for name in self.acting if name not in data]
        at = list(zip(places.tolist(), [one.on for one in self.observables if one.placed], strict=True))
        self.problem = ParametricProblem(
            configuration, [*of_robot, *(known[name] for name in data), *probes], _INTEGRATOR, at, clip=True
        )
        order = self.problem.sorted()
        cuts = [np.linspace(0.0, 1.0, steps + 1)] * order.sections
        self._observer = Observer(self.observables, self.problem, order, cuts)
        scales = configuration.scales
        self.unit: Array = scales.unknowns(configuration.tube_count, configuration.kind.live)
        self.unknowns = len(self.unit)
        self._mapped: dict[int, ca.Function] = {}

    @cached_property
    def active(self) -> list[int]:
        """Indices of the numbers with derivatives, which follow those by the unknowns."""
        parts = self.problem.parts
        return [k for name in self.acting for k in range(parts[name].start, parts[name].stop)]

    @cached_property
    def somewhere(self) -> list[int]:
        """Indices of the numbers that are estimated places."""
        placed = [one.place for one in self.observables if one.placed]
        start = self.problem.parts[_PROBES].start if placed else 0
        return [start + k for k, place in enumerate(placed) if isinstance(place, Somewhere)]

    @cached_property
    def function(self) -> ca.Function:
        """The CasADi function ``(z, theta) -> (residual and values, their derivatives)``, SI."""
        count, active = int(self.problem.theta.shape[0]), self.active
        z, theta = ca.MX.sym("z", self.unknowns), ca.MX.sym("theta", count)
        moved = ca.MX.sym("moved", self.unknowns + len(active))
        full = ca.MX(theta)
        if active:
            full[active] = moved[self.unknowns :]
        swept = self._observer.discretized.swept(moved[: self.unknowns] / self.unit, full)
        values = ca.vertcat(swept.residual * self.unit, *self._observer.values(swept))
        slopes = ca.Function("slopes", [moved, theta], [values, ca.densify(ca.jacobian(values, moved))])
        at = ca.vertcat(z, theta[active]) if active else z
        return ca.Function("model", [z, theta], list(slopes(at, theta)), ["z", "theta"], ["values", "slopes"])

    # -- numbers ---------------------------------------------------------------------------------------------------

    def numbers(
        self, values: dict[str, Array], actuation: Actuation, loads: Sequence[Load], observables: Sequence[Observable]
    ) -> Array:
        """The numbers ``theta`` of an experiment, in the function's order."""
        known = {name: one.value for name, one in parameters(self.configuration.robot, actuation, loads).items()}
        known |= values | {_PROBES: _numbers(observables)}
        return np.concatenate([np.ravel(known[name]) for name in self.problem.parts])

    def evaluate(self, z: Array, theta: Array) -> tuple[Array, list[Observed], Array]:
        """Residuals, observables and slopes of the residuals at ``z (E, unknowns)`` and ``theta (E, k)``."""
        count, n = len(z), self.unknowns
        if count not in self._mapped:
            self._mapped[count] = self.function.map(count)
        values, slopes = (part.full() for part in self._mapped[count](z.T, theta.T))
        slopes = np.moveaxis(slopes.reshape(len(slopes), count, -1), 1, 0)
        observed, start = [], n
        for one in self.observables:
            part = slice(start, start := start + one.quantity.size)
            made = posed if one.name == "pose" else Observed
            observed.append(made(values[part].T, slopes[:, part]))
        return values[:n].T, observed, slopes[:, :n]
