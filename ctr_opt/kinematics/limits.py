"""Joint limits: ranges of rotations and translations, and the order of bases and tips."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import compress, pairwise

import attrs
import numpy as np

from ..checks import ARRAY_EQ, Array, Checked, Entry, described, unchecked
from ..errors import DefinitionError
from ..loads.kind import Load
from ..robot.robot import Robot
from .least_distance import least_distance

_REACH = 1e-4  # m: least length of a tube out of the entry, and beyond a load on it
_ROUNDING = 1e-9  # rad, m: a joint that is nearer to a limit is at it
_MIXING = 5  # moves along random lines between two draws of translations


_GAP = Entry("m", least=0.0, optional=True)


@attrs.frozen
class JointLimits(Checked):
    """Limits of rotations and translations, and least gaps between the tubes' bases and tips.

    Parameters
    ----------
    rotations
        Lower and upper bounds of ``alpha_i``, ``(tubes, 2)``, rad; default: free.
    translations
        Lower and upper bounds of ``beta_i``, ``(tubes, 2)``, m. Default: from the place where 0.1 mm of the tube stand
        out, to 0.
    base_gap
        Least distance of an inner tube's base behind the next tube's base, m: ``beta_i + gap <= beta_i+1``.
        ``None``: any order.
    tip_gap
        Least distance by which an inner tube's tip is in front of the next tube's tip, m: ``beta_i + L_i >= beta_i+1 +
        L_i+1 + gap``. ``None``: any order. The default is not zero, because derivatives are one-sided where tips
        coincide.

    Raises
    ------
    DefinitionError
        A lower bound is above its upper bound, or a gap is negative.

    Examples
    --------
    >>> JointLimits(rotations=[[-3.0, 3.0]]).base_gap
    0.0
    """

    entries = described(
        rotations=Entry("rad", (None, 2), optional=True),
        translations=Entry("m", (None, 2), optional=True),
        base_gap=_GAP,
        tip_gap=_GAP,
    )
    rotations: Array | None = attrs.field(default=None, converter=unchecked, eq=ARRAY_EQ, hash=False)
    translations: Array | None = attrs.field(default=None, converter=unchecked, eq=ARRAY_EQ, hash=False)
    base_gap: float | None = attrs.field(default=0.0, converter=unchecked)
    tip_gap: float | None = attrs.field(default=1e-4, converter=unchecked)

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        for field, ranges in (("rotations", self.rotations), ("translations", self.translations)):
            for i, (low, high) in enumerate(() if ranges is None else ranges):
                if low > high:
                    unit = self.entries[field].unit
                    raise DefinitionError(f"{field}[{i}] = [{low:g}, {high:g}] {unit} must be [lower, upper]")


@attrs.frozen(eq=False)
class Allowed:
    """Allowed joints ``q``, rotations before translations: ``rows q <= most``. Each row has a name."""

    rows: Array
    most: Array
    names: tuple[str, ...]
    lower: Array
    upper: Array

    @classmethod
    def of(cls, robot: Robot, limits: JointLimits, loads: Sequence[Load] = ()) -> Allowed:
        """Make the allowed joints of a robot; the places of ``loads`` must stay on their tubes."""
        lower, upper = _bounds(robot, limits, loads)
        rows, most, names = zip(*_of_bounds(lower, upper), *_of_gaps(robot, limits), strict=True)
        return cls(np.array(rows), np.array(most), names, lower, upper)

    def room(self, joints: Array) -> Array:
        """Distance of the joints to every limit; negative beyond it."""
        return self.most - self.rows @ joints

    def active(self, joints: Array) -> tuple[str, ...]:
        """Names of the limits at which the joints are."""
        return tuple(compress(self.names, self.room(joints) <= _ROUNDING))

    def exceeded(self, joints: Array) -> tuple[str, ...]:
        """Names of the limits that the joints exceed by more than rounding."""
        return tuple(compress(self.names, self.room(joints) < -_ROUNDING))

    def beyond(self, joints: Array, weights: Array) -> Array:
        """Weighted distance of joints ``(k, 2 tubes)`` beyond each limit, ``(k, limits)``."""
        return np.asarray(
            np.maximum(joints @ self.rows.T - self.most, 0.0) / np.linalg.norm(self.rows / weights, axis=1)
        )

    def unwound(self, angles: Array, reference: Array) -> Array:
        """Shift rotations ``(k, tubes)`` by whole turns to be nearest to ``reference``, within bounds if possible."""
        tubes, turn = len(reference), 2.0 * np.pi
        near = angles - turn * np.round((angles - reference) / turn)
        least = np.ceil((self.lower[:tubes] - near) / turn)
        most = np.floor((self.upper[:tubes] - near) / turn)
        return np.asarray(near + turn * np.where(least <= most, np.clip(0.0, least, most), 0.0))

    def nearest(self, joints: Array, weights: Array) -> Array:
        """Find the allowed joints nearest to ``joints`` by weighted distance; an error if limits allow none."""
        step = least_distance(self.rows / weights, self.room(joints))
        if step is None:
            raise DefinitionError(f"limits contradict each other: {'; '.join(self.names)}")
        return self.kept(joints + step / weights)

    def kept(self, joints: Array) -> Array:
        """Move joints that exceed their bounds by rounding onto the bounds."""
        return np.clip(joints, self.lower, self.upper)

    def drawn(self, start: Array, count: int, rng: np.random.Generator) -> Array:
        """Draw random allowed joints ``(count, 2 tubes)``, starting from allowed ones.

        Angles are uniform within their bounds, free angles within one turn. Translations move by hit-and-run: each move
        goes to a random place on a line in a random direction.
        """
        tubes = len(start) // 2
        free = np.isinf(self.lower[:tubes]) | np.isinf(self.upper[:tubes])
        least, most = np.where(free, -np.pi, self.lower[:tubes]), np.where(free, np.pi, self.upper[:tubes])
        here, moves = start.copy(), np.arange(2 * tubes) >= tubes
        moves &= self.lower < self.upper
        drawn = np.empty((count, 2 * tubes))
        for k in range(_MIXING * count):
            along = moves * rng.normal(size=2 * tubes)
            room, rate = self.room(here), self.rows @ along
            up, down = rate > 0.0, rate < 0.0
            if up.any():
                low, high = (room[down] / rate[down]).max(initial=-np.inf), (room[up] / rate[up]).min()
                here = self.kept(here + rng.uniform(min(low, 0.0), max(high, 0.0)) * along)
            drawn[k // _MIXING] = here
        drawn[:, :tubes] = least + (most - least) * rng.random((count, tubes))
        return drawn


def _bounds(robot: Robot, limits: JointLimits, loads: Sequence[Load]) -> tuple[Array, Array]:
    """Lower and upper bounds of every joint, such that tubes reach beyond the loads on them."""
    tubes, lengths = len(robot.tubes), [tube.length for tube in robot.tubes]
    bounds = np.array([*[(-np.inf, np.inf)] * tubes, *((_REACH - length, 0.0) for length in lengths)])
    for field, part in (("rotations", bounds[:tubes]), ("translations", bounds[tubes:])):
        ranges = getattr(limits, field)
        if ranges is not None:
            if len(ranges) != tubes:
                raise DefinitionError(f"limits: {field} has {len(ranges)} rows, but the robot has {tubes} tubes")
            part[:] = ranges
    lower, upper = bounds.T
    for i, (tube, (low, high)) in enumerate(zip(robot.tubes, bounds[tubes:], strict=True)):
        if low <= -tube.length or high > 0.0:
            raise DefinitionError(
                f"limits: translations[{i}] = [{low:g}, {high:g}] m must be above -{tube.length:g} m, the length of "
                f"tube {i} ({tube.name!r}), and at most 0"
            )
    for k, load in enumerate(loads):
        for place in (getattr(load, field) for field in getattr(load, "places", ())):  # solves refuse anything else
            carrier = getattr(load, "tube", tubes)
            if place is not None and carrier < tubes:
                joint, length = tubes + carrier, lengths[carrier]
                lower[joint] = max(lower[joint], place - length + _REACH)
                if lower[joint] > upper[joint]:
                    most = length + upper[joint] - _REACH
                    raise DefinitionError(
                        f"loads[{k}] acts at {place:g} m on tube {carrier}, but must act at {most:g} m at most"
                    )
    return lower, upper


def _of_bounds(lower: Array, upper: Array) -> Iterator[tuple[Array, float, str]]:
    tubes = len(lower) // 2
    for k, row in enumerate(np.eye(2 * tubes)):
        name, unit = (f"rotations[{k}]", "rad") if k < tubes else (f"translations[{k - tubes}]", "m")
        if np.isfinite(upper[k]):
            yield row, upper[k], f"{name} at most {upper[k]:g} {unit}"
        if np.isfinite(lower[k]):
            yield -row, -lower[k], f"{name} at least {lower[k]:g} {unit}"


def _of_gaps(robot: Robot, limits: JointLimits) -> Iterator[tuple[Array, float, str]]:
    tubes = len(robot.tubes)
    translations = np.eye(2 * tubes)[tubes:]
    for i, (inner, outer) in enumerate(pairwise(robot.tubes)):
        row = translations[i] - translations[i + 1]
        if limits.base_gap is not None:
            yield row, -limits.base_gap, f"base of tube {i} at least {limits.base_gap:g} m behind that of tube {i + 1}"
        if limits.tip_gap is not None:
            most = inner.length - outer.length - limits.tip_gap
            yield -row, most, f"tip of tube {i} at least {limits.tip_gap:g} m in front of that of tube {i + 1}"
