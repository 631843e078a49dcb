"""Base class of all kinds of measurements; each kind has its own file beside this one.

A measurement names its ``observables`` and compares their predicted with the measured values. Residuals come in
blocks: a point is a block of three numbers, and a robust loss acts on the block's norm. Files and reports read data of
the kind: the ``tables`` and ``columns`` of files, and the ``parts`` of a block with their units.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import attrs
import numpy as np

from ...checks import SMALLEST, Array, Checked, Entry, array, described, dimensions, frozen, index, number
from ...errors import DefinitionError
from ...layout.observables import Distal, Observable, ObservedList, Place, Stacked

# -- converters of fields ----------------------------------------------------------------------------------------------


def places(value: Any) -> tuple[Place, ...]:
    """Convert one place or several to a tuple."""
    if value is None or isinstance(value, Distal):
        return (value,)
    if isinstance(value, (list, tuple)) and any(item is None or isinstance(item, Distal) for item in value):
        return tuple(item if item is None or isinstance(item, Distal) else _length(item) for item in value)
    if dimensions(value) == 0:
        return (_length(value),)
    lengths = array(value, "arc_length", (None,), unit="m")
    if not len(lengths):
        raise DefinitionError("arc_length = [] must hold at least one place")
    return tuple(_length(item) for item in lengths) if (lengths < 0.0).any() else tuple(lengths.tolist())


def place(value: Any) -> tuple[Place, ...]:
    """Convert exactly one place to a tuple."""
    converted = places(value)
    if len(converted) != 1:
        raise DefinitionError(f"arc_length = {value!r} must be one place; give one measurement for each place")
    return converted


def _length(value: Any) -> float:
    return number(value, "arc_length", least=0.0, unit="m")


def sensor_name(value: Any) -> str | None:
    """Check the name of a sensor; None passes."""
    if value is not None and not (isinstance(value, str) and re.fullmatch(r"[A-Za-z]\w*", value)):
        raise DefinitionError(f"sensor = {value!r} must be a name of letters, digits and underscores")
    return value


# -- files and reports -------------------------------------------------------------------------------------------------


@attrs.frozen
class Part:
    """The numbers of a block that reports summarize by their norm.

    ``name`` is their plural, ``title`` their name beside the place, ``unit`` their SI unit. ``first`` and ``last``
    select them in the block.
    """

    name: str
    title: str
    unit: str
    first: int | None = None
    last: int | None = None

    @property
    def of_block(self) -> slice:
        """The slice of these numbers in a block."""
        return slice(self.first, self.last)


def vector_sigma(unit: str) -> Entry:
    """The file entry of a standard deviation: one number, or one for each axis."""
    return Entry(unit, (3,), scalar_too=True)


def six(first: Any, last: Any) -> Array:
    """Six numbers from two triples; a scalar fills its triple."""
    return np.concatenate((np.broadcast_to(first, 3), np.broadcast_to(last, 3)))


# -- measurements ------------------------------------------------------------------------------------------------------


class Measurement(Checked, ABC):
    """Base of all measurements: whitening, checks, and the data for files and reports.

    Attributes
    ----------
    unit
        The standard deviation, SI, that replaces a missing one, so that residuals are reported in mm, mrad and so on.
    one_unit
        Whether all numbers of a block have one unit.
    columns
        SI units of vectors in tables of experiments, three columns ``<name>_x``, ``_y``, ``_z`` each.
    parts
        The parts of a block, for reports.
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
        """The observables of the robot that this measurement compares."""

    @property
    @abstractmethod
    def shape(self) -> tuple[int, int]:
        """Number of blocks of residuals, and their size."""

    @staticmethod
    @abstractmethod
    def compare(measured: Sequence[Any], values: ObservedList) -> tuple[Array, Array]:
        """Predicted minus measured values ``(E, blocks, size)``, SI, and derivatives ``(E, blocks, size, k)``.

        ``measured`` holds measurements of one kind and shape in E experiments. ``values`` are the predictions of their
        observables.
        """

    @property
    def scaled(self) -> bool:
        """Whether a noise level was given."""
        return self.sigma is not None

    @cached_property
    def whitener(self) -> Array:
        """Factors ``(blocks, size, size)`` that give the residuals unit covariance."""
        return whitening(self.sigma if self.scaled else self.unit, *self.shape)

    @cached_property
    def isotropic(self) -> Array:
        """The whitener with the root mean square of the axes' standard deviations along every axis.

        A block with several units keeps its own whitener.
        """
        if not self.one_unit:
            return self.whitener
        size = self.shape[1]
        variances = (np.linalg.inv(self.whitener) ** 2).sum(axis=(1, 2)) / size
        return frozen(np.eye(size) / np.sqrt(variances)[:, None, None])

    def whitener_for(self, loss: str) -> Array:
        """The whitener under a loss; the loss ``"distance"`` weighs all axes equally."""
        return self.isotropic if loss == "distance" else self.whitener

    def check(self, tubes: int) -> None:
        """Raise ``DefinitionError`` if a tube's number exceeds this number of ``tubes``."""
        for one in self.observables:
            for carrier in (one.tube, one.place.tube if isinstance(one.place, Distal) else None):
                if carrier is not None:
                    index(carrier, "tube", tubes)

    @classmethod
    def of_columns(cls, values: Mapping[str, Array], sigmas: Mapping[str, Any]) -> Measurement:
        """The measurement from its columns' vectors ``(3,)``, SI, and standard deviations, by column name."""
        raise NotImplementedError

    def to_columns(self) -> Mapping[str, Array]:
        """The vectors ``(3,)``, SI, by column name."""
        raise NotImplementedError


def whitening(sigma: Any, blocks: int, size: int, field: str = "sigma") -> Array:
    """Whitening factors ``(blocks, size, size)`` from standard deviations or covariances.

    A number is the standard deviation of every component; ``(size,)`` holds one for each axis. ``(size, size)`` is the
    covariance of every block; ``(blocks, size, size)`` holds one for each block.
    """
    if dimensions(sigma) == 0:
        return _of_one_deviation(number(sigma, field, above=0.0), blocks, size)
    spread = array(sigma, field, (None,) * dimensions(sigma))
    if spread.shape == (size,):
        if not (spread >= SMALLEST).all():
            raise DefinitionError(f"{field} = {spread.tolist()} must be positive, one for each axis")
        return np.broadcast_to(np.diag(1.0 / spread), (blocks, size, size))
    if spread.shape not in ((size, size), (blocks, size, size)):
        raise DefinitionError(
            f"{field} has shape {spread.shape}, but must be a number, have shape ({size},), or hold covariances of "
            f"shape ({size}, {size}) or ({blocks}, {size}, {size})"
        )
    try:
        deviations = np.sqrt(np.abs(np.diagonal(spread, axis1=-2, axis2=-1)))
        allowed = 1e-6 * deviations[..., :, None] * deviations[..., None, :]
        if np.any(np.abs(spread - np.swapaxes(spread, -1, -2)) > allowed):
            raise np.linalg.LinAlgError
        factor = np.linalg.cholesky(spread)
    except np.linalg.LinAlgError:
        raise DefinitionError(f"{field}: a covariance must be symmetric and positive definite") from None
    return np.broadcast_to(np.linalg.inv(factor), (blocks, size, size))


@lru_cache
def _of_one_deviation(sigma: float, blocks: int, size: int) -> Array:
    """The whitener of one standard deviation; the read-only result is shared by the measurements of a stream."""
    return np.broadcast_to(np.eye(size) / sigma, (blocks, size, size))


# -- points ------------------------------------------------------------------------------------------------------------

POINTS = Part("points", "", "m", last=3)
DIRECTIONS = Part("directions", "direction", "rad", first=-3)


def distances(measured: Sequence[Any], values: ObservedList) -> tuple[Array, Array]:
    """Predicted minus measured positions, and derivatives."""
    poses = Stacked.of(values)
    return poses.value[..., 3] - np.array([one.position for one in measured]), poses.slopes[:, :, :3]
