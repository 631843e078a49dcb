"""Measured curvatures of a tube, as of a fibre in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from ...checks import ARRAY_EQ, Array, Entry, Table, array, described, given
from ...errors import DefinitionError
from ...layout.observables import Observable, ObservedList, Place, Stacked
from .kind import Measurement, Part, places


@attrs.frozen(eq=False, slots=False)
class CurvatureMeasurement(Measurement):
    """Measured curvature of a tube, as of a fibre with Bragg gratings in it, in that tube's material frame.

    Parameters
    ----------
    arc_length
        Where: arc lengths, ends of tubes or None, the tip; one place or several.
    curvature
        ``(2,)`` or ``(k, 2)``, 1/m: ``u_x, u_y``; with a third column also the tube's ``u_z``.
    sigma
        As in :class:`PositionMeasurement`, 1/m.
    tube
        The tube that carries the fibre.

    Examples
    --------
    >>> CurvatureMeasurement([0.02, 0.04], [[5.0, 0.0], [5.5, 0.1]], sigma=0.1).shape
    (2, 2)
    """

    arc_length: tuple[Place, ...] = attrs.field(converter=places)
    curvature: Array = attrs.field(eq=ARRAY_EQ, converter=given)
    sigma: Any = None
    tube: int = attrs.field(default=0, converter=given)

    entries = described(tube=Entry("tube"))
    unit = 1.0
    parts = (Part("curvatures", "curvature", "1/m"),)

    def _check(self) -> None:
        rows = np.atleast_2d(array(self.curvature, "curvature", (None,) * np.ndim(self.curvature), unit="1/m"))
        if rows.shape not in ((len(self.arc_length), 2), (len(self.arc_length), 3)):
            raise DefinitionError(
                f"curvature has shape {rows.shape}, but must have shape ({len(self.arc_length)}, 2) or "
                f"({len(self.arc_length)}, 3), a row for each arc length"
            )
        object.__setattr__(self, "curvature", rows)

    @property
    def observables(self) -> tuple[Observable, ...]:
        """Curvatures at the places."""
        return tuple(Observable("tube_curvature", place, self.tube) for place in self.arc_length)

    @property
    def shape(self) -> tuple[int, int]:
        """Places, and two or three numbers."""
        return self.curvature.shape[0], self.curvature.shape[1]

    @classmethod
    def tables(cls) -> tuple[Table, ...]:
        """Two curvatures at places along a tube."""
        entries = {"sigma": Entry("1/m", (2,), scalar_too=True), **cls.in_files()}
        return (Table("curvatures", entries, _fibre, {"s": "m", "u_x": "1/m", "u_y": "1/m"}),)

    @staticmethod
    def compare(measured: Sequence[CurvatureMeasurement], values: ObservedList) -> tuple[Array, Array]:
        """Differences of the curvatures, and derivatives."""
        size = measured[0].shape[1]
        predicted = Stacked.of(values)
        off = predicted.value[..., :size] - np.array([one.curvature for one in measured])
        return off, predicted.slopes[:, :, :size]


def _fibre(columns: Mapping[str, Array], sigma: Any, tube: int = 0) -> Measurement:
    return CurvatureMeasurement(columns["s"], np.column_stack((columns["u_x"], columns["u_y"])), sigma, tube)
