"""How many contacts there are: as many as the measurements have evidence for."""

from __future__ import annotations

from typing import Any

import attrs
import numpy as np

from ..checks import Entry, described, given
from ..loads import place
from .unknown import IN_FILES, PointForce, UnknownLoad


@attrs.frozen
class Contacts(UnknownLoad):
    """Several forces at unknown places along a tube, whose number is not known either.

    Every number up to ``most`` is tried, and that of the least Bayesian information criterion taken: ``BIC = 2 loss +
    k log n`` for ``k`` estimated numbers, four for each contact, and ``n`` measured ones. The estimate is then that of
    as many :class:`PointForce`, and its :attr:`~ctr_opt.ForceEstimate.evidence` the table of all numbers from none on.
    Alone, without other unknown loads, one contact is the least that is answered: where none has the least criterion,
    nothing is seen to touch the robot.

    Parameters
    ----------
    most
        How many there can be.
    tube
        The tube that is pressed.
    prior
        Of every force, N, as for :class:`TipForce`.
    bounds, between
        Of every force and place, as for :class:`PointForce`.

    Examples
    --------
    >>> len(Contacts(most=2).forces(2))
    2
    """

    kind = "contacts"
    entries = described(most=Entry("whole", least=1), tube=place.TUBE)
    in_file = IN_FILES
    somewhere = True
    steady = False
    most: int = attrs.field(default=3, converter=given)
    tube: int = attrs.field(default=0, converter=given)
    prior: Any = None
    bounds: Any = None
    between: Any = None

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        _ = self.forces(1)

    def choices(self, alone: bool) -> list[tuple[PointForce, ...]]:
        """Every number of contacts, of which alone there is one at least."""
        return [self.forces(count) for count in range(int(alone), self.most + 1)]

    def forces(self, count: int) -> tuple[PointForce, ...]:
        """So many contacts."""
        each = PointForce(tube=self.tube, prior=self.prior, bounds=self.bounds, between=self.between)
        return (each,) * count


@attrs.frozen
class Evidence:
    """For a number of contacts: the least loss that was found, and the Bayesian information criterion."""

    contacts: int
    loss: float
    criterion: float

    @classmethod
    def of(cls, contacts: int, loss: float, numbers: int, measured: int) -> Evidence:
        """Of so many estimated and measured numbers."""
        return cls(contacts, loss, 2.0 * loss + numbers * float(np.log(measured)))
