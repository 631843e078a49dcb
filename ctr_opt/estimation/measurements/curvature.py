"""Measured curvatures of a tube, such as those of a fibre in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from ...checks import ARRAY_EQ, Array, Entry, Table, array, described, dimensions, unchecked
from ...errors import DefinitionError
from ...layout.observables import Observable, ObservedList, Place, Stacked
from .kind import Measurement, Part, places


@attrs.frozen(eq=False, slots=False)
class CurvatureMeasurement(Measurement):
    """Measured curvatures of a tube in its material frame, such as those of a fibre with Bragg gratings.

    Parameters
    ----------
    arc_length
        One place or several: arc lengths, m; ``Distal(tube)``, a tube's end; or None, the tip.
    curvature
        Curvatures ``u_x, u_y``, 1/m, ``(2,)`` or ``(k, 2)``. A third column adds the tube's ``u_z``.
    sigma
        Standard deviation or covariances, 1/m, as in :class:`PositionMeasurement`.
    tube
        Number of the tube that carries the fibre.

    Examples
    --------
    >>> CurvatureMeasurement([0.02, 0.04], [[5.0, 0.0], [5.5, 0.1]], sigma=0.1).shape
    (2, 2)
    """

    arc_length: tuple[Place, ...] = attrs.field(converter=places)
    curvature: Array = attrs.field(eq=ARRAY_EQ, converter=unchecked)
    sigma: Any = None
    tube: int = attrs.field(default=0, converter=unchecked)

    entries = described(tube=Entry("tube"))
    unit = 1.0
    parts = (Part("curvatures", "curvature", "1/m"),)

    def _check(self) -> None:
        rows = np.atleast_2d(array(self.curvature, "curvature", (None,) * dimensions(self.curvature), unit="1/m"))
        if rows.shape not in ((len(self.arc_length), 2), (len(self.arc_length), 3)):
            raise DefinitionError(
                f"curvature has shape {rows.shape}, but must have shape ({len(self.arc_length)}, 2) or "
                f"({len(self.arc_length)}, 3), a row for each arc length"
            )
        object.__setattr__(self, "curvature", rows)

    @property
    def observables(self) -> tuple[Observable, ...]:
        """The tube's curvatures at these places."""
        return tuple(Observable("tube_curvature", place, self.tube) for place in self.arc_length)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of places, and two or three curvatures."""
        return self.curvature.shape[0], self.curvature.shape[1]

    @classmethod
    def tables(cls) -> tuple[Table, ...]:
        """The file table of two curvatures at places along a tube."""
        entries = {"sigma": Entry("1/m", (2,), scalar_too=True), **cls.in_files()}
        return (Table("curvatures", entries, _fibre, {"s": "m", "u_x": "1/m", "u_y": "1/m"}),)

    @staticmethod
    def compare(measured: Sequence[CurvatureMeasurement], values: ObservedList) -> tuple[Array, Array]:
        """Predicted minus measured curvatures, and derivatives."""
        size = measured[0].shape[1]
        predicted = Stacked.of(values)
        curvatures = np.array([measurement.curvature for measurement in measured])
        return predicted.value[..., :size] - curvatures, predicted.slopes[:, :, :size]


def _fibre(columns: Mapping[str, Array], sigma: Any, tube: int = 0) -> Measurement:
    return CurvatureMeasurement(columns["s"], np.column_stack((columns["u_x"], columns["u_y"])), sigma, tube)
