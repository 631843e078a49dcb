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


def _several(value: Any, field: str) -> tuple[Any, ...]:
    try:
        return tuple(value)
    except TypeError:
        raise DefinitionError(f"{field} = {value!r} must be a list of them") from None


def _loads(value: Any) -> tuple[Load, ...]:
    given = (value,) if isinstance(value, Load) else _several(value, "loads")
    for k, load in enumerate(given):
        if not isinstance(load, Load):
            raise DefinitionError(f"loads[{k}] = {load!r} must be a load")
    return given


def _measurements(value: Any) -> tuple[Measurement, ...]:
    given = (value,) if isinstance(value, MEASUREMENTS) else _several(value, "measurements")
    if not given:
        raise DefinitionError("measurements = [] must hold at least one measurement")
    for k, each in enumerate(given):
        if not isinstance(each, MEASUREMENTS):
            names = ", ".join(kind.__name__ for kind in MEASUREMENTS)
            raise DefinitionError(f"measurements[{k}] = {each!r} must be one of {names}")
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
        return tuple(one for each in self.measurements for one in each.observables)

    def framed(self, ends: Ends) -> tuple[Observable, ...]:
        """The same for a robot whose tubes end at ``ends``: see :meth:`Observable.framed`."""
        return tuple(one.framed(ends) for one in self.observables)

    def check_robot(self, tubes: int, where: str = "") -> None:
        """Refuse an actuation or measurements of another robot than one of so many tubes."""
        if len(self.actuation.rotations) != tubes:
            count = len(self.actuation.rotations)
            raise DefinitionError(f"{where}actuation is of {count} tubes, but the robot has {tubes}")
        for measurement in self.measurements:
            measurement.check(tubes)

    def check_places(self, ends: Ends, where: str = "") -> None:
        """Refuse measurements where the robot is not, or not the tube that is meant; ``where`` begins the message."""
        for k, measurement in enumerate(self.measurements):
            for one in measurement.observables:
                s = 0.0 if isinstance(one.place, Somewhere) else arc_length_of(one.place, ends)
                if s < 0.0 or not ends.reaches(one.on, s):
                    whose = "the robot" if one.on is None else f"tube {one.on}"
                    raise DefinitionError(
                        f"{where}measurements[{k}] is at s = {s:g} m, but {whose} reaches from 0 to "
                        f"{ends.of(one.on):g} m there"
                    )

    @property
    def numbers(self) -> int:
        """How many numbers were measured."""
        return sum(each.shape[0] * each.shape[1] for each in self.measurements)
