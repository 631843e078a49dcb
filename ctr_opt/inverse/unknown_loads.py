"""Loads that are sought: forces and wrenches at the tip or along a tube, as loads and as numbers to be estimated.

An unknown load says which loads stand for it, which of their numbers are unknown, and what is known of them before.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, Self

import attrs
import numpy as np

from ..errors import DefinitionError
from ..robot.checks import Array, array, index, number
from ..robot.loads import Load, PointWrench

_TIP = 0  # the tube that the tip belongs to, as far as loads are concerned: forces there are the same for all


def _tube(value: Any) -> int:
    return index(value, "tube")


def _arc_length(value: Any) -> float | None:
    return None if value is None else number(value, "arc_length", least=0.0, unit="m")


def whole(value: Any, field: str, least: int, most: int | None = None) -> int:
    """A whole number in a range."""
    found = number(value, field, least=least, most=most)
    if found != int(found):
        raise DefinitionError(f"{field} = {value!r} must be a whole number")
    return int(found)


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


@attrs.frozen
class Sought:
    """Numbers of a load that are unknown: which of the unknown's loads, which field, how many, and names for them."""

    load: int
    field: str
    size: int
    labels: tuple[str, ...]


class UnknownLoad(Protocol):
    """What all unknown loads can tell."""

    def loads(self) -> list[Load]:
        """The loads that stand for it, at their start."""

    @property
    def sought(self) -> Sequence[Sought]:
        """The numbers that are unknown, in their order."""

    @property
    def taken(self) -> Sequence[tuple[int, str]]:
        """Which fields of which of its loads the model takes, in their order."""

    @property
    def mixing(self) -> Array:
        """The numbers that the model takes, by those that are sought."""

    @property
    def resultant(self) -> Array:
        """The total force ``(3, numbers)``, by those that are sought."""

    @property
    def known_before(self) -> Gaussian | None:
        """What is known of them before anything was measured."""

    def placed(self, ends: Array) -> UnknownLoad:
        """The same on a robot whose tubes end there."""

    @property
    def place(self) -> float | None:
        """Where the load acts: an arc length, m, or None, the tip (or nobody knows)."""


class _AsItStands:
    """What unknown loads share whose numbers the model takes as they are sought."""

    @property
    def taken(self) -> list[tuple[int, str]]:
        """Which fields of which of its loads the model takes."""
        return [(number.load, number.field) for number in self.sought]  # type: ignore[attr-defined]

    @property
    def mixing(self) -> Array:
        """Those numbers by those that are sought: the same."""
        return np.eye(sum(number.size for number in self.sought))  # type: ignore[attr-defined]

    @property
    def resultant(self) -> Array:
        """The force, which comes first."""
        return np.eye(3, len(self.mixing))

    def placed(self, ends: Array) -> Self:  # noqa: ARG002
        """The same, wherever tubes end."""
        return self


def vector(name: str) -> tuple[str, ...]:
    """Labels of its components."""
    return tuple(f"{name}.{axis}" for axis in "xyz")


@attrs.frozen
class TipForce(_AsItStands):
    """A force at the tip, world frame.

    Parameters
    ----------
    prior
        Mean and standard deviation, N, known before the measurements: numbers, one for each axis, or a covariance
        ``(3, 3)`` in the place of the deviation. Default: nothing is known.

    Examples
    --------
    >>> TipForce(prior=(0.0, 0.5)).known_before.information.tolist()
    [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]]
    """

    prior: Any = None

    def __attrs_post_init__(self) -> None:
        _ = self.known_before

    def loads(self) -> list[Load]:
        """A point force."""
        return [PointWrench(force=np.zeros(3))]

    @property
    def sought(self) -> tuple[Sought, ...]:
        """The force."""
        return (Sought(0, "force", 3, vector("force")),)

    @property
    def known_before(self) -> Gaussian | None:
        """The prior."""
        return Gaussian.of(self.prior, "prior", 3)

    @property
    def place(self) -> None:
        """The tip."""
        return


@attrs.frozen
class TipWrench(_AsItStands):
    """A force and a moment at the tip, world frame; the moment acts on the innermost tube.

    Parameters
    ----------
    prior
        Mean and standard deviation: numbers ``(6,)``, N and N m, or a covariance ``(6, 6)``.

    Examples
    --------
    >>> [number.field for number in TipWrench().sought]
    ['force', 'moment']
    """

    prior: Any = None

    def __attrs_post_init__(self) -> None:
        _ = self.known_before

    def loads(self) -> list[Load]:
        """A point wrench."""
        return [PointWrench(force=np.zeros(3), moment=np.zeros(3), tube=_TIP)]

    @property
    def sought(self) -> tuple[Sought, ...]:
        """Force and moment."""
        return Sought(0, "force", 3, vector("force")), Sought(0, "moment", 3, vector("moment"))

    @property
    def known_before(self) -> Gaussian | None:
        """The prior."""
        return Gaussian.of(self.prior, "prior", 6)

    @property
    def place(self) -> None:
        """The tip."""
        return


@attrs.frozen
class PointForce(_AsItStands):
    """A force at a place along a tube, world frame: a contact.

    Parameters
    ----------
    arc_length
        Where, m from the entry point; None: unknown, to be estimated.
    tube
        The tube that is pressed.
    prior
        Of the force, N, as for :class:`TipForce`.

    Examples
    --------
    >>> PointForce().sought[-1].labels
    ('arc_length',)
    """

    arc_length: float | None = attrs.field(default=None, converter=_arc_length)
    tube: int = attrs.field(default=0, converter=_tube)
    prior: Any = None

    def __attrs_post_init__(self) -> None:
        _ = self.known_before

    def loads(self) -> list[Load]:
        """A point force, for now at the entry where nobody knows the place."""
        return [PointWrench(force=np.zeros(3), arc_length=self.arc_length or 0.0, tube=self.tube)]

    @property
    def sought(self) -> tuple[Sought, ...]:
        """The force and, unless it is known, the place."""
        force = Sought(0, "force", 3, vector("force"))
        return (force,) if self.arc_length is not None else (force, Sought(0, "arc_length", 1, ("arc_length",)))

    @property
    def known_before(self) -> Gaussian | None:
        """The prior; of a place nothing is known but that it is on the tube."""
        found = Gaussian.of(self.prior, "prior", 3)
        if found is None or self.arc_length is not None:
            return found
        return Gaussian(np.append(found.mean, 0.0), np.pad(found.information, (0, 1)))

    @property
    def place(self) -> float | None:
        """Where it is known to act."""
        return self.arc_length
