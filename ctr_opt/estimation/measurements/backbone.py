"""Measured positions of points at unknown arc lengths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from ...checks import ARRAY_EQ, Array, Entry, Table, described, unchecked
from ...errors import DefinitionError
from ...layout.observables import Observable, ObservedList, Somewhere
from .kind import POINTS, Measurement, distances, vector_sigma
from .position import PositionMeasurement


@attrs.frozen(eq=False, slots=False)
class BackboneMeasurement(Measurement):
    """Measured positions of backbone points at unknown arc lengths, such as points of a scan or markers.

    The arc length of each point is estimated together with the parameters, between the entry point and the tip.
    :attr:`Fit.residuals <ctr_opt.Fit.residuals>` report the estimate.

    Parameters
    ----------
    position
        Points ``(k, 3)``, m, world frame.
    sigma
        Standard deviation or covariances, as in :class:`PositionMeasurement`.
    ordered
        Whether the points run from the entry point towards the tip. Their arc lengths then never decrease.

    Examples
    --------
    >>> BackboneMeasurement([[0.0, 0.0, 0.05], [0.01, 0.0, 0.08]], sigma=0.5e-3, ordered=True).shape
    (2, 3)
    """

    position: Array = attrs.field(eq=ARRAY_EQ, converter=unchecked)
    sigma: Any = None
    ordered: bool = attrs.field(default=False, converter=unchecked)

    entries = described(position=Entry("m", (None, 3)), ordered=Entry("flag"))
    parts = (POINTS,)

    def _check(self) -> None:
        if not len(self.position):
            raise DefinitionError("position = [] must hold at least one point, shape (k, 3)")

    @property
    def observables(self) -> tuple[Observable, ...]:
        """The pose at each point."""
        return (Observable("pose", Somewhere(), frame=0),) * len(self.position)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of points, and three coordinates."""
        return len(self.position), 3

    @classmethod
    def tables(cls) -> tuple[Table, ...]:
        """The file table of points, with or without arc lengths."""
        entries = {"sigma": vector_sigma("m"), "ordered?": cls.entries["ordered"]}
        return (Table("points", entries, _points, {"x": "m", "y": "m", "z": "m"}, {"s": "m"}),)

    @staticmethod
    def compare(measured: Sequence[BackboneMeasurement], values: ObservedList) -> tuple[Array, Array]:
        """Predicted minus measured positions, and derivatives at fixed arc lengths."""
        return distances(measured, values)


def _points(columns: Mapping[str, Array], sigma: Any, ordered: bool = False) -> Measurement:
    """Points of a table; with a column ``s`` a measurement at known arc lengths."""
    points = np.column_stack([columns[axis] for axis in "xyz"])
    if "s" not in columns:
        return BackboneMeasurement(points, sigma, ordered=ordered)
    if ordered:
        raise DefinitionError("ordered is for unknown arc lengths, but the table has a column s: remove one of them")
    return PositionMeasurement(columns["s"], points, sigma)
