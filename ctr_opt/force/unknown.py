"""Unknown loads: forces and wrenches at the tip or along a tube, as loads and as numbers to estimate.

An unknown load defines the loads that represent it in the model, which of their numbers are unknown, and their prior.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Self

import attrs
import numpy as np

from ..checks import ANY_EQ, Array, Checked, Entry, Table, array, described, dimensions, direction, number, unchecked
from ..errors import DefinitionError
from ..layout.ends import Ends
from ..loads import place
from ..loads.kind import Load
from ..loads.point import PointWrench

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

_INSIDE = 1e-6  # of a robot's length: the search keeps contacts this far from a tube's ends


def _normal(value: Any) -> tuple[float, ...] | None:
    if value is None:
        return None
    return tuple(direction(value, "normal").tolist())


_PRIOR = {"mean": Entry("N", (3,), scalar_too=True), "sigma": Entry("N", (3,), scalar_too=True)}
_WRENCH_PRIOR = {
    f"{name}_{part}": Entry(unit, (3,), scalar_too=True)
    for name, unit in (("force", "N"), ("moment", "N m"))
    for part in ("mean?", "sigma")
}
_PLACE_PRIOR = {"mean": Entry("m"), "sigma": Entry("m")}
IN_FILES = {"prior?": _PRIOR, "bounds?": Entry("N", (2,)), "between?": Entry("m", (2,))}
"""File entries of forces that :class:`UnknownLoad` checks itself."""


def _with_priors(kind: Any, **values: Any) -> Any:
    """Build an unknown load from file tables of priors; a wrench has separate priors of force and moment."""
    for name in values.keys() & {"prior", "place_prior"}:
        prior = values[name]
        if "mean" not in prior:
            prior = {
                part: np.concatenate([np.broadcast_to(prior.get(f"{of}_{part}", 0.0), 3) for of in ("force", "moment")])
                for part in ("mean", "sigma")
            }
        values[name] = prior["mean"], prior["sigma"]
    return kind(**values)


@attrs.frozen(eq=False)
class Gaussian:
    """A normal distribution: mean ``(n,)`` and inverse covariance ``(n, n)``, which may be singular."""

    mean: Array
    information: Array

    @classmethod
    def of(cls, given: Any, field: str, size: int) -> Gaussian | None:
        """The distribution from a pair: mean, and standard deviation (one or one for each component) or covariance."""
        if given is None:
            return None
        if not isinstance(given, (tuple, list)) or len(given) != 2:
            raise DefinitionError(f"{field} = {given!r} must be a pair: mean and standard deviation")
        mean = _numbers(given[0], f"{field}: mean", size)
        if dimensions(given[1]) < 2:
            deviations = _numbers(given[1], f"{field}: standard deviation", size)
            if not (deviations > 0.0).all():
                raise DefinitionError(f"{field}: the standard deviation {given[1]!r} must be positive")
            return cls(mean, np.diag(1.0 / deviations**2))
        spread = array(given[1], f"{field}: covariance", (None, None))
        if spread.shape != (size, size) or np.linalg.eigvalsh(0.5 * (spread + spread.T))[0] <= 0.0:
            raise DefinitionError(f"{field}: the covariance must be positive definite and of shape ({size}, {size})")
        return cls(mean, np.asarray(np.linalg.inv(0.5 * (spread + spread.T)), dtype=np.float64))


def _numbers(value: Any, field: str, size: int) -> Array:
    """Components from one number for all, or one for each."""
    return np.full(size, number(value, field)) if dimensions(value) == 0 else array(value, field, (size,))


def limits(given: Any, field: str, size: int, least: float = -np.inf) -> tuple[Array, Array]:
    """Bounds ``(size,)`` from a pair of numbers, arrays or None (open); no bound may be below ``least``."""
    if given is None:
        return np.full(size, least), np.full(size, np.inf)
    if not isinstance(given, (tuple, list)) or len(given) != 2:
        raise DefinitionError(f"{field} = {given!r} must be a pair (least, most); None leaves a side open")
    lower = np.full(size, least) if given[0] is None else _numbers(given[0], f"{field}: the least", size)
    upper = np.full(size, np.inf) if given[1] is None else _numbers(given[1], f"{field}: the most", size)
    if not (lower < upper).all() or (lower < least).any():
        above = f", and the least at least {least:g}" if np.isfinite(least) else ""
        raise DefinitionError(f"{field} = {given!r}: the least must be below the most{above}")
    return lower, upper


@attrs.frozen
class UnknownNumbers:
    """Unknown numbers of one load: index of the load, field, count and labels."""

    load: int
    field: str
    size: int
    labels: tuple[str, ...]


class UnknownLoad(Checked):
    """Base of all unknown loads.

    A kind defines the loads that represent it and which of their numbers are unknown. The defaults suit a kind whose
    numbers enter the model unchanged, the force first, with one prior and one pair of bounds for all. ``in_file`` holds
    file entries beyond the checked ``entries``.
    """

    __slots__ = ()

    entries = described()
    in_file: ClassVar[Mapping[str, Any]] = {}
    size: ClassVar[int] = 3
    """Count of numbers that prior and bounds refer to."""
    force_prior: ClassVar[bool] = True
    """Whether the problem's prior of forces applies to it."""
    steady: ClassVar[bool] = True
    """Whether it has the same numbers in every sample of a stream, so that a stream can follow it."""
    tube: Any
    prior: Any
    bounds: Any

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        _ = Gaussian.of(self.prior, "prior", self.size), self.limits

    @classmethod
    def tables(cls) -> tuple[Table]:
        """The file table of this kind."""
        return (Table(cls.kind, {**cls.in_files(), **cls.in_file}, partial(_with_priors, cls)),)

    def choices(self, alone: bool) -> Sequence[tuple[UnknownLoad, ...]]:  # noqa: ARG002
        """Alternative sets of unknown loads, of which the likeliest is chosen; ``alone``: there are no other loads."""
        return ((self,),)

    def loads(self) -> list[Load]:
        """The loads that represent it in the model, at their start values."""
        raise NotImplementedError

    @property
    def unknown_numbers(self) -> Sequence[UnknownNumbers]:
        """The unknown numbers, in their order; an unknown place is the last."""
        raise NotImplementedError

    @property
    def somewhere(self) -> bool:
        """Whether the place of the load is unknown."""
        return any(number.field == "arc_length" for number in self.unknown_numbers)

    @property
    def taken(self) -> Sequence[tuple[int, str]]:
        """The load fields that the model reads, as (load, field), in their order."""
        return [(number.load, number.field) for number in self.unknown_numbers]

    @property
    def mixing(self) -> Array:
        """Matrix from the unknown numbers to the numbers that the model reads."""
        return np.eye(sum(number.size for number in self.unknown_numbers))

    @property
    def resultant(self) -> Array:
        """Matrix ``(3, numbers)`` from the unknown numbers to the total force."""
        return np.eye(3, len(self.mixing))

    @property
    def known_before(self) -> Gaussian | None:
        """The prior of the unknown numbers; None: nothing is known."""
        return Gaussian.of(self.prior, "prior", self.size)

    @property
    def limits(self) -> tuple[Array, Array]:
        """Bounds of the unknown numbers, infinite if open."""
        return limits(self.bounds, "bounds", self.size)

    def limits_on(self, ends: Ends) -> tuple[Array, Array]:  # noqa: ARG002
        """Bounds of the unknown numbers on a robot with tube ends ``ends``."""
        return self.limits

    def placed(self, ends: Ends) -> Self:  # noqa: ARG002
        """The load placed on a robot with tube ends ``ends``."""
        return self

    @property
    def place(self) -> float | None:
        """Arc length at which the load acts, m; None at the tip, along an interval, or if unknown."""
        return None

    @property
    def cone(self) -> tuple[Array, float] | None:
        """Normal ``(3,)`` and Coulomb coefficient of the friction cone; None without friction."""
        return None

    @property
    def spline(self) -> BSpline[np.float64] | None:
        """Basis of a distributed force's density, ``(coefficients,)`` at an arc length; None for other loads."""
        return None

    @property
    def roughness(self) -> Array | None:
        """Quadratic form of ``integral |f''|^2`` of a distributed force; None for other loads."""
        return None

    @property
    def roughly(self) -> bool:
        """Whether the weight of the smoothness prior must be estimated."""
        return False

    def check_scale(self, scale: Array, field: str) -> None:
        """Raise ``DefinitionError`` if numbers of this ``scale`` make the computation inaccurate."""


def vector(name: str) -> tuple[str, ...]:
    """Labels of a vector's components."""
    return tuple(f"{name}.{axis}" for axis in "xyz")


@attrs.frozen
class _AtTip(UnknownLoad):
    """An unknown load at the tip, on the innermost tube there."""

    tube: int = attrs.field(default=0, init=False, eq=False, repr=False)
    prior: Any = attrs.field(default=None, eq=ANY_EQ, hash=False)
    bounds: Any = attrs.field(default=None, eq=ANY_EQ, hash=False)

    def placed(self, ends: Ends) -> Self:
        """The load on the innermost tube at the tip."""
        tube = ends.innermost()
        if tube == self.tube:
            return self
        placed = copy(self)
        object.__setattr__(placed, "tube", tube)
        return placed


@attrs.frozen
class TipForce(_AtTip):
    """An unknown force at the tip, world frame.

    Parameters
    ----------
    prior
        Mean and standard deviation, N: numbers, or one for each axis. A covariance ``(3, 3)`` may replace the standard
        deviation. Default: no prior.
    bounds
        The least and the largest value, N: numbers, or one for each axis; None leaves a side open. The estimate
        satisfies them exactly.

    Examples
    --------
    >>> TipForce(prior=(0.0, 0.5)).known_before.information.tolist()
    [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]]
    """

    kind = "tip_force"
    in_file: ClassVar[Mapping[str, Any]] = {name: IN_FILES[name] for name in ("prior?", "bounds?")}

    def loads(self) -> list[Load]:
        """A point force at the tip."""
        return [PointWrench(force=np.zeros(3), tube=self.tube)]

    @property
    def unknown_numbers(self) -> tuple[UnknownNumbers, ...]:
        """The three components of the force."""
        return (UnknownNumbers(0, "force", 3, vector("force")),)


@attrs.frozen
class TipWrench(_AtTip):
    """An unknown force and moment at the tip, world frame; the moment acts on the innermost tube.

    Parameters
    ----------
    prior
        Mean and standard deviation ``(6,)``, N and N m. A covariance ``(6, 6)`` may replace the standard deviation.
    bounds
        The least and the largest value ``(6,)``, N and N m; None leaves a side open.

    Examples
    --------
    >>> [number.field for number in TipWrench().unknown_numbers]
    ['force', 'moment']
    """

    kind = "tip_wrench"
    in_file: ClassVar[Mapping[str, Any]] = {"prior?": _WRENCH_PRIOR}
    size = 6

    def loads(self) -> list[Load]:
        """A point wrench at the tip."""
        return [PointWrench(force=np.zeros(3), moment=np.zeros(3), tube=self.tube)]

    @property
    def unknown_numbers(self) -> tuple[UnknownNumbers, ...]:
        """The components of force and moment."""
        return UnknownNumbers(0, "force", 3, vector("force")), UnknownNumbers(0, "moment", 3, vector("moment"))


@attrs.frozen
class PointForce(UnknownLoad):
    """An unknown contact force at one place along a tube, world frame.

    Parameters
    ----------
    arc_length
        Place of the force, m from the entry point. None: the place is unknown and estimated.
    tube
        Number of the tube in contact.
    prior
        Mean and standard deviation of the force, N, as for :class:`TipForce`.
    normal
        Direction ``(3,)`` in which a surface pushes the robot, world frame, of any length. The force cannot pull.
        None: any direction is possible.
    friction
        Coulomb coefficient ``mu``; requires a normal and a known place. The force across the normal is at most ``mu``
        times the force along it. None: no friction, so that the force is along the normal.
    bounds
        Bounds of the force, as for :class:`TipForce`; with a normal, two numbers for the push along it. Not allowed
        with friction.
    between
        The least and the largest arc length of an unknown place, m.
    place_prior
        Mean and standard deviation of an unknown place, m.

    Notes
    -----
    The estimate satisfies the normal and the friction cone exactly. Without friction the only unknown is the normal
    force, which is at least zero. With friction, an estimate outside the cone is replaced by the force of least loss
    on the cone's surface. Covariances are mean squared deviations from the estimate, over the allowed forces weighted
    by their likelihood. An active bound does not make the estimate more precise.

    Examples
    --------
    >>> PointForce().unknown_numbers[-1].labels
    ('arc_length',)
    >>> PointForce(0.08, normal=[0.0, 2.0, 0.0]).unknown_numbers[0].labels
    ('normal_force',)
    """

    kind = "point_force"
    entries = described(**place.POINT, friction=Entry("1", least=0.0, optional=True))
    in_file: ClassVar[Mapping[str, Any]] = {**IN_FILES, "normal?": Entry("1", (3,)), "place_prior?": _PLACE_PRIOR}
    arc_length: float | None = attrs.field(default=None, converter=unchecked)
    tube: int = attrs.field(default=0, converter=unchecked)
    prior: Any = attrs.field(default=None, eq=ANY_EQ, hash=False)
    normal: Any = attrs.field(default=None, converter=_normal)
    friction: float | None = attrs.field(default=None, converter=unchecked)
    bounds: Any = attrs.field(default=None, eq=ANY_EQ, hash=False)
    between: Any = attrs.field(default=None, eq=ANY_EQ, hash=False)
    place_prior: Any = attrs.field(default=None, eq=ANY_EQ, hash=False)

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        _ = self.known_before
        for field in ("between", "place_prior"):
            if getattr(self, field) is not None and self.arc_length is not None:
                raise DefinitionError(f"{field} = {getattr(self, field)!r} is only for an unknown place (arc_length)")
        if self.friction is not None and self.bounds is not None:
            raise DefinitionError(f"bounds = {self.bounds!r} cannot be given with friction")
        if self.friction is not None and (self.normal is None or self.arc_length is None):
            raise DefinitionError(f"friction = {self.friction:g} requires normal and arc_length")

    def loads(self) -> list[Load]:
        """A point force; an unknown place starts at the entry point."""
        return [PointWrench(force=np.zeros(3), arc_length=self.arc_length or 0.0, tube=self.tube)]

    @property
    def _directions(self) -> Array:
        """Matrix ``(3, n)`` from the unknown numbers of the force to the force."""
        return np.eye(3) if self.normal is None or self.friction is not None else np.array(self.normal)[:, None]

    @property
    def unknown_numbers(self) -> tuple[UnknownNumbers, ...]:
        """The force or its size along the normal, and an unknown place."""
        along = self._directions.shape[1] == 1
        force = (
            UnknownNumbers(0, "normal_force", 1, ("normal_force",))
            if along
            else UnknownNumbers(0, "force", 3, vector("force"))
        )
        return (force,) if self.arc_length is not None else (force, UnknownNumbers(0, "arc_length", 1, ("arc_length",)))

    @property
    def taken(self) -> list[tuple[int, str]]:
        """The load fields that the model reads: the force, and an unknown place."""
        return [(0, "force")] if self.arc_length is not None else [(0, "force"), (0, "arc_length")]

    @property
    def mixing(self) -> Array:
        """Matrix from the unknown numbers to force and unknown place."""
        from scipy.linalg import block_diag

        return np.asarray(block_diag(self._directions, np.eye(int(self.arc_length is None))), dtype=np.float64)

    @property
    def resultant(self) -> Array:
        """Matrix from the unknown numbers to the force."""
        return self.mixing[:3]

    @property
    def known_before(self) -> Gaussian | None:
        """The priors of force and place; None without either."""
        force, place = Gaussian.of(self.prior, "prior", 3), Gaussian.of(self.place_prior, "place_prior", 1)
        if force is None and place is None:
            return None
        rows = self.resultant
        mean, information = np.zeros(rows.shape[1]), np.zeros((rows.shape[1],) * 2)
        if force is not None:
            information = np.asarray(rows.T @ force.information @ rows)
            mean = np.linalg.pinv(information) @ rows.T @ force.information @ force.mean
        if place is not None:
            mean[-1], information[-1, -1] = place.mean[0], place.information[0, 0]
        return Gaussian(np.asarray(mean), information)

    @property
    def limits(self) -> tuple[Array, Array]:
        """Bounds of the force, and of an unknown place."""
        size = self._directions.shape[1]
        lower, upper = limits(self.bounds, "bounds", size, least=0.0 if size == 1 else -np.inf)
        if self.arc_length is not None:
            return lower, upper
        first, last = limits(self.between, "between", 1, least=0.0)
        return np.append(lower, first), np.append(upper, last)

    @property
    def place(self) -> float | None:
        """The known arc length, m; None if unknown."""
        return self.arc_length

    @property
    def cone(self) -> tuple[Array, float] | None:
        """Normal ``(3,)`` and Coulomb coefficient; None without friction."""
        return None if self.friction is None else (np.array(self.normal), self.friction)

    def limits_on(self, ends: Ends) -> tuple[Array, Array]:
        """Bounds of the unknown numbers, with an unknown place inside the tube."""
        lower, upper = self.limits
        if self.arc_length is None:
            first, last = _INSIDE * ends.length, ends.of(self.tube) - _INSIDE * ends.length
            if lower[-1] >= last:
                raise DefinitionError(
                    f"between = {self.between!r} is not on tube {self.tube}, which ends at {last:g} m"
                )
            lower[-1], upper[-1] = max(lower[-1], first), min(upper[-1], last)
        return lower, upper
