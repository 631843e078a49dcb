"""External loads: wrenches at a point and distributed over an interval, fixed in the world or to a tube."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, TypeAlias

import attrs
import numpy as np

from ..checks import ARRAY_EQ, Array, array, choice
from ..errors import DefinitionError
from ..robot.piecewise import PiecewisePolynomial
from . import places
from .fields import ExpressionLoad, PotentialLoad
from .gravity import DistributedMass, Gravity, PointMass
from .kind import Numbered

_FRAMES = ("world", "body")


@attrs.frozen(eq=False)
class LoadTable:
    """A load density given at points and interpolated linearly between them: ``(s (k,), values (k, 3))``."""

    arc_length: Array
    values: Array

    def polynomial(self) -> PiecewisePolynomial:
        """The interpolant; zero outside the table."""
        slopes = np.diff(self.values, axis=0) / np.diff(self.arc_length)[:, None]
        return PiecewisePolynomial(self.arc_length, np.stack((self.values[:-1], slopes)))

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, LoadTable)
            and np.array_equal(self.arc_length, other.arc_length)
            and np.array_equal(self.values, other.values)
        )


LoadFunction: TypeAlias = Callable[[float], Any]
Density: TypeAlias = Array | LoadTable | LoadFunction


def _point_force(value: Any) -> Array:
    return array(value, "force", (3,), unit="N")


def _point_moment(value: Any) -> Array:
    return array(value, "moment", (3,), unit="N m")


def _force_density(value: Any) -> Density:
    return _density(value, "force", "N/m")


def _moment_density(value: Any) -> Density:
    return _density(value, "moment", "N m/m")


def _density(value: Any, field: str, unit: str) -> Density:
    if callable(value) or isinstance(value, LoadTable):
        return value  # type: ignore[no-any-return]
    if isinstance(value, (tuple, list)) and len(value) == 2:
        s = array(value[0], f"{field}[0] (arc lengths)", (None,), unit="m")
        table = array(value[1], f"{field}[1] (values)", (None, 3), unit=unit)
        if len(s) < 2 or len(s) != len(table):
            raise DefinitionError(
                f"{field}: a table needs at least 2 arc lengths and as many rows, got {len(s)} and {len(table)}"
            )
        if np.any(np.diff(s) <= 0.0):
            k = int(np.argmax(np.diff(s) <= 0.0)) + 1
            raise DefinitionError(f"{field}: arc length [{k}] = {s[k]:g} m must be above [{k - 1}] = {s[k - 1]:g} m")
        return LoadTable(s, table)
    return array(value, field, (3,), unit=unit)


def _frame(value: Any) -> str:
    return choice(value, "frame", _FRAMES)


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and np.array_equal(a, b)
    return bool(a == b)


_DENSITY_EQ = attrs.cmp_using(eq=_same)


@attrs.frozen
class PointWrench(Numbered):
    """A force and a moment at a point of a named tube.

    Parameters
    ----------
    force, moment
        ``(3,)``, N and N m. An axial moment twists the named tube alone.
    arc_length
        ``s`` from the entry point, m; ``None``: the named tube's distal end, wherever it is.
    tube
        Index of the tube that carries it, 0 the innermost.
    frame
        ``"world"``: force and moment keep their direction ("dead"); ``"body"``: they are given in the named tube's
        material frame and turn with it ("follower"). A body load has no potential.

    Examples
    --------
    >>> PointWrench(force=[0.0, 0.5, 0.0]).tube
    0
    """

    units: ClassVar[dict[str, str]] = {"force": "N", "moment": "N m", "arc_length": "m"}
    force: Array = attrs.field(default=(0.0, 0.0, 0.0), converter=_point_force, eq=ARRAY_EQ, hash=False)
    moment: Array = attrs.field(default=(0.0, 0.0, 0.0), converter=_point_moment, eq=ARRAY_EQ, hash=False)
    arc_length: float | None = attrs.field(default=None, converter=places.arc_length)
    tube: int = attrs.field(default=0, converter=places.tube)
    frame: str = attrs.field(default="world", converter=_frame)

    @property
    def nonconservative(self) -> str:
        """Why it has no potential; empty if it has one."""
        return _why(self.frame, bool(np.any(self.moment)), bool(np.any(self.force)))

    def conservative_part(self) -> PointWrench | None:
        """What of the load has a potential: the force, where it is world-fixed."""
        return None if self.frame == "body" else attrs.evolve(self, moment=np.zeros(3))

    def times(self, factor: float) -> PointWrench:
        """The load multiplied."""
        return attrs.evolve(self, force=factor * self.force, moment=factor * self.moment)


@attrs.frozen
class DistributedLoad(Numbered):
    """A force and a moment per arc length on a named tube.

    Parameters
    ----------
    force, moment
        N/m and N m/m: constant ``(3,)``; or a pair ``(s (k,), values (k, 3))``, interpolated
        linearly and zero outside; or a function ``s -> (3,)``, of which
        features narrower than a thousandth of the interval may be missed. The moment about
        the backbone's tangent twists the named tube alone.
    start, end
        ``s`` from the entry point, m; ``end=None``: the named tube's distal end.
    tube
        Index of the tube that carries it, 0 the innermost.
    frame
        ``"world"`` or ``"body"``, as in :class:`PointWrench`.

    Examples
    --------
    >>> DistributedLoad(force=[-2.0, 0.0, 0.0], start=0.01).end is None
    True
    """

    units: ClassVar[dict[str, str]] = {"force": "N/m", "moment": "N m/m", "start": "m", "end": "m"}
    force: Density = attrs.field(default=np.zeros(3), converter=_force_density, eq=_DENSITY_EQ, hash=False)
    moment: Density = attrs.field(default=np.zeros(3), converter=_moment_density, eq=_DENSITY_EQ, hash=False)
    start: float = attrs.field(default=0.0, converter=places.start)
    end: float | None = attrs.field(default=None, converter=places.end)
    tube: int = attrs.field(default=0, converter=places.tube)
    frame: str = attrs.field(default="world", converter=_frame)

    def __attrs_post_init__(self) -> None:
        places.check_interval(self.start, self.end)

    @property
    def nonconservative(self) -> str:
        """Why it has no potential; empty if it has one."""
        return _why(self.frame, _acts(self.moment), _acts(self.force))

    def conservative_part(self) -> DistributedLoad | None:
        """What of the load has a potential: the force, where it is world-fixed."""
        return None if self.frame == "body" else attrs.evolve(self, moment=np.zeros(3))

    def times(self, factor: float) -> DistributedLoad:
        """The load multiplied."""
        return attrs.evolve(self, force=_times(self.force, factor), moment=_times(self.moment, factor))


def _times(density: Any, factor: float) -> Any:
    if isinstance(density, LoadTable):
        return LoadTable(density.arc_length, factor * density.values)
    if callable(density):
        return lambda s: factor * np.asarray(density(s), dtype=np.float64)
    return factor * density


def _acts(density: Density) -> bool:
    if isinstance(density, LoadTable):
        return bool(np.any(density.values))
    return callable(density) or bool(np.any(density))


def _why(frame: str, moment: bool, force: bool) -> str:
    if frame == "body" and (moment or force):
        return "acts in a tube's frame (frame = 'body')"
    return "applies a moment" if moment else ""


Load: TypeAlias = PointWrench | DistributedLoad | Gravity | PointMass | DistributedMass | PotentialLoad | ExpressionLoad
LOADS = (PointWrench, DistributedLoad, Gravity, PointMass, DistributedMass, PotentialLoad, ExpressionLoad)
