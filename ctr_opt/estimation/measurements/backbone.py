"""Measured positions of points at unknown places of the backbone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from ...checks import ARRAY_EQ, Array, Entry, Table, described, given
from ...errors import DefinitionError
from ...layout.observables import Observable, ObservedList, Somewhere
from .kind import POINTS, Measurement, distances, vector_sigma
from .position import PositionMeasurement


@attrs.frozen(eq=False, slots=False)
class BackboneMeasurement(Measurement):
    """Measured positions of points somewhere on the backbone, as of a scan or of markers, at unknown arc lengths.

    Each point's arc length is estimated with the parameters, between the entry point and the tip, and
    :attr:`Fit.residuals <ctr_opt.Fit.residuals>` tell it.

    Parameters
    ----------
    position
        ``(k, 3)``, m, world frame.
    sigma
        As in :class:`PositionMeasurement`.
    ordered
        Whether the points are given from the entry point towards the tip, so that no arc length is below the one before
        it.

    Examples
    --------
    >>> BackboneMeasurement([[0.0, 0.0, 0.05], [0.01, 0.0, 0.08]], sigma=0.5e-3, ordered=True).shape
    (2, 3)
    """

    position: Array = attrs.field(eq=ARRAY_EQ, converter=given)
    sigma: Any = None
    ordered: bool = attrs.field(default=False, converter=given)

    entries = described(position=Entry("m", (None, 3)), ordered=Entry("flag"))
    parts = (POINTS,)

    def _check(self) -> None:
        if not len(self.position):
            raise DefinitionError("position = [] must hold at least one point, shape (k, 3)")

    @property
    def observables(self) -> tuple[Observable, ...]:
        """A pose for each point."""
        return (Observable("pose", Somewhere(), frame=0),) * len(self.position)

    @property
    def shape(self) -> tuple[int, int]:
        """Points, and three coordinates."""
        return len(self.position), 3

    @classmethod
    def tables(cls) -> tuple[Table, ...]:
        """Points, which may have arc lengths."""
        entries = {"sigma": vector_sigma("m"), "ordered?": cls.entries["ordered"]}
        return (Table("points", entries, _points, {"x": "m", "y": "m", "z": "m"}, {"s": "m"}),)

    @staticmethod
    def compare(measured: Sequence[BackboneMeasurement], values: ObservedList) -> tuple[Array, Array]:
        """Distances to the points, and derivatives, places held."""
        return distances(measured, values)


def _points(columns: Mapping[str, Array], sigma: Any, ordered: bool = False) -> Measurement:
    """Points of a table, at known places if it has a column of them."""
    points = np.column_stack([columns[axis] for axis in "xyz"])
    if "s" not in columns:
        return BackboneMeasurement(points, sigma, ordered=ordered)
    if ordered:
        raise DefinitionError("ordered is for points whose arc lengths are unknown, but the table has a column s")
    return PositionMeasurement(columns["s"], points, sigma)
