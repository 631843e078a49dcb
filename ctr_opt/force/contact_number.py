"""An unknown number of contacts, chosen by the Bayesian information criterion."""

from __future__ import annotations

from typing import Any

import attrs
import numpy as np

from ..checks import ANY_EQ, Entry, described, unchecked
from ..loads import place
from .unknown import IN_FILES, PointForce, UnknownLoad


@attrs.frozen
class Contacts(UnknownLoad):
    """An unknown number of forces at unknown places along a tube.

    Every number of contacts up to ``most`` is tried. The one with the least Bayesian information criterion is chosen:
    ``BIC = 2 loss + k log n``, with ``k`` estimated numbers, four for each contact, and ``n`` measured numbers. The
    result holds this number of :class:`PointForce`; :attr:`~ctr_opt.ForceEstimate.evidence` lists the criterion for
    every number, zero included. Without other unknown loads the result has at least one contact. If zero contacts have
    the least criterion, the measurements show no contact.

    Parameters
    ----------
    most
        The largest number of contacts.
    tube
        Number of the tube in contact.
    prior
        Mean and standard deviation of every force, N, as for :class:`TipForce`.
    bounds, between
        Bounds of every force, N, and of every place, m, as for :class:`PointForce`.

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
    most: int = attrs.field(default=3, converter=unchecked)
    tube: int = attrs.field(default=0, converter=unchecked)
    prior: Any = attrs.field(default=None, eq=ANY_EQ, hash=False)
    bounds: Any = attrs.field(default=None, eq=ANY_EQ, hash=False)
    between: Any = attrs.field(default=None, eq=ANY_EQ, hash=False)

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        _ = self.forces(1)

    def choices(self, alone: bool) -> list[tuple[PointForce, ...]]:
        """The contacts for every number, from one if ``alone`` and from zero otherwise."""
        return [self.forces(count) for count in range(int(alone), self.most + 1)]

    def forces(self, count: int) -> tuple[PointForce, ...]:
        """The forces of this number of contacts."""
        contact = PointForce(tube=self.tube, prior=self.prior, bounds=self.bounds, between=self.between)
        return (contact,) * count


@attrs.frozen
class Evidence:
    """The least loss for a number of contacts, and its Bayesian information criterion."""

    contacts: int
    loss: float
    criterion: float

    @classmethod
    def of(cls, contacts: int, loss: float, numbers: int, measured: int) -> Evidence:
        """The evidence from a loss, with the counts of estimated and measured numbers."""
        return cls(contacts, loss, 2.0 * loss + numbers * float(np.log(measured)))
