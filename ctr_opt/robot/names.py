"""Named parameters of a robot, its actuation and its loads: parsed, described, read and replaced.

Derivatives, estimates, reports and files refer to numbers by these names. This module decides what a name means, and
its unit, scale, bounds, symbol and labels. Loads describe their own numbers (:class:`NamedLoad`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from functools import cache
from typing import Any, Protocol, Self, TypeVar, cast

import attrs
import numpy as np

from ..checks import Array
from ..errors import DefinitionError
from .actuation import Actuation
from .precurvature import PIECES
from .robot import Robot
from .tube import STIFFNESSES, Tube

_UNITS = {
    **{name: entry.unit for kind in (Actuation, Tube, *PIECES) for name, entry in kind.entries.items()},
    **dict.fromkeys(("translation", "translation_offset"), "m"),
    **dict.fromkeys(("rotation", "rotation_offset"), "rad"),
    **dict.fromkeys(("force", "normal_force"), "N"),
    **{"force_density": "N/m", "moment": "N m"},
}
_SHOWN = {"1": (1.0, ""), "m": (1e3, "mm"), "rad": (180.0 / np.pi, "deg"), "Pa": (1e-9, "GPa"), "N m": (1e3, "N mm")}
_SYMBOLS = {"bending_stiffness": "EI", "torsional_stiffness": "GJ", "youngs_modulus": "E", "shear_modulus": "G"}
_AXES = ("x", "y", "z")
_ALONG = ("translations", "translation", "translation_offset", "arc_length", "start", "end")
_POSITIVE = ("stiffness", "modulus", "diameter", "length")  # ends of fields
_FACTOR = 100.0  # largest ratio between a positive number and its initial value, by default
_STEP = r"[^\W\d]\w*(?:\[\d+(?:, \d+)*\])?"
_NAME = re.compile(rf"{_STEP}(?:\.{_STEP})*")


@cache
def parsed(name: str) -> tuple[str | int, ...]:
    """Split a name into its parts; empty if the text is not a valid name.

    >>> parsed("tubes[0].precurvature[1].curvature")
    ('tubes', 0, 'precurvature', 1, 'curvature')
    """
    parts = re.findall(r"\w+", name) if _NAME.fullmatch(name) else []
    return tuple(int(part) if part.isdecimal() else part for part in parts)


def field_of(label: str) -> str:
    """Return the last field of a name, or of the label of one of its numbers.

    >>> field_of("tubes[0].precurvature[1].curvature.x"), field_of("rotations[2]")
    ('curvature', 'rotations')
    """
    return next((part for part in reversed(parsed(label)) if isinstance(part, str) and part not in _AXES), "")


def identifier(name: str) -> str:
    """Turn a parameter's name into an identifier: ``loads[0].force`` becomes ``loads_0_force``.

    >>> identifier("tubes[0].precurvature[1].length")
    'tubes_0_precurvature_1_length'
    """
    return re.sub(r"\W+", "_", name)


def symbol(label: str) -> str:
    """Shorten a label to its symbol: ``EI_0`` for ``tubes[0].bending_stiffness``."""
    match parsed(label):
        case ("tubes", int(i), str(field)) if field in _SYMBOLS:
            return f"{_SYMBOLS[field]}_{i}"
    return label


def caption(label: str, robot: Robot) -> str:
    """A number's name for figures, with the tube's own name: ``curvature.x of inner[1]``, ``E of middle``.

    The number in brackets is that of the piece of precurvature.
    """
    match parsed(label):
        case ("tubes", int(i), "precurvature", int(piece), *field):
            return f"{'.'.join(map(str, field))} of {robot.tubes[i].name}[{piece}]"
        case ("tubes", int(i), *field):
            name = ".".join(map(str, field))
            return f"{_SYMBOLS.get(name, name.replace('_', ' '))} of {robot.tubes[i].name}"
    return label


def unit_of(label: str) -> tuple[float, str]:
    """Return the factor and the unit in which reports show the number of this label.

    >>> unit_of("base.translation.x")
    (1000.0, 'mm')
    """
    return shown(_UNITS.get(field_of(label), ""))


def shown(unit: str) -> tuple[float, str]:
    """Return the factor and the unit in which reports show numbers of an SI unit."""
    return _SHOWN.get(unit, (1.0, unit))


@attrs.frozen(eq=False)
class NamedNumber:
    """A named number, or an array of numbers, in SI.

    ``idle`` says why it does not act; empty if it acts. ``sources`` names the parameters from which it follows.
    """

    name: str
    value: Array
    idle: str = ""
    sources: tuple[str, ...] = ()
    unit: str = attrs.field()

    @unit.default
    def _usual(self) -> str:
        return _UNITS.get(field_of(self.name), "")

    @property
    def size(self) -> int:
        """Count of its numbers."""
        return int(self.value.size)

    @property
    def labels(self) -> tuple[str, ...]:
        """Label of each of its numbers."""
        shape = self.value.shape
        if not shape:
            return (self.name,)
        if shape == (3,) and field_of(self.name) not in ("rotations", "translations"):
            return tuple(f"{self.name}.{axis}" for axis in _AXES)
        return tuple(f"{self.name}[{', '.join(map(str, where))}]" for where in np.ndindex(shape))

    def scale(self, length: float) -> float:
        """Typical size of its changes, on a robot of this ``length``."""
        if self.unit == "rad":
            return 1.0
        if self.unit == "m" and field_of(self.name) in _ALONG:
            return length
        largest = float(np.abs(self.value).max())
        return largest if largest > 0.0 else 1.0 / length if self.unit == "1/m" else 1.0

    def bounds(self, initial: Array, positive: bool = False) -> tuple[Array, Array]:
        """Default lower and upper bounds around ``initial``; ``positive`` treats any parameter as a positive one."""
        field = field_of(self.name)
        if (positive or field.endswith(_POSITIVE)) and np.all(initial > 0.0):
            return initial / _FACTOR, initial * _FACTOR
        reach = np.full(initial.shape, np.pi if field in ("rotation", "rotation_offset") else np.inf)
        return initial - reach, initial + reach


class NamedLoad(Protocol):
    """The part of a load's interface that parameter names need."""

    @property
    def pulls(self) -> str:
        """The argument that accelerates masses; empty if none does."""

    def numbers(self, prefix: str, pulled: bool) -> Iterable[NamedNumber]:
        """The load's numbers, names behind a prefix; ``pulled`` says whether any load accelerates masses."""

    def replaced(self, field: str, value: Any) -> Self:
        """Copy the load with one number replaced."""


AnyLoad = TypeVar("AnyLoad", bound=NamedLoad)


def parameters(robot: Robot, actuation: Actuation, loads: Sequence[NamedLoad] = ()) -> dict[str, NamedNumber]:
    """Collect all parameters by name, with their present values.

    - ``rotations``, ``translations``: ``(tubes,)``, rad and m.
    - ``base.translation (3,)``, m, along the world's axes, and ``base.rotation (3,)``, rad, both relative to
      ``robot.base_pose``. The angles are about the axes x, y, z of the entry frame, each turned by those before it.
    - ``tubes[i].bending_stiffness``, ``.torsional_stiffness``, ``.youngs_modulus``, ``.shear_modulus``,
      ``.poisson_ratio``, ``.outer_diameter``, ``.inner_diameter``, ``.density``.
    - ``tubes[i].precurvature[k].length``, ``.curvature``, ``.coefficients``. The length of a sampled piece stretches
      all its samples alike.
    - The numbers of the loads by their arguments' names: ``loads[j].force`` and so on.
    """
    collected = [
        NamedNumber("rotations", np.array(actuation.rotations)),
        NamedNumber("translations", np.array(actuation.translations)),
        NamedNumber("base.translation", np.zeros(3)),
        NamedNumber("base.rotation", np.zeros(3)),
    ]
    pulled = any(load.pulls for load in loads)
    for i, tube in enumerate(robot.tubes):
        collected.extend(_of_tube(f"tubes[{i}].", tube, pulled))
    for j, load in enumerate(loads):
        collected.extend(load.numbers(f"loads[{j}].", pulled))
    return {parameter.name: parameter for parameter in collected}


def chosen(known: Mapping[str, NamedNumber], names: Iterable[str], field: str = "wrt") -> list[NamedNumber]:
    """Select parameters by name, in the order of the names; messages name the argument ``field``.

    Raises
    ------
    DefinitionError
        A name is unknown, is given twice, or belongs to a parameter that does not act; or a stiffness is chosen
        together with a modulus or a diameter from which it follows.
    """
    selected: dict[str, NamedNumber] = {}
    for name in names:
        parameter = known.get(name) if isinstance(name, str) else None
        if parameter is None:
            close = get_close_matches(str(name), list(known), 3)
            hint = f" (did you mean {' or '.join(map(repr, close))}?)" if close else ""
            acting = ", ".join(candidate.name for candidate in known.values() if not candidate.idle)
            raise DefinitionError(f"{field} = {name!r} is not a parameter{hint}; allowed are {acting or 'none'}")
        if parameter.idle:
            raise DefinitionError(f"{field} = {name!r} does not act: {parameter.idle}")
        if name in selected:
            raise DefinitionError(f"{field} contains {name!r} twice")
        selected[name] = parameter
    for name, parameter in selected.items():
        for source in parameter.sources:
            if source in selected:
                raise DefinitionError(
                    f"{field} contains {name!r} and also {source!r}, from which it follows: choose one of them"
                )
    return list(selected.values())


def optional(name: str, value: Any, idle: str = "", **options: Any) -> NamedNumber:
    """Describe a number that the user may have left out (None)."""
    if value is None:
        value, idle = np.nan, f"{field_of(name)} is not given"
    return NamedNumber(name, np.array(value), idle, **options)


def _of_tube(prefix: str, tube: Tube, pulled: bool) -> Iterator[NamedNumber]:
    given, follow = tube.given_stiffnesses, {name: tube.sources(name) for name in STIFFNESSES}
    for name, sources in follow.items():
        names = () if name in given else tuple(prefix + source for source in sources)
        yield NamedNumber(prefix + name, np.array(getattr(tube, name)), sources=names)
    for field in ("youngs_modulus", "shear_modulus", "poisson_ratio", "outer_diameter", "inner_diameter"):
        led = [name for name, sources in follow.items() if field in sources]
        acts = not given.keys() >= set(led) or (field.endswith("diameter") and pulled and tube.density > 0.0)
        idle = f"{led[0]} is given" if len(led) == 1 else "the stiffnesses are given"
        yield optional(prefix + field, getattr(tube, field), "" if acts else idle)
    yield NamedNumber(f"{prefix}density", np.array(tube.density), "" if pulled else "there is no Gravity")
    for k, piece in enumerate(tube.precurvature):
        for field in ("length", *filter(None, [piece.rows])):
            yield NamedNumber(f"{prefix}precurvature[{k}].{field}", np.array(getattr(piece, field)))


# -- other numbers in their place --------------------------------------------------------------------------------------


def robot_with(robot: Robot, values: Mapping[str, Any]) -> Robot:
    """Copy a robot with some parameters replaced by name, ``"tubes[0].bending_stiffness"`` and so on.

    >>> import ctr_opt as ctr
    >>> rod = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)
    >>> robot_with(ctr.Robot([rod]), {"tubes[0].precurvature[0].length": 0.2}).tubes[0].length
    0.2
    """
    tubes = list(robot.tubes)
    of_tubes: dict[int, dict[str, float]] = {}
    for name, value in values.items():
        match parsed(name):
            case ("tubes", int(i), str(field)):
                of_tubes.setdefault(i, {})[field] = float(value)
            case ("tubes", int(i), "precurvature", int(k), str(field)):
                pieces = list(tubes[i].precurvature)
                if field == "length":
                    pieces[k] = pieces[k].stretched(float(value))
                else:
                    pieces[k] = attrs.evolve(cast(Any, pieces[k]), **{field: value})
                tubes[i] = attrs.evolve(tubes[i], precurvature=tuple(pieces))
    for i, fields in of_tubes.items():
        tubes[i] = attrs.evolve(tubes[i], **cast(Any, fields))
    pose = robot.base_pose
    if "base.translation" in values or "base.rotation" in values:
        pose = moved(pose, values.get("base.translation", np.zeros(3)), values.get("base.rotation", np.zeros(3)))
    return attrs.evolve(robot, tubes=tubes, base_pose=pose, on_overlap="ignore")


def loads_with(loads: Sequence[AnyLoad], values: Mapping[str, Any]) -> tuple[AnyLoad, ...]:
    """Copy loads with some parameters replaced by name, ``"loads[0].force"`` and so on."""
    changed = list(loads)
    for name, value in values.items():
        match parsed(name):
            case ("loads", int(k), str(field)):
                changed[k] = changed[k].replaced(field, float(value) if np.ndim(value) == 0 else value)
    return tuple(changed)


def moved(pose: Array, translation: Iterable[float], angles: Iterable[float]) -> Array:
    """Move a pose along the world's axes and turn it by XYZ Euler angles, applied on its right."""
    from scipy.spatial.transform import Rotation

    result = np.array(pose)
    result[:3, 3] += np.asarray(translation)
    result[:3, :3] = pose[:3, :3] @ Rotation.from_euler("XYZ", np.asarray(angles)).as_matrix()
    return result


def euler_rates(angles: Array) -> Array:
    """Matrix ``(3, 3)`` from rates of XYZ Euler angles to the angular velocity in the turned frame."""
    _, b, c = angles
    return np.array(
        [
            [np.cos(b) * np.cos(c), np.sin(c), 0.0],
            [-np.cos(b) * np.sin(c), np.cos(c), 0.0],
            [np.sin(b), 0.0, 1.0],
        ]
    )
