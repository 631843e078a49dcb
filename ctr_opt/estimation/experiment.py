"""An experiment: how the robot was actuated and loaded, and what was measured."""

from __future__ import annotations

from typing import Any

import attrs

from ..errors import DefinitionError
from ..layout.ends import Ends
from ..layout.observables import Observable, Somewhere, arc_length_of
from ..loads.kind import Load
from ..robot.actuation import Actuation
from .measurements import MEASUREMENTS, Measurement


def several(value: Any, kinds: tuple[type, ...], field: str, must: str = "") -> tuple[Any, ...]:
    """One of these kinds or a list of them; ``must``: what they must be, if not one of the kinds by name."""
    try:
        given = (value,) if isinstance(value, kinds) else tuple(value)
    except TypeError:
        raise DefinitionError(f"{field} = {value!r} must be a list of them") from None
    for k, one in enumerate(given):
        if not isinstance(one, kinds):
            wanted = must or f"one of {', '.join(kind.__name__ for kind in kinds)}"
            raise DefinitionError(f"{field}[{k}] = {one!r} must be {wanted}")
    return given


def _loads(value: Any) -> tuple[Load, ...]:
    return several(value, (Load,), "loads", "a load")


def _measurements(value: Any) -> tuple[Measurement, ...]:
    given = several(value, MEASUREMENTS, "measurements")
    if not given:
        raise DefinitionError("measurements = [] must hold at least one measurement")
    return given


@attrs.frozen
class Experiment:
    """Actuation, known loads and measurements of a robot at rest.

    Parameters
    ----------
    actuation
        As in :class:`~ctr_opt.ForwardProblem`.
    loads
        A list of loads, as far as they are known.
    measurements
        One measurement or several.
    name
        To find it in reports; default: its number.

    Examples
    --------
    >>> import ctr_opt as ctr
    >>> tip = ctr.PositionMeasurement(None, [0.0, 0.0, 0.1], sigma=1e-3)
    >>> ctr.Experiment(ctr.Actuation([0.0], [0.0]), [], [tip]).numbers
    3
    """

    actuation: Actuation = attrs.field()
    loads: tuple[Load, ...] = attrs.field(default=(), converter=_loads)
    measurements: tuple[Measurement, ...] = attrs.field(default=(), converter=_measurements)
    name: str = ""

    @actuation.validator
    def _check_actuation(self, _: Any, value: Any) -> None:
        if not isinstance(value, Actuation):
            raise DefinitionError(f"actuation = {value!r} must be an Actuation")

    @property
    def observables(self) -> tuple[Observable, ...]:
        """Those of all measurements, in their order."""
        return tuple(one for measurement in self.measurements for one in measurement.observables)

    def framed(self, ends: Ends) -> tuple[Observable, ...]:
        """The same for a robot whose tubes end at ``ends``: see :meth:`Observable.framed`."""
        return tuple(one if one.frame is not None else one.framed(ends) for one in self.observables)

    def check_robot(self, tubes: int, where: str = "") -> None:
        """Refuse an actuation or measurements of another robot than one of so many tubes."""
        if len(self.actuation.rotations) != tubes:
            count = len(self.actuation.rotations)
            raise DefinitionError(f"{where}actuation is of {count} tubes, but the robot has {tubes}")
        for measurement in self.measurements:
            measurement.check(tubes)

    def check_places(self, ends: Ends, where: str = "") -> None:
        """Refuse measurements where the robot is not, or not the tube that is meant; ``where`` begins the message."""
        furthest = {None: ends.length + ends.slack} | {i: end + ends.slack for i, end in enumerate(ends.points)}
        everywhere = min(furthest.values())
        for k, measurement in enumerate(self.measurements):
            for one in measurement.observables:
                place = one.place
                if isinstance(place, float) and 0.0 <= place <= everywhere:
                    continue
                s = 0.0 if isinstance(place, Somewhere) else arc_length_of(place, ends)
                if not 0.0 <= s <= furthest[one.on]:
                    whose = "the robot" if one.on is None else f"tube {one.on}"
                    raise DefinitionError(
                        f"{where}measurements[{k}] is at s = {s:g} m, but {whose} reaches from 0 to "
                        f"{ends.of(one.on):g} m there"
                    )

    @property
    def numbers(self) -> int:
        """How many numbers were measured."""
        return sum(blocks * size for blocks, size in (one.shape for one in self.measurements))
