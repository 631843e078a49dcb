"""The derivatives that an equilibrium offers: Jacobian, compliance, sensitivities, forces on the actuators."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..checks import Array
from ..errors import DefinitionError
from ..layout.configuration import Configuration
from ..layout.observables import Observable
from ..loads.point import PointWrench
from ..robot.names import NamedNumber, chosen, parameters
from .outputs import output, place_of
from .sensitivity import Solved, derivatives, kinked

_APART = 1e-9  # relative: derivatives from the two sides that differ by less count as equal


def jacobian(solved: Solved, s: float | None, side: int) -> Array:
    """Derivative of the pose at ``s`` or at the tip by rotations and translations."""
    wanted = Observable("pose") if s is None else output(("pose", s), solved.configuration)
    return derivatives(solved, wanted, _joints(solved, "rotations", "translations"), side=_checked(side)).first


def compliance(solved: Solved, s: float | None, load_at: float | None, carrier: int) -> Array:
    """Derivative of the pose at ``s`` or at the tip by a wrench on a tube, added as a load of zero."""
    configuration = solved.configuration
    at = None if load_at is None else place_of(load_at, carrier, configuration, "load_at")
    extended = Configuration(
        configuration.robot, configuration.actuation, (*configuration.loads, PointWrench(arc_length=at, tube=carrier))
    )
    reached = configuration.length if s is None else place_of(s, None, configuration)
    present = carrier if configuration.ends.reaches(carrier, reached) else None
    wanted = Observable("pose", None if s is None else reached, present)
    name = f"loads[{len(configuration.loads)}]"
    added = chosen(
        parameters(configuration.robot, configuration.actuation, extended.loads), [f"{name}.force", f"{name}.moment"]
    )
    return derivatives(solved.under(extended), wanted, added).first


def sensitivity(solved: Solved, of: Any, wrt: str | Sequence[str], order: int, side: int) -> Array:
    """Derivative of an output by named parameters; the axes of the output come first."""
    configuration = solved.configuration
    if order not in (1, 2):
        raise DefinitionError(f"order = {order!r} must be 1 or 2")
    single = isinstance(wrt, str)
    selected = chosen(
        parameters(configuration.robot, configuration.actuation, configuration.loads),
        [wrt] if isinstance(wrt, str) else wrt,
    )
    wanted = output(of, configuration)
    result = derivatives(solved, wanted, selected, side=_checked(side), order=order)
    shape = selected[0].value.shape if single else (sum(parameter.size for parameter in selected),)
    if result.second is None:
        return result.first.reshape(wanted.shape + shape)
    return result.second.reshape(wanted.shape + shape + shape)


def actuator_wrench(solved: Solved, tube: int, side: int) -> tuple[float, float]:
    """Force and torque of the actuator on a tube's base."""
    wanted, moving = output(("actuator_wrench", tube), solved.configuration), _joints(solved, "translations")
    assert wanted.tube is not None
    force, torque = derivatives(solved, wanted, moving, side=_checked(side), at=wanted.tube).value
    return float(force), float(torque)


def base_wrench(solved: Solved) -> Array:
    """Force and moment of the robot on its support."""
    scales, shooting = solved.configuration.scales, solved.shooting
    force, moment = (part.full()[:, 0] for part in shooting.functions.support(solved.z, shooting.entry))
    wrench = np.concatenate((force * scales.force, moment * scales.moment))
    wrench.setflags(write=False)
    return wrench


def kinks(solved: Solved) -> tuple[int, ...]:
    """The tubes whose derivatives by translation differ between the two sides."""
    moving = _joints(solved, "translations")
    suspects = kinked(solved, moving)
    if not suspects:
        return ()
    sides = [derivatives(solved, Observable("pose"), moving, side=side) for side in (1, -1)]
    both = [np.vstack((one_side.first, one_side.unknowns)) for one_side in sides]
    apart = np.abs(both[0] - both[1]).max(axis=0) > _APART * np.abs(both[0]).max()
    return tuple(i for i in suspects if apart[i])


def _joints(solved: Solved, *names: str) -> list[NamedNumber]:
    configuration = solved.configuration
    return chosen(parameters(configuration.robot, configuration.actuation), names)


def _checked(side: int) -> int:
    if side not in (1, -1):
        raise DefinitionError(f"side = {side!r} must be 1 or -1")
    return side
