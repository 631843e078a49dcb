"""Measured force and moment of a robot on its support."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from ...checks import ARRAY_EQ, Array, Entry, Table, described, dimensions, unchecked
from ...errors import DefinitionError
from ...layout.observables import Observable, ObservedList
from .kind import Measurement, Part, six, vector_sigma


def _sigma(value: Any) -> Any:
    """Standard deviations of six components, from a pair of force and moment; a covariance stays as it is."""
    pair = isinstance(value, (list, tuple, np.ndarray)) and dimensions(value) and len(value) == 2
    return six(*value) if pair and all(np.size(part) in (1, 3) and dimensions(part) < 2 for part in value) else value


@attrs.frozen(eq=False, slots=False)
class BaseWrenchMeasurement(Measurement):
    """The measured wrench of the robot on its support, as a six-axis sensor under the robot measures it.

    The wrench is the resultant of all loads in front of and at the entry point, weights included. By the balance of
    forces and moments, ``F = sum f`` and ``M = sum (p - p_0) x f + l``, with forces ``f`` and moments ``l`` at points
    ``p`` and the entry point ``p_0``. Actuators act behind the entry point. The sensor carries them too, so that their
    forces and torques are internal and do not appear. The weight of parts behind the entry point is not included:
    tare the sensor with these parts mounted, or subtract their weight.

    Parameters
    ----------
    wrench
        ``(6,)``: force, N, and moment about the entry point, N m, world frame, as
        :attr:`Equilibrium.base_wrench <ctr_opt.Equilibrium.base_wrench>` defines it.
    sigma
        Standard deviations of force (N) and moment (N m), as a pair of numbers or ``(6,)``; or a covariance ``(6, 6)``.
        None: the noise level is estimated from the residuals.

    Examples
    --------
    A rod of 0.1 m along z with a lateral force at its tip:

    >>> BaseWrenchMeasurement([0.2, 0.0, 0.0, 0.0, 0.02, 0.0], sigma=(0.01, 5e-4)).shape
    (1, 6)
    """

    wrench: Array = attrs.field(eq=ARRAY_EQ, converter=unchecked)
    sigma: Any = attrs.field(default=None, converter=_sigma)

    entries = described(wrench=Entry("1", (6,)))
    one_unit = False
    parts = (Part("wrenches", "base force", "N", last=3), Part("wrenches", "base moment", "N m", first=3))
    columns = {"base_force": "N", "base_moment": "N m"}  # noqa: RUF012

    @property
    def observables(self) -> tuple[Observable, ...]:
        """The base wrench."""
        return (Observable("base_wrench"),)

    @property
    def shape(self) -> tuple[int, int]:
        """One block of six numbers."""
        return 1, 6

    @classmethod
    def tables(cls) -> tuple[Table, ...]:
        """The file table of force and moment."""
        entries = {"force": Entry("N", (3,)), "moment": Entry("N m", (3,))}
        entries |= {"force_sigma": vector_sigma("N"), "moment_sigma": vector_sigma("N m")}
        return (Table("base_wrench", entries, _of_parts),)

    @classmethod
    def of_columns(cls, values: Mapping[str, Array], sigmas: Mapping[str, Any]) -> Measurement:
        """The measurement from force and moment; standard deviations are given for both or for neither."""
        deviations = [sigmas[name] for name in cls.columns]
        if sum(deviation is None for deviation in deviations) == 1:
            raise DefinitionError("sigma must be given for both base_force and base_moment, or for neither")
        sigma = None if deviations[0] is None else six(*deviations)
        return cls(np.concatenate([values[name] for name in cls.columns]), sigma)

    def to_columns(self) -> Mapping[str, Array]:
        """Force and moment, by column name."""
        return dict(zip(self.columns, np.split(self.wrench, 2), strict=True))

    @staticmethod
    def compare(measured: Sequence[BaseWrenchMeasurement], values: ObservedList) -> tuple[Array, Array]:
        """Predicted minus measured wrenches, and derivatives."""
        wrenches = np.array([measurement.wrench for measurement in measured])
        return (values[0].value - wrenches)[:, None], values[0].slopes[:, None]


def _of_parts(force: Any, moment: Any, force_sigma: Any, moment_sigma: Any) -> Measurement:
    return BaseWrenchMeasurement(six(force, moment), six(force_sigma, moment_sigma))
