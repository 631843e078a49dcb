"""What actuators exert on tubes' bases: torques and forces, one number each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import attrs
import numpy as np

from ...checks import Array, Entry, Table, number
from ...layout.observables import Observable, ObservedList
from .kind import Measurement, Part
from .kind import tube as tube_index


def _torque(value: Any) -> float:
    return number(value, "torque", unit="N m")


def _force(value: Any) -> float:
    return number(value, "force", unit="N")


class _OfActuator(Measurement):
    """One number, predicted under the name of the measurement's field."""

    field: ClassVar[str]
    si: ClassVar[str]
    tube: int

    def __attrs_post_init__(self) -> None:
        _ = self.whitener

    @property
    def observables(self) -> tuple[Observable, ...]:
        """Of the tube's actuator."""
        return (Observable(f"actuator_{self.field}", None, self.tube),)

    @property
    def shape(self) -> tuple[int, int]:
        """One number."""
        return 1, 1

    @classmethod
    def tables(cls) -> tuple[Table, ...]:
        """Of a tube's actuator."""
        number_of = Entry(cls.si)
        return (Table(cls.field, {"tube": Entry("tube"), cls.field: number_of, "sigma": number_of}, cls),)

    @staticmethod
    def compare(measured: Sequence[_OfActuator], values: ObservedList) -> tuple[Array, Array]:
        """Differences of the numbers, and derivatives."""
        numbers = np.array([[[getattr(one, one.field)]] for one in measured])
        return values[0].value[:, None] - numbers, values[0].slopes[:, None]


@attrs.frozen(eq=False, slots=False)
class TorqueMeasurement(_OfActuator):
    """A measured torque of an actuator on a tube's base, N m, about +z of the entry frame.

    Parameters
    ----------
    tube
        The tube.
    torque
        N m, as :meth:`Equilibrium.actuator_wrench <ctr_opt.Equilibrium.actuator_wrench>` gives it.
    sigma
        Standard deviation, N m, or None.

    Examples
    --------
    >>> TorqueMeasurement(0, 1.5e-3, sigma=1e-4).shape
    (1, 1)
    """

    tube: int = attrs.field(converter=tube_index)
    torque: float = attrs.field(converter=_torque)
    sigma: float | None = None

    field, si = "torque", "N m"
    parts = (Part("torques", "torque", "N m"),)


@attrs.frozen(eq=False, slots=False)
class ForceMeasurement(_OfActuator):
    """A measured axial force of an actuator on a tube's base, N, along +z of the entry frame.

    Parameters
    ----------
    tube
        The tube.
    force
        N, as :meth:`Equilibrium.actuator_wrench <ctr_opt.Equilibrium.actuator_wrench>` gives it: without friction.
    sigma
        Standard deviation, N, or None.

    Examples
    --------
    >>> ForceMeasurement(0, -0.8, sigma=0.02).shape
    (1, 1)
    """

    tube: int = attrs.field(converter=tube_index)
    force: float = attrs.field(converter=_force)
    sigma: float | None = None

    field, si = "force", "N"
    parts = (Part("forces", "force", "N"),)
