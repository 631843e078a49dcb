"""The outputs that can be differentiated, by name: attributes and methods of an equilibrium."""

from __future__ import annotations

from typing import Any

from ..checks import index, number
from ..errors import DefinitionError
from ..layout.configuration import Configuration
from ..layout.ends import Ends
from ..layout.observables import Observable

_ATTRIBUTES = {
    "tip_position": "position",
    "tip_pose": "pose",
    **{name: name for name in ("energy", "load_work", "potential_energy", "base_wrench")},
}
_METHODS = {
    **dict.fromkeys(("position", "pose", "curvature", "internal_force", "internal_moment"), ("s",)),
    **dict.fromkeys(("torsion", "tube_angle", "tube_moment"), ("tube", "s")),
    "actuator_wrench": ("tube",),
}


def output(of: Any, configuration: Configuration) -> Observable:
    """The observable for a name, or for a tuple of a method's name and its arguments."""
    parts = (of,) if isinstance(of, str) else of
    if not isinstance(parts, tuple) or not parts or not isinstance(parts[0], str):
        raise _unknown(of)
    name, arguments = parts[0], parts[1:]
    if name in _ATTRIBUTES and not arguments:
        return Observable(_ATTRIBUTES[name])
    names = ("s", "tube") if name == "pose" and len(arguments) == 2 else _METHODS.get(name, ())
    if not arguments or len(arguments) != len(names):
        raise _unknown(of)
    by_name = dict(zip(names, arguments, strict=True))
    tube = by_name.get("tube")
    if tube is not None or "tube" in _METHODS[name]:
        tube = index(tube, "tube", configuration.tube_count)
    place = place_of(by_name["s"], tube, configuration.ends) if "s" in by_name else None
    return Observable(name, place, tube)


def _unknown(of: Any) -> DefinitionError:
    calls = [f"({', '.join((repr(name), *names))})" for name, names in _METHODS.items()]
    return DefinitionError(
        f"of = {of!r} is not an output; allowed are {', '.join(map(repr, _ATTRIBUTES))}, {', '.join(calls)}, "
        "('pose', s, tube)"
    )


def place_of(s: Any, tube: int | None, ends: Ends, field: str = "s") -> float:
    """A checked arc length on the robot or a tube, moved exactly to a tube's end if it differs by rounding only."""
    return float(ends.snap(number(s, field, least=0.0, most=ends.of(tube) + ends.slack, unit="m")))


def from_left(observable: Observable, configuration: Configuration) -> bool:
    """Whether the value at its arc length is the limit from the left, as at the end of the tube or the robot."""
    place = observable.place
    return isinstance(place, float) and place >= configuration.ends.of(observable.tube)
