"""Measured torques and forces of actuators on the tubes' bases, one number each."""

from __future__ import annotations

from collections.abc import Sequence

import attrs
import numpy as np

from ...checks import Array, Entry, Table, described, unchecked
from ...layout.observables import Observable, ObservedList
from .kind import Measurement, Part


class _OfActuator(Measurement):
    """A measurement of one number, whose field and observable are named after its ``kind``."""

    tube: int

    @property
    def observables(self) -> tuple[Observable, ...]:
        """The torque or force of the tube's actuator."""
        return (Observable(f"actuator_{self.kind}", None, self.tube),)

    @property
    def shape(self) -> tuple[int, int]:
        """One block of one number."""
        return 1, 1

    @classmethod
    def tables(cls) -> tuple[Table, ...]:
        """The file table of a tube's actuator."""
        return (Table(cls.kind, {**cls.in_files(), "sigma": cls.entries[cls.kind]}, cls),)

    @staticmethod
    def compare(measured: Sequence[_OfActuator], values: ObservedList) -> tuple[Array, Array]:
        """Predicted minus measured numbers, and derivatives."""
        numbers = np.array([[[getattr(measurement, measurement.kind)]] for measurement in measured])
        return values[0].value[:, None] - numbers, values[0].slopes[:, None]


@attrs.frozen(eq=False, slots=False)
class TorqueMeasurement(_OfActuator):
    """The measured torque of an actuator on a tube's base, N m, about +z of the entry frame.

    Parameters
    ----------
    tube
        Number of the tube; 0 is the innermost.
    torque
        Measured torque, N m, as :meth:`Equilibrium.actuator_wrench <ctr_opt.Equilibrium.actuator_wrench>` defines it.
    sigma
        Standard deviation, N m. None: the noise level is estimated from the residuals.

    Examples
    --------
    >>> TorqueMeasurement(0, 1.5e-3, sigma=1e-4).shape
    (1, 1)
    """

    kind = "torque"
    entries = described(tube=Entry("tube"), torque=Entry("N m"))
    tube: int = attrs.field(converter=unchecked)
    torque: float = attrs.field(converter=unchecked)
    sigma: float | None = None
    parts = (Part("torques", "torque", "N m"),)


@attrs.frozen(eq=False, slots=False)
class ForceMeasurement(_OfActuator):
    """The measured axial force of an actuator on a tube's base, N, along +z of the entry frame.

    Parameters
    ----------
    tube
        Number of the tube; 0 is the innermost.
    force
        Measured force, N, as :meth:`Equilibrium.actuator_wrench <ctr_opt.Equilibrium.actuator_wrench>` defines it. The
        model has no friction.
    sigma
        Standard deviation, N. None: the noise level is estimated from the residuals.

    Examples
    --------
    >>> ForceMeasurement(0, -0.8, sigma=0.02).shape
    (1, 1)
    """

    kind = "force"
    entries = described(tube=Entry("tube"), force=Entry("N"))
    tube: int = attrs.field(converter=unchecked)
    force: float = attrs.field(converter=unchecked)
    sigma: float | None = None
    parts = (Part("forces", "force", "N"),)
