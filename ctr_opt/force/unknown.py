"""Loads that are unknown: forces and wrenches at the tip or along a tube, as loads and as numbers to be estimated.

An unknown load says which loads stand for it, which of their numbers are unknown, and what is known of them before.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Self

import attrs
import numpy as np

from ..checks import Array, Checked, Entry, Table, array, described, given, number
from ..errors import DefinitionError
from ..layout.ends import Ends
from ..loads import place
from ..loads.kind import Load
from ..loads.point import PointWrench

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

_INSIDE = 1e-6  # of a robot's length: contacts are looked for between a tube's ends


def _normal(value: Any) -> tuple[float, ...] | None:
    if value is None:
        return None
    given = array(value, "normal", (3,))
    if not given.any():
        raise DefinitionError("normal = [0, 0, 0] has no direction")
    return tuple((given / np.linalg.norm(given)).tolist())


_PRIOR = {"mean": Entry("N", (3,), scalar_too=True), "sigma": Entry("N", (3,), scalar_too=True)}
_WRENCH_PRIOR = {
    f"{name}_{part}": Entry(unit, (3,), scalar_too=True)
    for name, unit in (("force", "N"), ("moment", "N m"))
    for part in ("mean?", "sigma")
}
_PLACE_PRIOR = {"mean": Entry("m"), "sigma": Entry("m")}
IN_FILES = {"prior?": _PRIOR, "bounds?": Entry("N", (2,)), "between?": Entry("m", (2,))}
"""What files say of forces beside their entries."""


def _with_priors(kind: Any, **values: Any) -> Any:
    """An unknown load whose priors are tables: mean and standard deviation, of a wrench those of force and moment."""
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
    """A normal distribution: mean ``(n,)`` and inverse covariance ``(n, n)``, zero where nothing is known."""

    mean: Array
    information: Array

    @classmethod
    def of(cls, given: Any, field: str, size: int) -> Gaussian | None:
        """From a pair of mean and standard deviation: numbers, one for each component, or a covariance."""
        if given is None:
            return None
        if not isinstance(given, (tuple, list)) or len(given) != 2:
            raise DefinitionError(f"{field} = {given!r} must be a pair: mean and standard deviation")
        mean = _numbers(given[0], f"{field}: mean", size)
        if np.ndim(given[1]) < 2:
            deviations = _numbers(given[1], f"{field}: standard deviation", size)
            if not (deviations > 0.0).all():
                raise DefinitionError(f"{field}: the standard deviation {given[1]!r} must be positive")
            return cls(mean, np.diag(1.0 / deviations**2))
        spread = array(given[1], f"{field}: covariance", (None, None))
        if spread.shape != (size, size) or np.linalg.eigvalsh(0.5 * (spread + spread.T))[0] <= 0.0:
            raise DefinitionError(f"{field}: the covariance must be positive definite and of shape ({size}, {size})")
        return cls(mean, np.asarray(np.linalg.inv(0.5 * (spread + spread.T)), dtype=np.float64))


def _numbers(value: Any, field: str, size: int) -> Array:
    """One number for all components, or one for each."""
    return np.full(size, number(value, field)) if np.ndim(value) == 0 else array(value, field, (size,))


def limits(given: Any, field: str, size: int, least: float = -np.inf) -> tuple[Array, Array]:
    """Bounds ``(size,)`` from a pair: numbers, one for each component, or None, open; ``least``: none is below."""
    if given is None:
        return np.full(size, least), np.full(size, np.inf)
    if not isinstance(given, (tuple, list)) or len(given) != 2:
        raise DefinitionError(f"{field} = {given!r} must be a pair: the least and the most, None where it is open")
    lower = np.full(size, least) if given[0] is None else _numbers(given[0], f"{field}: the least", size)
    upper = np.full(size, np.inf) if given[1] is None else _numbers(given[1], f"{field}: the most", size)
    if not (lower < upper).all() or (lower < least).any():
        above = f", and the least at least {least:g}" if np.isfinite(least) else ""
        raise DefinitionError(f"{field} = {given!r}: the least must be below the most{above}")
    return lower, upper


@attrs.frozen
class UnknownNumbers:
    """Numbers of a load that are unknown: which of the unknown's loads, which field, how many, and names for them."""

    load: int
    field: str
    size: int
    labels: tuple[str, ...]


class UnknownLoad(Checked):
    """An unknown load: a kind says which loads stand for it and which of their numbers are unknown.

    What stands here is right for a kind whose numbers the model takes as they are, its force first, with a prior and
    bounds of them all. ``in_file`` holds what files may say of it beside the ``entries`` by which it is checked.
    """

    __slots__ = ()

    entries = described()
    in_file: ClassVar[Mapping[str, Any]] = {}
    size: ClassVar[int] = 3
    """How many numbers its prior and its bounds are of."""
    force_prior: ClassVar[bool] = True
    """Whether the problem's prior of forces is meant for it, too."""
    steady: ClassVar[bool] = True
    """Whether it has the same numbers in every sample of a stream, so that they can be followed."""
    tube: Any
    prior: Any
    bounds: Any

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        _ = Gaussian.of(self.prior, "prior", self.size), self.limits

    @classmethod
    def tables(cls) -> tuple[Table]:
        """The table of files that describes it."""
        return (Table(cls.kind, {**cls.in_files(), **cls.in_file}, partial(_with_priors, cls)),)

    def choices(self, alone: bool) -> Sequence[tuple[UnknownLoad, ...]]:  # noqa: ARG002
        """The unknown loads that may stand for it, the likeliest of which counts; ``alone``: beside no others."""
        return ((self,),)

    def loads(self) -> list[Load]:
        """The loads that stand for it, at their start."""
        raise NotImplementedError

    @property
    def sought(self) -> Sequence[UnknownNumbers]:
        """The numbers that are unknown, in their order; an unknown place is the last."""
        raise NotImplementedError

    @property
    def somewhere(self) -> bool:
        """Whether its place is unknown."""
        return any(number.field == "arc_length" for number in self.sought)

    @property
    def taken(self) -> Sequence[tuple[int, str]]:
        """Which fields of which of its loads the model takes, in their order."""
        return [(number.load, number.field) for number in self.sought]

    @property
    def mixing(self) -> Array:
        """The numbers that the model takes, by those that are unknown."""
        return np.eye(sum(number.size for number in self.sought))

    @property
    def resultant(self) -> Array:
        """The total force ``(3, numbers)``, by those that are unknown."""
        return np.eye(3, len(self.mixing))

    @property
    def known_before(self) -> Gaussian | None:
        """What is known of them before anything was measured."""
        return Gaussian.of(self.prior, "prior", self.size)

    @property
    def limits(self) -> tuple[Array, Array]:
        """Their bounds, infinite where they are open."""
        return limits(self.bounds, "bounds", self.size)

    def limits_on(self, ends: Ends) -> tuple[Array, Array]:  # noqa: ARG002
        """Their bounds on a robot whose tubes end there."""
        return self.limits

    def placed(self, ends: Ends) -> Self:  # noqa: ARG002
        """The load on a robot whose tubes end there."""
        return self

    @property
    def place(self) -> float | None:
        """Where it acts: an arc length, m, or None: the tip, no one place, or an unknown one."""
        return None

    @property
    def cone(self) -> tuple[Array, float] | None:
        """The normal ``(3,)`` and Coulomb's coefficient of a cone in which its force is."""
        return None

    @property
    def spline(self) -> BSpline[np.float64] | None:
        """Of a distributed force: the basis of its density, ``(coefficients,)`` at a place."""
        return None

    @property
    def roughness(self) -> Array | None:
        """Of a distributed force: the integral of ``|f''|^2`` as a quadratic form of its numbers."""
        return None

    @property
    def roughly(self) -> bool:
        """Whether the weight of its roughness is to be estimated, too."""
        return False

    def check_scale(self, scale: Array, field: str) -> None:
        """Raise ``DefinitionError`` for what cannot be computed with numbers of this ``scale``."""


def vector(name: str) -> tuple[str, ...]:
    """Labels of its components."""
    return tuple(f"{name}.{axis}" for axis in "xyz")


@attrs.frozen
class _AtTip(UnknownLoad):
    """What acts at the tip, on the innermost tube there once the robot is known."""

    tube: int = attrs.field(default=0, init=False, eq=False, repr=False)
    prior: Any = None
    bounds: Any = None

    def placed(self, ends: Ends) -> Self:
        """At the end of the innermost tube at the tip."""
        tube = ends.innermost()
        if tube == self.tube:
            return self
        placed = copy(self)
        object.__setattr__(placed, "tube", tube)
        return placed


@attrs.frozen
class TipForce(_AtTip):
    """A force at the tip, world frame.

    Parameters
    ----------
    prior
        Mean and standard deviation, N, known before the measurements: numbers, one for each axis, or a covariance
        ``(3, 3)`` in the place of the deviation. Default: nothing is known.
    bounds
        The least and the most, N: numbers, or one for each axis; None: open. They hold exactly.

    Examples
    --------
    >>> TipForce(prior=(0.0, 0.5)).known_before.information.tolist()
    [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]]
    """

    kind = "tip_force"
    in_file: ClassVar[Mapping[str, Any]] = {name: IN_FILES[name] for name in ("prior?", "bounds?")}

    def loads(self) -> list[Load]:
        """A point force."""
        return [PointWrench(force=np.zeros(3), tube=self.tube)]

    @property
    def sought(self) -> tuple[UnknownNumbers, ...]:
        """The force."""
        return (UnknownNumbers(0, "force", 3, vector("force")),)


@attrs.frozen
class TipWrench(_AtTip):
    """A force and a moment at the tip, world frame; the moment acts on the innermost tube.

    Parameters
    ----------
    prior
        Mean and standard deviation: numbers ``(6,)``, N and N m, or a covariance ``(6, 6)``.
    bounds
        The least and the most ``(6,)``, N and N m; None: open.

    Examples
    --------
    >>> [number.field for number in TipWrench().sought]
    ['force', 'moment']
    """

    kind = "tip_wrench"
    in_file: ClassVar[Mapping[str, Any]] = {"prior?": _WRENCH_PRIOR}
    size = 6

    def loads(self) -> list[Load]:
        """A point wrench."""
        return [PointWrench(force=np.zeros(3), moment=np.zeros(3), tube=self.tube)]

    @property
    def sought(self) -> tuple[UnknownNumbers, ...]:
        """Force and moment."""
        return UnknownNumbers(0, "force", 3, vector("force")), UnknownNumbers(0, "moment", 3, vector("moment"))


@attrs.frozen
class PointForce(UnknownLoad):
    """A force at a place along a tube, world frame: a contact.

    Parameters
    ----------
    arc_length
        Where, m from the entry point; None: unknown, to be estimated.
    tube
        The tube that is pressed.
    prior
        Of the force, N, as for :class:`TipForce`.
    normal
        ``(3,)``, the direction in which a surface can push the robot, world frame, of any length: the force is
        then no pull. None: it may be any.
    friction
        Coulomb's coefficient ``mu``, with a normal and a known place: the force across the normal is at most ``mu``
        times that along it. None: none, the force is along the normal.
    bounds
        Of the force, as for :class:`TipForce`; of the push along a normal two numbers. Not with friction.
    between
        Where an unknown place can be: the least and the most, m.
    place_prior
        Mean and standard deviation of an unknown place, m, known before.

    Notes
    -----
    Both hold exactly. Without friction the one number sought is the normal force, bounded by zero. With friction, where
    the force is outside the cone without it, that of least loss on the cone's surface is taken. Covariances are mean
    squared deviations of the forces that are possible, as likely as measured, from the estimate: a force at an edge of
    what is possible is not known better for it.

    Examples
    --------
    >>> PointForce().sought[-1].labels
    ('arc_length',)
    >>> PointForce(0.08, normal=[0.0, 2.0, 0.0]).sought[0].labels
    ('normal_force',)
    """

    kind = "point_force"
    entries = described(**place.POINT, friction=Entry("1", least=0.0, optional=True))
    in_file: ClassVar[Mapping[str, Any]] = {**IN_FILES, "normal?": Entry("1", (3,)), "place_prior?": _PLACE_PRIOR}
    arc_length: float | None = attrs.field(default=None, converter=given)
    tube: int = attrs.field(default=0, converter=given)
    prior: Any = None
    normal: Any = attrs.field(default=None, converter=_normal)
    friction: float | None = attrs.field(default=None, converter=given)
    bounds: Any = None
    between: Any = None
    place_prior: Any = None

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        _ = self.known_before
        for field in ("between", "place_prior"):
            if getattr(self, field) is not None and self.arc_length is not None:
                raise DefinitionError(f"{field} = {getattr(self, field)!r} is for an unknown place, not for arc_length")
        if self.friction is not None and self.bounds is not None:
            raise DefinitionError(f"bounds = {self.bounds!r} cannot be given with friction")
        if self.friction is not None and (self.normal is None or self.arc_length is None):
            raise DefinitionError(f"friction = {self.friction:g} needs a normal and the place, arc_length")

    def loads(self) -> list[Load]:
        """A point force, for now at the entry where nobody knows the place."""
        return [PointWrench(force=np.zeros(3), arc_length=self.arc_length or 0.0, tube=self.tube)]

    @property
    def _directions(self) -> Array:
        """The force ``(3, n)``, by the numbers of it that are unknown."""
        return np.eye(3) if self.normal is None or self.friction is not None else np.array(self.normal)[:, None]

    @property
    def sought(self) -> tuple[UnknownNumbers, ...]:
        """The force, or its size along the normal, and, unless it is known, the place."""
        along = self._directions.shape[1] == 1
        force = (
            UnknownNumbers(0, "normal_force", 1, ("normal_force",))
            if along
            else UnknownNumbers(0, "force", 3, vector("force"))
        )
        return (force,) if self.arc_length is not None else (force, UnknownNumbers(0, "arc_length", 1, ("arc_length",)))

    @property
    def taken(self) -> list[tuple[int, str]]:
        """The force and, unless it is known, the place."""
        return [(0, "force")] if self.arc_length is not None else [(0, "force"), (0, "arc_length")]

    @property
    def mixing(self) -> Array:
        """Both, by the numbers that are sought."""
        from scipy.linalg import block_diag

        return np.asarray(block_diag(self._directions, np.eye(int(self.arc_length is None))), dtype=np.float64)

    @property
    def resultant(self) -> Array:
        """The force, by the numbers that are sought."""
        return self.mixing[:3]

    @property
    def known_before(self) -> Gaussian | None:
        """The priors; of a place without one nothing is known but that it is on the tube."""
        found, place = Gaussian.of(self.prior, "prior", 3), Gaussian.of(self.place_prior, "place_prior", 1)
        if found is None and place is None:
            return None
        rows = self.resultant
        mean, information = np.zeros(rows.shape[1]), np.zeros((rows.shape[1],) * 2)
        if found is not None:
            information = np.asarray(rows.T @ found.information @ rows)
            mean = np.linalg.pinv(information) @ rows.T @ found.information @ found.mean
        if place is not None:
            mean[-1], information[-1, -1] = place.mean[0], place.information[0, 0]
        return Gaussian(np.asarray(mean), information)

    @property
    def limits(self) -> tuple[Array, Array]:
        """The bounds, and where the place can be."""
        size = self._directions.shape[1]
        lower, upper = limits(self.bounds, "bounds", size, least=0.0 if size == 1 else -np.inf)
        if self.arc_length is not None:
            return lower, upper
        first, last = limits(self.between, "between", 1, least=0.0)
        return np.append(lower, first), np.append(upper, last)

    @property
    def place(self) -> float | None:
        """Where it is known to act."""
        return self.arc_length

    @property
    def cone(self) -> tuple[Array, float] | None:
        """Of friction."""
        return None if self.friction is None else (np.array(self.normal), self.friction)

    def limits_on(self, ends: Ends) -> tuple[Array, Array]:
        """The bounds, of an unknown place inside the tube."""
        lower, upper = self.limits
        if self.arc_length is None:
            first, last = _INSIDE * ends.length, ends.of(self.tube) - _INSIDE * ends.length
            if lower[-1] >= last:
                raise DefinitionError(
                    f"between = {self.between!r} is not on tube {self.tube}, which ends at {last:g} m"
                )
            lower[-1], upper[-1] = max(lower[-1], first), min(upper[-1], last)
        return lower, upper
