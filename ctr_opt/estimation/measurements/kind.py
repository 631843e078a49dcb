"""What every kind of measurement says of itself: the basis of the kinds, one file each, beside this one.

A measurement names its ``observables``, and compares their predicted values with what was measured: residuals in
blocks, as a point is a block of three numbers, whose norm a robust loss sees. What files and reports need is data of
the kind: its ``tables`` and ``columns`` of files, and the ``parts`` of a block with their units.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import attrs
import numpy as np

from ...checks import Array, Checked, Entry, array, described, index, number
from ...errors import DefinitionError
from ...layout.observables import Distal, Observable, ObservedList, Place, Stacked

# -- converters of fields ----------------------------------------------------------------------------------------------


def places(value: Any) -> tuple[Place, ...]:
    """Converter of one place or several."""
    if value is None or isinstance(value, Distal):
        return (value,)
    if isinstance(value, (list, tuple)) and any(item is None or isinstance(item, Distal) for item in value):
        return tuple(item if item is None or isinstance(item, Distal) else _length(item) for item in value)
    if np.ndim(value) == 0:
        return (_length(value),)
    if len(value) == 0:
        raise DefinitionError("arc_length = [] must hold at least one place")
    given = array(value, "arc_length", (None,), unit="m")
    return tuple(_length(item) for item in given) if (given < 0.0).any() else tuple(given.tolist())


def place(value: Any) -> tuple[Place, ...]:
    """Converter of one place."""
    given = places(value)
    if len(given) != 1:
        raise DefinitionError(f"arc_length = {value!r} must be one place: give a measurement for each")
    return given


def _length(value: Any) -> float:
    return number(value, "arc_length", least=0.0, unit="m")


def sensor_name(value: Any) -> str | None:
    """Converter of the name of a sensor, or None."""
    if value is not None and not (isinstance(value, str) and re.fullmatch(r"[A-Za-z]\w*", value)):
        raise DefinitionError(f"sensor = {value!r} must be a name of letters, digits and underscores")
    return value


# -- files and reports -------------------------------------------------------------------------------------------------


@attrs.frozen
class Part:
    """Numbers of a block that reports give together, by their norm.

    ``name``: what they are, several of them; ``title``: what they are called beside their place; ``unit``: SI;
    ``first, last``: which of the block they are.
    """

    name: str
    title: str
    unit: str
    first: int | None = None
    last: int | None = None

    @property
    def of_block(self) -> slice:
        """Where they stand in a block."""
        return slice(self.first, self.last)


def vector_sigma(unit: str) -> Entry:
    """The entry of a standard deviation, one or one for each axis."""
    return Entry(unit, (3,), scalar_too=True)


def six(first: Any, last: Any) -> Array:
    """Three numbers, or one for all three, and three others."""
    return np.concatenate((np.broadcast_to(first, 3), np.broadcast_to(last, 3)))


# -- measurements ------------------------------------------------------------------------------------------------------


class Measurement(Checked, ABC):
    """What all kinds of measurements share: whitening, checks, and what files and reports need.

    Attributes
    ----------
    unit
        SI: the standard deviation where none is given, so that residuals are reported in mm, mrad and so on.
    one_unit
        Whether all numbers of a block have one unit.
    columns
        SI units of vectors in tables of experiments, three columns ``<name>_x``, ``_y``, ``_z`` each.
    parts
        Of a block, for reports.
    """

    unit: ClassVar[float] = 1e-3
    one_unit: ClassVar[bool] = True
    columns: ClassVar[Mapping[str, str]] = {}
    entries = described()
    parts: ClassVar[tuple[Part, ...]]
    sigma: Any

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        self._check()
        _ = self.whitener

    def _check(self) -> None:
        """Check fields that depend on each other."""

    @property
    @abstractmethod
    def observables(self) -> tuple[Observable, ...]:
        """What is observed."""

    @property
    @abstractmethod
    def shape(self) -> tuple[int, int]:
        """Number of blocks of residuals, and their size."""

    @staticmethod
    @abstractmethod
    def compare(measured: Sequence[Any], values: ObservedList) -> tuple[Array, Array]:
        """Predicted minus measured ``(E, blocks, size)``, SI, and the derivatives ``(E, blocks, size, k)``.

        ``measured``: of one kind and shape, in E experiments; ``values``: predicted ones of their observables.
        """

    @property
    def scaled(self) -> bool:
        """Whether a noise level was given."""
        return self.sigma is not None

    @cached_property
    def whitener(self) -> Array:
        """``(blocks, size, size)``: by what residuals are multiplied to have unit covariance."""
        return whitening(self.sigma if self.scaled else self.unit, *self.shape)

    @cached_property
    def isotropic(self) -> Array:
        """The whitener of a standard deviation equal along all axes, the root mean square of theirs.

        As given, where the numbers of a block have several units.
        """
        if not self.one_unit:
            return self.whitener
        size = self.shape[1]
        variances = (np.linalg.inv(self.whitener) ** 2).sum(axis=(1, 2)) / size
        return np.asarray(np.eye(size) / np.sqrt(variances)[:, None, None])

    def whitener_for(self, loss: str) -> Array:
        """By what residuals are multiplied under a loss: distances are the same along all axes."""
        return self.isotropic if loss == "distance" else self.whitener

    def check(self, tubes: int) -> None:
        """Raise ``DefinitionError`` for a tube that a robot with this number of ``tubes`` does not have."""
        for one in self.observables:
            for carrier in (one.tube, one.place.tube if isinstance(one.place, Distal) else None):
                if carrier is not None:
                    index(carrier, "tube", tubes)

    @classmethod
    def of_columns(cls, values: Mapping[str, Array], sigmas: Mapping[str, Any]) -> Measurement:
        """From the vectors ``(3,)`` of its columns, SI, and their standard deviations, by their names."""
        raise NotImplementedError

    def to_columns(self) -> Mapping[str, Array]:
        """The vectors ``(3,)`` of its columns, SI."""
        raise NotImplementedError


def whitening(sigma: Any, blocks: int, size: int, field: str = "sigma") -> Array:
    """``(blocks, size, size)`` from a standard deviation, one for each axis, or covariances of all or of each block.

    A number is a standard deviation of every component, ``(size,)`` are those of the axes, ``(size, size)`` is a
    covariance, ``(blocks, size, size)`` are covariances.
    """
    if np.ndim(sigma) == 0:
        return _of_one_deviation(number(sigma, field, above=0.0), blocks, size)
    given = array(sigma, field, (None,) * np.ndim(sigma))
    if given.shape == (size,):
        if not (given > 0.0).all():
            raise DefinitionError(f"{field} = {given.tolist()} must be positive, one for each axis")
        return np.broadcast_to(np.diag(1.0 / given), (blocks, size, size))
    if given.shape not in ((size, size), (blocks, size, size)):
        raise DefinitionError(
            f"{field} has shape {given.shape}, but must be a number, have shape ({size},), or hold covariances of "
            f"shape ({size}, {size}) or ({blocks}, {size}, {size})"
        )
    try:
        deviations = np.sqrt(np.abs(np.diagonal(given, axis1=-2, axis2=-1)))
        allowed = 1e-6 * deviations[..., :, None] * deviations[..., None, :]
        if np.any(np.abs(given - np.swapaxes(given, -1, -2)) > allowed):
            raise np.linalg.LinAlgError
        factor = np.linalg.cholesky(given)
    except np.linalg.LinAlgError:
        raise DefinitionError(f"{field}: a covariance must be symmetric and positive definite") from None
    return np.broadcast_to(np.linalg.inv(factor), (blocks, size, size))


@lru_cache
def _of_one_deviation(sigma: float, blocks: int, size: int) -> Array:
    """The whitener of a standard deviation: shared by the measurements of a stream, and not to be written to."""
    return np.broadcast_to(np.eye(size) / sigma, (blocks, size, size))


# -- points ------------------------------------------------------------------------------------------------------------

POINTS = Part("points", "", "m", last=3)
DIRECTIONS = Part("directions", "direction", "rad", first=-3)


def distances(measured: Sequence[Any], values: ObservedList) -> tuple[Array, Array]:
    """Predicted minus measured positions, and derivatives."""
    poses = Stacked.of(values)
    return poses.value[..., 3] - np.array([one.position for one in measured]), poses.slopes[:, :, :3]
