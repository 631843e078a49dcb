"""Experiments: actuation, known loads and measurements."""

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
    """A tuple from one object of these kinds or a list; ``must`` replaces the kinds' names in messages."""
    try:
        items = (value,) if isinstance(value, kinds) else tuple(value)
    except TypeError:
        raise DefinitionError(f"{field} = {value!r} must be a list") from None
    for k, item in enumerate(items):
        if not isinstance(item, kinds):
            wanted = must or f"one of {', '.join(kind.__name__ for kind in kinds)}"
            raise DefinitionError(f"{field}[{k}] = {item!r} must be {wanted}")
    return items


def _loads(value: Any) -> tuple[Load, ...]:
    return several(value, (Load,), "loads", "a load")


def _measurements(value: Any) -> tuple[Measurement, ...]:
    measurements = several(value, MEASUREMENTS, "measurements")
    if not measurements:
        raise DefinitionError("measurements = [] must hold at least one measurement")
    return measurements


@attrs.frozen
class Experiment:
    """Actuation, known loads and measurements of a robot at rest.

    Parameters
    ----------
    actuation
        Rotations and translations of the tubes, an :class:`~ctr_opt.Actuation`.
    loads
        List of known loads.
    measurements
        One measurement or a list of them.
    name
        Name in reports and messages. Default: the experiment's number.

    Raises
    ------
    DefinitionError
        The message names the field, the value and what is allowed.

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
        """The observables of all measurements, in their order."""
        return tuple(observable for measurement in self.measurements for observable in measurement.observables)

    def framed(self, ends: Ends) -> tuple[Observable, ...]:
        """The observables with frames chosen for tube ends ``ends``: see :meth:`Observable.framed`."""
        return tuple(seen if seen.frame is not None else seen.framed(ends) for seen in self.observables)

    def check_robot(self, tubes: int, where: str = "") -> None:
        """Raise ``DefinitionError`` if actuation or measurements do not fit a robot with this number of ``tubes``."""
        if len(self.actuation.rotations) != tubes:
            count = len(self.actuation.rotations)
            raise DefinitionError(f"{where}actuation is for {count} tubes, but the robot has {tubes}")
        for measurement in self.measurements:
            measurement.check(tubes)

    def check_places(self, ends: Ends, where: str = "") -> None:
        """Raise ``DefinitionError`` for a measurement off the robot or off its tube; ``where`` begins the message."""
        furthest = {None: ends.length + ends.slack} | {i: end + ends.slack for i, end in enumerate(ends.points)}
        everywhere = min(furthest.values())
        for k, measurement in enumerate(self.measurements):
            for observable in measurement.observables:
                place = observable.place
                if isinstance(place, float) and 0.0 <= place <= everywhere:
                    continue
                s = 0.0 if isinstance(place, Somewhere) else arc_length_of(place, ends)
                if not 0.0 <= s <= furthest[observable.on]:
                    whose = "the robot" if observable.on is None else f"tube {observable.on}"
                    raise DefinitionError(
                        f"{where}measurements[{k}] is at s = {s:g} m, but {whose} reaches from 0 to "
                        f"{ends.of(observable.on):g} m there"
                    )

    @property
    def numbers(self) -> int:
        """Count of measured numbers."""
        return sum(blocks * size for blocks, size in (measurement.shape for measurement in self.measurements))
