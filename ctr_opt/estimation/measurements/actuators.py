"""What actuators exert on tubes' bases: torques and forces, one number each."""

from __future__ import annotations

from collections.abc import Sequence

import attrs
import numpy as np

from ...checks import Array, Entry, Table, described, given
from ...layout.observables import Observable, ObservedList
from .kind import Measurement, Part


class _OfActuator(Measurement):
    """One number, predicted under the name of the measurement's field, which is its ``kind``."""

    tube: int

    @property
    def observables(self) -> tuple[Observable, ...]:
        """Of the tube's actuator."""
        return (Observable(f"actuator_{self.kind}", None, self.tube),)

    @property
    def shape(self) -> tuple[int, int]:
        """One number."""
        return 1, 1

    @classmethod
    def tables(cls) -> tuple[Table, ...]:
        """Of a tube's actuator."""
        return (Table(cls.kind, {**cls.in_files(), "sigma": cls.entries[cls.kind]}, cls),)

    @staticmethod
    def compare(measured: Sequence[_OfActuator], values: ObservedList) -> tuple[Array, Array]:
        """Differences of the numbers, and derivatives."""
        numbers = np.array([[[getattr(one, one.kind)]] for one in measured])
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

    kind = "torque"
    entries = described(tube=Entry("tube"), torque=Entry("N m"))
    tube: int = attrs.field(converter=given)
    torque: float = attrs.field(converter=given)
    sigma: float | None = None
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

    kind = "force"
    entries = described(tube=Entry("tube"), force=Entry("N"))
    tube: int = attrs.field(converter=given)
    force: float = attrs.field(converter=given)
    sigma: float | None = None
    parts = (Part("forces", "force", "N"),)
