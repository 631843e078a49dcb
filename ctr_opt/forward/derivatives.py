"""The derivatives that an equilibrium offers: Jacobian, compliance, sensitivities, forces on the actuators."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..checks import Array, index, names_of, side_of, whole
from ..errors import DefinitionError
from ..layout.configuration import Configuration
from ..layout.observables import Observable
from ..loads.point import PointWrench
from ..robot.names import NamedNumber, chosen, parameters
from .compiled import Record
from .outputs import output, place_of
from .predicted import predicted
from .record import PoseRate, PoseRates
from .sensitivity import Solved, derivatives, kinked

_APART = 1e-9  # relative: derivatives from the two sides that differ by less count as equal
_APART_BESIDE = 1e-6  # likewise, if each is evaluated beside the point: see native/sided.h


Solve: TypeAlias = Callable[[], Solved]
"""The solution in numbers, for what compiled code does not know; computed on request."""


def jacobian(record: Record, solve: Solve, s: float | None, side: int) -> Array:
    """Derivative of the pose at ``s`` or at the tip by rotations and translations."""
    place = None if s is None else place_of(s, None, record.ends)
    rates = record.rates(PoseRate(place, side=side_of(side)))
    if rates is not None:
        return rates.jacobian
    solved = solve()
    wanted = Observable("pose") if place is None else output(("pose", place), solved.configuration)
    return derivatives(solved, wanted, _joints(solved, "rotations", "translations"), side=side).first


def compliance(record: Record, solve: Solve, s: float | None, load_at: float | None, carrier: int) -> Array:
    """Derivative of the pose at ``s`` or at the tip by a wrench on a tube, added as a load of zero."""
    if s is None and load_at is None:
        rates = record.tip_rates(carrier)
        if rates is not None:
            return rates.compliance
    ends = record.ends
    at = None if load_at is None else place_of(load_at, carrier, ends, "load_at")
    reached = ends.length if s is None else place_of(s, None, ends)
    present = carrier if ends.reaches(carrier, reached) else None
    frame = -1 if present is None or present == ends.innermost(reached) else present
    rates = record.rates(PoseRate(None if s is None else reached, frame, at, carrier))
    if rates is not None:
        return rates.compliance
    solved = solve()
    configuration = solved.configuration
    extended = Configuration(
        configuration.robot, configuration.actuation, (*configuration.loads, PointWrench(arc_length=at, tube=carrier))
    )
    wanted = Observable("pose", None if s is None else reached, present)
    name = f"loads[{len(configuration.loads)}]"
    added = chosen(
        parameters(configuration.robot, configuration.actuation, extended.loads), [f"{name}.force", f"{name}.moment"]
    )
    return derivatives(solved.under(extended), wanted, added).first


def sensitivity(record: Record, solve: Solve, of: Any, wrt: str | Sequence[str], order: int, side: int) -> Array:
    """Derivative of an output by named parameters; the axes of the output come first."""
    configuration = record.configuration
    order = whole(order, "order", 1, 2, meaning="1 or 2")
    single, names = isinstance(wrt, str), names_of(wrt, "wrt")
    if not names:
        raise DefinitionError("wrt is empty: name at least one parameter")
    selected = chosen(
        parameters(configuration.robot, configuration.actuation, configuration.loads),
        names,
    )
    wanted = output(of, configuration)
    shape = selected[0].value.shape if single else (sum(parameter.size for parameter in selected),)
    if order == 1:
        first = predicted(record, wanted, [parameter.name for parameter in selected], side_of(side))
        if first is not None:
            return first.reshape(wanted.shape + shape)
    result = derivatives(solve(), wanted, selected, side=side_of(side), order=order)
    if result.second is None:
        return result.first.reshape(wanted.shape + shape)
    return result.second.reshape(wanted.shape + shape + shape)


def actuator_wrench(record: Record, solve: Solve, tube: int, side: int) -> tuple[float, float]:
    """Force and torque of the actuator on a tube's base."""
    carrier = index(tube, "tube", len(record.robot.tubes))
    force = record.push(carrier, side_of(side))
    if force is None:
        solved = solve()
        wanted, moving = output(("actuator_wrench", carrier), solved.configuration), _joints(solved, "translations")
        force = float(derivatives(solved, wanted, moving, side=side, at=carrier).value[0])
    return force, -float(record.unknowns[2 + carrier])


def base_wrench(solved: Solved) -> Array:
    """Force and moment of the robot on its support."""
    scales, shooting = solved.configuration.scales, solved.shooting
    force, moment = (part.full()[:, 0] for part in shooting.functions.support(solved.z, shooting.entry))
    wrench = np.concatenate((force * scales.force, moment * scales.moment))
    wrench.setflags(write=False)
    return wrench


def coincide(record: Record, solve: Solve) -> bool:
    """Whether break points coincide that an actuation can move apart."""
    rates = record.rates(PoseRate())
    if rates is not None:
        return bool(_movable(record, rates).any())
    solved = solve()
    return bool(kinked(solved, _joints(solved, "translations")))


def _movable(record: Record, rates: PoseRates) -> NDArray[np.bool_]:
    """Which tubes' break points coincide with others and can be moved to both sides; a base at the entry cannot."""
    return np.logical_and(rates.coincide, record.actuation.translations < -record.ends.slack)


def kinks(record: Record, solve: Solve) -> tuple[int, ...]:
    """The tubes whose derivatives by translation differ between the two sides."""
    rates = record.rates(PoseRate())
    if rates is not None and (back := record.rates(PoseRate(side=-1))) is not None:
        suspects = np.flatnonzero(_movable(record, rates)).tolist()
        both, apart = [rates, back], _APART_BESIDE
        moved = [np.vstack((side.jacobian, side.unknowns))[:, len(rates.coincide) :] for side in both]
    else:
        solved = solve()
        moving = _joints(solved, "translations")
        suspects, apart = kinked(solved, moving), _APART
        sides = [derivatives(solved, Observable("pose"), moving, side=side) for side in (1, -1) if suspects]
        moved = [np.vstack((one_side.first, one_side.unknowns)) for one_side in sides]
    if not suspects:
        return ()
    different = np.abs(moved[0] - moved[1]).max(axis=0) > apart * np.abs(moved[0]).max()
    return tuple(i for i in suspects if different[i])


def _joints(solved: Solved, *names: str) -> list[NamedNumber]:
    configuration = solved.configuration
    return chosen(parameters(configuration.robot, configuration.actuation), names)
