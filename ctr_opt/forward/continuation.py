"""Continuation from one equilibrium to another: actuation and loads change in proportion."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import attrs
import numpy as np

from ..checks import Array
from ..layout.configuration import Configuration
from ..mechanics.kind import Kind
from ..robot.actuation import Actuation
from ..solvers.newton import System
from ..transcription.shooting import Shooting

Path: TypeAlias = Callable[[float], System]
"""A path of systems, by a parameter that runs from 0 to 1."""


@attrs.frozen(eq=False)
class Route:
    """The configurations between ``start`` and ``target``, all of the target's robot.

    Actuation changes linearly while the loads of the start fade and those of the target grow. A load that would fall
    off its tube on the way stays at the tube's end. All systems have the unknowns of ``kind``, which covers the loads
    of both ends.
    """

    start: Configuration
    target: Configuration
    integrator: str

    @property
    def kind(self) -> Kind:
        """The kind that covers the loads of both ends."""
        return self.start.kind.joined(self.target.kind)

    def configuration(self, parameter: float) -> Configuration:
        """Robot, actuation and loads at a point of the route."""
        a, b = self.start.actuation, self.target.actuation
        actuation = Actuation(
            a.rotations + parameter * (b.rotations - a.rotations),
            np.minimum(a.translations + parameter * (b.translations - a.translations), 0.0),
        )
        robot = self.target.robot
        ends = actuation.translations + np.array([tube.length for tube in robot.tubes])
        loads = [*self.start.loads_on(ends, 1.0 - parameter), *self.target.loads_on(ends, parameter)]
        return Configuration(robot, actuation, loads)

    def at(self, parameter: float) -> System:
        """The shooting problem at a point of the route, in the target's units."""
        configuration = self.configuration(parameter)
        shooting = Shooting(configuration, configuration.mesh(), self.integrator, self.kind)
        scales, unit = configuration.scales, self.target.scales
        units = np.full(shooting.unknowns, unit.moment / scales.moment)
        units[2 + configuration.tube_count :] = unit.force / scales.force
        return _Rescaled(shooting, units)


_IMPERFECTION = 0.01  # residual added at the start: moments at the tip, over max(EI) / length


def released(system: System, z: Array) -> Path:
    """A path from any point to a solution, along which the residual at that point is released in proportion."""
    return _faded(lambda _: system, system.linearize(z)[0])


def imperfect(path: Path, unknowns: int) -> Path:
    """A path of systems with small, fading moments at the tip, so that a perfect robot no longer bifurcates."""
    return _faded(path, _IMPERFECTION * np.cos(1.0 + 2.0 * np.arange(unknowns)))


def _faded(path: Path, offset: Array) -> Path:
    return lambda parameter: _Shifted(path(parameter), (1.0 - parameter) * offset)


@attrs.frozen(eq=False)
class _Shifted:
    system: System
    offset: Array

    def linearize(self, z: Array) -> tuple[Array, Array]:
        residual, jacobian = self.system.linearize(z)
        return residual - self.offset, jacobian


@attrs.frozen(eq=False)
class _Rescaled:
    """A shooting problem whose unknowns and residuals are multiplied by ``units``."""

    shooting: Shooting
    units: Array

    def linearize(self, z: Array) -> tuple[Array, Array]:
        residual, jacobian = self.shooting.linearize(z * self.units)
        return residual / self.units, jacobian * self.units / self.units[:, None]
