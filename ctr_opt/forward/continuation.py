"""From one equilibrium to another: actuation and loads changed in proportion."""

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
"""Systems by a parameter that runs from 0 to 1."""


@attrs.frozen(eq=False)
class Route:
    """The configurations between ``start`` and ``target``, all of the target's robot.

    Actuation runs linearly from one to the other while the first loads fade and the second grow; a load that would
    fall off its tube on the way stays at its end. All are stated with the unknowns that ``kind``, the loads of both
    ends together, asks for.
    """

    start: Configuration
    target: Configuration
    integrator: str

    @property
    def kind(self) -> Kind:
        """What provides for the loads of both ends."""
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
        own, unit = configuration.scales, self.target.scales
        units = np.full(shooting.unknowns, unit.moment / own.moment)
        units[2 + configuration.tube_count :] = unit.force / own.force
        return _Rescaled(shooting, units)


_IMPERFECTION = 0.01  # residual put on at the start: moments at the tip, over max(EI) / length


def released(system: System, z: Array) -> Path:
    """A path from any point to a solution: the residual that the point leaves is released in proportion."""
    return _faded(lambda _: system, system.linearize(z)[0])


def imperfect(path: Path, unknowns: int) -> Path:
    """A path of systems with small moments at the tip that fade along it: what is perfect no longer bifurcates."""
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
    """A problem whose unknowns (and residuals) are given in ``units`` times its own."""

    shooting: Shooting
    units: Array

    def linearize(self, z: Array) -> tuple[Array, Array]:
        residual, jacobian = self.shooting.linearize(z * self.units)
        return residual / self.units, jacobian * self.units / self.units[:, None]
