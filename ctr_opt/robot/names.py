"""Every number of a robot, its actuation and its loads by name: what derivatives and estimates are taken of."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from typing import Any

import attrs
import numpy as np

from ..checks import Array
from ..errors import DefinitionError
from ..loads.fields import ExpressionLoad, PotentialLoad
from ..loads.gravity import DistributedMass, Gravity, PointMass
from ..loads.wrenches import DistributedLoad, Load, LoadTable, PointWrench
from .actuation import Actuation
from .precurvature import Arc, PolynomialCurvature, PrecurvaturePiece, SampledCurvature
from .robot import Robot
from .tube import Tube


@attrs.frozen(eq=False)
class Parameter:
    """A named number, or an array of numbers, in SI; ``idle`` says why it does not act, where it does not."""

    name: str
    value: Array
    idle: str = ""

    @property
    def size(self) -> int:
        """How many numbers it is."""
        return int(self.value.size)


def parameters(robot: Robot, actuation: Actuation, loads: Sequence[Load] = ()) -> dict[str, Parameter]:
    """Every parameter by its name, with its present value.

    ``rotations``, ``translations`` ``(tubes,)``; ``base.translation (3,)``, m, along the world's axes, and
    ``base.rotation (3,)``, rad, angles about the axes x, y, z of the entry frame, each turned by those before it, both
    relative to ``robot.base_pose``; ``tubes[i].bending_stiffness``, ``.torsional_stiffness``, ``.youngs_modulus``,
    ``.shear_modulus``, ``.poisson_ratio``, ``.outer_diameter``, ``.inner_diameter``, ``.density``;
    ``tubes[i].precurvature[k].length``, ``.curvature``, ``.coefficients`` (the length of samples stretches them
    alike); and the numbers of the loads, ``loads[j].force`` and so on, by their arguments' names.
    """
    every = [
        Parameter("rotations", np.array(actuation.rotations)),
        Parameter("translations", np.array(actuation.translations)),
        Parameter("base.translation", np.zeros(3)),
        Parameter("base.rotation", np.zeros(3)),
    ]
    pulled = any(isinstance(load, Gravity) for load in loads)
    for i, tube in enumerate(robot.tubes):
        every.extend(_of_tube(f"tubes[{i}]", tube, pulled))
    for j, load in enumerate(loads):
        every.extend(_of_load(f"loads[{j}]", load, pulled))
    return {parameter.name: parameter for parameter in every}


def chosen(known: dict[str, Parameter], names: Iterable[str], field: str = "wrt") -> list[Parameter]:
    """The parameters of these names, in their order; ``field`` is the argument that messages name.

    Raises
    ------
    DefinitionError
        A name that is not there, stands twice, or is of a parameter that does not act.
    """
    found: list[Parameter] = []
    for name in names:
        parameter = known.get(name) if isinstance(name, str) else None
        if parameter is None:
            close = get_close_matches(str(name), list(known), 3)
            hint = f"; close to it: {', '.join(close)}" if close else ""
            acting = ", ".join(each.name for each in known.values() if not each.idle)
            raise DefinitionError(f"{field} = {name!r} is no parameter{hint}; there are {acting}")
        if parameter.idle:
            raise DefinitionError(f"{field} = {name!r} does not act: {parameter.idle}")
        if parameter in found:
            raise DefinitionError(f"{field} has {name!r} twice")
        found.append(parameter)
    _check_stiffnesses([parameter.name for parameter in found], known, field)
    return found


def _check_stiffnesses(names: list[str], known: dict[str, Parameter], field: str) -> None:
    """A stiffness that is a parameter no longer follows from moduli and diameters that are."""
    for name in names:
        tube, _, stiffness = name.rpartition(".")
        for source in _SOURCES.get(stiffness, ()):
            if f"{tube}.{source}" in names and not _given(known[name]):
                raise DefinitionError(
                    f"{field} has both {name!r} and '{tube}.{source}', from which it follows: choose one of them"
                )


_SOURCES = {
    "bending_stiffness": ("youngs_modulus", "outer_diameter", "inner_diameter"),
    "torsional_stiffness": ("youngs_modulus", "shear_modulus", "poisson_ratio", "outer_diameter", "inner_diameter"),
}


@attrs.frozen(eq=False)
class _Stiffness(Parameter):
    given: bool = False


def _given(parameter: Parameter) -> bool:
    return isinstance(parameter, _Stiffness) and parameter.given


def _of_tube(name: str, tube: Tube, pulled: bool) -> Iterator[Parameter]:
    given = tube.given_stiffnesses
    bends, twists = "bending_stiffness" not in given, "torsional_stiffness" not in given
    by_ratio = twists and tube.poisson_ratio is not None
    both = "the stiffnesses are given" if not (bends or twists) else ""
    for field in ("bending_stiffness", "torsional_stiffness"):
        yield _Stiffness(f"{name}.{field}", np.array(getattr(tube, field)), given=field in given)
    yield _optional(
        f"{name}.youngs_modulus", tube.youngs_modulus, "" if bends or by_ratio else both or "bending_stiffness is given"
    )
    shear = "" if twists else "torsional_stiffness is given"
    yield _optional(f"{name}.shear_modulus", tube.shear_modulus, shear)
    yield _optional(f"{name}.poisson_ratio", tube.poisson_ratio, shear)
    idle = both if not (pulled and tube.density > 0.0) else ""
    yield Parameter(f"{name}.outer_diameter", np.array(tube.outer_diameter), idle)
    yield Parameter(f"{name}.inner_diameter", np.array(tube.inner_diameter), idle)
    yield Parameter(f"{name}.density", np.array(tube.density), "" if pulled else "there is no Gravity")
    for k, piece in enumerate(tube.precurvature):
        yield from _of_piece(f"{name}.precurvature[{k}]", piece)


def _of_piece(name: str, piece: PrecurvaturePiece) -> Iterator[Parameter]:
    yield Parameter(f"{name}.length", np.array(piece.length))
    if isinstance(piece, (Arc, SampledCurvature)):
        yield Parameter(f"{name}.curvature", np.array(piece.curvature))
    elif isinstance(piece, PolynomialCurvature):
        yield Parameter(f"{name}.coefficients", np.array(piece.coefficients))


def _optional(name: str, value: float | None, idle: str = "") -> Parameter:
    missing = f"{name.rpartition('.')[2]} is not given"
    return Parameter(name, np.array(np.nan if value is None else value), missing if value is None else idle)


def _of_load(name: str, load: Load, pulled: bool) -> Iterator[Parameter]:
    if isinstance(load, Gravity):
        yield Parameter(f"{name}.acceleration", np.array(load.acceleration))
        return
    unused = ""
    if isinstance(load, (PointWrench, DistributedLoad)):
        yield _density(f"{name}.force", load.force)
        yield _density(f"{name}.moment", load.moment)
    elif isinstance(load, (PotentialLoad, ExpressionLoad)):
        unused = "" if load.factor != 0.0 else "factor = 0 leaves the load out"
        yield Parameter(f"{name}.factor", np.array(load.factor), unused)
    else:
        field = "mass" if isinstance(load, PointMass) else "mass_per_length"
        unused = "" if pulled else "there is no Gravity"
        yield Parameter(f"{name}.{field}", np.array(getattr(load, field)), unused)
    for place in _places(load):
        yield _optional(f"{name}.{place}", getattr(load, place), unused)


def _places(load: Load) -> tuple[str, ...]:
    if isinstance(load, (DistributedLoad, DistributedMass)):
        return ("start", "end")
    if isinstance(load, (PotentialLoad, ExpressionLoad)) and load.distributed:
        return ("start", "end")
    return ("arc_length",)


def _density(name: str, value: Any) -> Parameter:
    if isinstance(value, LoadTable):
        return Parameter(name, np.array(value.values))
    if callable(value):
        return Parameter(name, np.array(np.nan), "it is a function")
    return Parameter(name, np.array(value))
