"""Limits of the joints: how far bases turn and move, and in which order they and the tips stand."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import compress, pairwise

import attrs
import numpy as np

from ..checks import ARRAY_EQ, Array, Checked, Entry, described, given
from ..errors import DefinitionError
from ..loads.kind import Load
from ..robot.robot import Robot
from .least_distance import least_distance

_REACH = 1e-4  # m: what of a tube stands out of the entry, and ends beyond a load on it
_ROUNDING = 1e-9  # rad, m: what is nearer is at the limit
_MIXING = 5  # places on random lines from one draw of translations to the next


_GAP = Entry("m", least=0.0, optional=True)


@attrs.frozen
class JointLimits(Checked):
    """What the joints may do.

    Parameters
    ----------
    rotations
        Least and most ``alpha_i``, ``(tubes, 2)``, rad; default: free.
    translations
        Least and most ``beta_i``, ``(tubes, 2)``, m; default: from where 0.1 mm of the tube stand out, to 0.
    base_gap
        An inner tube's base is behind that of the next tube by at least so much, m, ``beta_i + gap <= beta_i+1``;
        ``None``: in any order.
    tip_gap
        An inner tube reaches further than the next one by at least so much, m, ``beta_i + L_i >= beta_i+1 + L_i+1 +
        gap``; ``None``: in any order. Not zero by default, as derivatives are one-sided where tips coincide.

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
    rotations: Array | None = attrs.field(default=None, converter=given, eq=ARRAY_EQ, hash=False)
    translations: Array | None = attrs.field(default=None, converter=given, eq=ARRAY_EQ, hash=False)
    base_gap: float | None = attrs.field(default=0.0, converter=given)
    tip_gap: float | None = attrs.field(default=1e-4, converter=given)

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        for field, ranges in (("rotations", self.rotations), ("translations", self.translations)):
            for i, (low, high) in enumerate(() if ranges is None else ranges):
                if low > high:
                    unit = self.entries[field].unit
                    raise DefinitionError(f"{field}[{i}] = [{low:g}, {high:g}] {unit} must be [least, most]")


@attrs.frozen(eq=False)
class Allowed:
    """The joints ``q``, rotations before translations, with ``rows q <= most``; each row has a name."""

    rows: Array
    most: Array
    names: tuple[str, ...]
    lower: Array
    upper: Array

    @classmethod
    def of(cls, robot: Robot, limits: JointLimits, loads: Sequence[Load] = ()) -> Allowed:
        """Those of a robot, on whose tubes the loads must find their places."""
        lower, upper = _bounds(robot, limits, loads)
        rows, most, names = zip(*_of_bounds(lower, upper), *_of_gaps(robot, limits), strict=True)
        return cls(np.array(rows), np.array(most), names, lower, upper)

    def room(self, joints: Array) -> Array:
        """How much is left to every limit."""
        return self.most - self.rows @ joints

    def active(self, joints: Array) -> tuple[str, ...]:
        """The names of the limits that are met."""
        return tuple(compress(self.names, self.room(joints) <= _ROUNDING))

    def exceeded(self, joints: Array) -> tuple[str, ...]:
        """The names of the limits that are not kept, by more than rounding."""
        return tuple(compress(self.names, self.room(joints) < -_ROUNDING))

    def beyond(self, joints: Array, weights: Array) -> Array:
        """How far joints ``(k, 2 tubes)`` are beyond each limit, in weights, ``(k, limits)``."""
        return np.asarray(
            np.maximum(joints @ self.rows.T - self.most, 0.0) / np.linalg.norm(self.rows / weights, axis=1)
        )

    def unwound(self, angles: Array, reference: Array) -> Array:
        """Rotations ``(k, tubes)`` by whole turns nearest to others, and then within their bounds if that can be."""
        tubes, turn = len(reference), 2.0 * np.pi
        near = angles - turn * np.round((angles - reference) / turn)
        least = np.ceil((self.lower[:tubes] - near) / turn)
        most = np.floor((self.upper[:tubes] - near) / turn)
        return np.asarray(near + turn * np.where(least <= most, np.clip(0.0, least, most), 0.0))

    def nearest(self, joints: Array, weights: Array) -> Array:
        """The allowed joints nearest to given ones, distances weighted; an error where nothing is allowed."""
        step = least_distance(self.rows / weights, self.room(joints))
        if step is None:
            raise DefinitionError(f"limits contradict each other: {'; '.join(self.names)}")
        return self.kept(joints + step / weights)

    def kept(self, joints: Array) -> Array:
        """Joints that exceed their bounds by rounding, at their bounds."""
        return np.clip(joints, self.lower, self.upper)

    def drawn(self, start: Array, count: int, rng: np.random.Generator) -> Array:
        """Random joints ``(count, 2 tubes)`` from allowed ones on: angles, free ones within a turn, and translations.

        Translations by hit-and-run: to a random place on the line in a random direction, and so on.
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
    """Least and most of every joint; the tubes reach beyond the loads on them."""
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
        for place in (getattr(load, field) for field in getattr(load, "places", ())):  # solves refuse what is no load
            carrier = getattr(load, "tube", tubes)
            if place is not None and carrier < tubes:
                joint, length = tubes + carrier, lengths[carrier]
                lower[joint] = max(lower[joint], place - length + _REACH)
                if lower[joint] > upper[joint]:
                    most = length + upper[joint] - _REACH
                    raise DefinitionError(
                        f"loads[{k}] acts at {place:g} m on tube {carrier}, but must be at most at {most:g} m"
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
