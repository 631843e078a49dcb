"""Observable quantities of a robot and their places, for derivatives, measurements and compiled predictions.

A new quantity is an entry of ``QUANTITIES``. ``transcription/observing.py`` defines it in symbols, and
``native/predictions.py`` says where compiled code reports it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias, overload

import attrs
import numpy as np

from ..checks import Array, index
from .ends import Ends


def _tube(value: Any) -> int:
    return index(value, "tube")


@attrs.frozen
class Distal:
    """The distal end of a tube, which moves with the tube's translation and length.

    Parameters
    ----------
    tube
        Index of the tube, 0 the innermost.

    Examples
    --------
    >>> Distal(1)
    Distal(tube=1)
    """

    tube: int = attrs.field(converter=_tube)


@attrs.frozen
class Somewhere:
    """An unknown place on the backbone, which is estimated."""


Place: TypeAlias = "float | Distal | None"
"""An arc length from the entry point, m; the end of a tube; or None, the tip."""


def arc_length_of(place: Place, ends: Ends) -> float:
    """Arc length of a place, m, on a robot whose tubes end at ``ends``."""
    return place if isinstance(place, float) else ends.of(None if place is None else place.tube)


@attrs.frozen
class Quantity:
    """A quantity that can be observed.

    ``size`` counts the numbers of its value, ``rates`` those of its derivative (default: ``size``). ``at`` says what it
    belongs to: a ``"place"`` along the robot, a ``"tube"``, or the ``"robot"``. ``jumps`` says whether it jumps along
    the robot, so that its value needs a side; ``integral``, whether it takes integrals along the robot.
    """

    size: int
    at: str = "place"
    jumps: bool = False
    integral: bool = False
    rates: int = attrs.field()

    @rates.default
    def _default_rates(self) -> int:
        return self.size


QUANTITIES = {
    "position": Quantity(3),
    "pose": Quantity(12, rates=6),  # of a tube's material frame: position, and the frame column by column
    "tube_angle": Quantity(1),
    "curvature": Quantity(3, jumps=True),  # of the backbone, in the backbone frame
    "tube_curvature": Quantity(3, jumps=True),  # of a tube, in the tube's frame
    "torsion": Quantity(1, jumps=True),
    "tube_moment": Quantity(3, jumps=True),
    "internal_force": Quantity(3, jumps=True),
    "internal_moment": Quantity(3, jumps=True),
    "actuator_force": Quantity(1, "tube", integral=True),
    "actuator_torque": Quantity(1, "tube"),
    "actuator_wrench": Quantity(2, "tube", integral=True),
    "energy": Quantity(1, "robot", integral=True),
    "load_work": Quantity(1, "robot", integral=True),
    "potential_energy": Quantity(1, "robot", integral=True),
    "base_wrench": Quantity(6, "robot"),  # force and moment on the support, of all loads, about the entry point
}
"""All quantities by name; values are those of an equilibrium's attributes and methods, SI."""


@attrs.frozen
class Observable:
    """A quantity of ``QUANTITIES`` with its place and tube.

    ``tube`` is the tube whose quantity it is, or on which the place must lie; None: anywhere on the robot. ``frame`` is
    the tube whose frame a pose describes, None until the robot is known; it is 0 where any frame serves, as for
    positions. With ``sensor``, the pose is that of a sensor on that tube.
    """

    name: str
    place: Place | Somewhere = None
    tube: int | None = None
    sensor: str | None = None
    frame: int | None = None

    @property
    def quantity(self) -> Quantity:
        """Description of the observed quantity."""
        return QUANTITIES[self.name]

    @property
    def placed(self) -> bool:
        """Whether the place is an arc length, a number that may change."""
        return isinstance(self.place, (float, Somewhere))

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of its derivatives; a pose has six numbers, for position and rotation."""
        return () if self.quantity.rates == 1 else (self.quantity.rates,)

    @property
    def on(self) -> int | None:
        """The tube on which the place must lie; None: anywhere on the robot."""
        return self.tube if self.quantity.at == "place" else None

    @property
    def carrier(self) -> int | None:
        """The tube whose quantity it is, if known."""
        return self.tube if self.frame is None else self.frame

    def framed(self, ends: Ends) -> Observable:
        """Fix the tube whose frame a pose describes, on a robot whose tubes end at ``ends``.

        It is the named tube, the tube whose distal end is the place, or the innermost tube there. It stays fixed when
        an estimate moves the ends a little.
        """
        if self.name != "pose" or self.frame is not None or isinstance(self.place, Somewhere):
            return self
        tube = self.place.tube if self.tube is None and isinstance(self.place, Distal) else self.tube
        return attrs.evolve(self, frame=ends.innermost(arc_length_of(self.place, ends)) if tube is None else tube)


# -- values ------------------------------------------------------------------------------------------------------------


@attrs.frozen(eq=False)
class Observed:
    """Values of an observable in E experiments, and their derivatives by k numbers.

    Shapes are ``(E, size)`` and ``(E, size, k)``. Poses are ``(E, 3, 4)``, with rates ``(E, 6, k)`` of position and
    rotation (world angular velocity).
    """

    value: Array
    slopes: Array


@attrs.frozen(eq=False)
class Stacked:
    """Values of several observables of one quantity in one array, instead of a list of :class:`Observed`.

    Shapes are ``(E, observables, ...)`` and ``(E, observables, ..., k)``.
    """

    value: Array
    slopes: Array

    @classmethod
    def of(cls, values: ObservedList) -> Stacked:
        """Stack values of equal shape."""
        if isinstance(values, Stacked):
            return values
        parts = ([getattr(observed, part) for observed in values] for part in ("value", "slopes"))
        return cls(*(np.stack(part, axis=1) for part in parts))

    @overload
    def __getitem__(self, k: int) -> Observed: ...

    @overload
    def __getitem__(self, k: slice) -> Stacked: ...

    def __getitem__(self, k: int | slice) -> Observed | Stacked:
        """Select the values of one observable, or of several by a slice."""
        kind = Stacked if isinstance(k, slice) else Observed
        return kind(self.value[:, k], self.slopes[:, k])


ObservedList: TypeAlias = "Sequence[Observed] | Stacked"
"""Values of observables, one for each."""


def posed(numbers: Array, slopes: Array) -> Observed:
    """Make poses from positions and frames ``(E, 12)``, frames column by column, and their slopes ``(E, 12, k)``.

    The world angular velocity of ``dR`` is ``vee(dR R^T - R dR^T) / 2``.
    """
    count = len(numbers)
    frames = np.swapaxes(numbers[:, 3:].reshape(count, 3, 3), 1, 2)
    rates = slopes[:, 3:].reshape(count, 3, 3, -1)  # [column, row]
    turn = np.einsum("ecrk,eqc->erqk", rates, frames)  # dR R^T
    turned = 0.5 * np.stack(
        (turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]), axis=1
    )
    poses = np.concatenate((frames, numbers[:, :3, None]), axis=2)
    return Observed(poses, np.concatenate((slopes[:, :3], turned), axis=1))
