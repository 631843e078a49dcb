"""A force that has a potential of the position, given as a CasADi expression."""

from __future__ import annotations

from typing import Any

import attrs
import casadi as ca

from .expressed import CONTENT_EQ, Expressed, entries, expression
from .field import Field, potential


def _potential(value: Any) -> ca.Function:
    return expression(value, "potential", lambda v: [entries(v, 1, "potential(p)")])


@attrs.frozen
class PotentialLoad(Expressed):
    """A force ``-dV/dp`` that depends on the position alone: an elastic wall, a spring to a point.

    Parameters
    ----------
    potential
        ``V(p)``: a function of the position ``p (3,)`` (m, world frame, a CasADi symbol) that returns a scalar CasADi
        expression: J at a point, J/m per arc length. Its gradient must be continuous (kinks are met by short steps).
    arc_length
        ``s`` of the point it acts at, m; ``None``: the named tube's distal end.
    start, end
        For a load per arc length: the interval of ``s``, m; ``start=None``: 0, ``end=None``: the named tube's end.
        Giving either makes the load a distributed one.
    tube
        Index of the tube that carries it, 0 the innermost.
    factor
        Multiplies the potential.

    Notes
    -----
    The equations are built anew for every new expression, in a fraction of a second, and kept for the last few, told by
    their content; another place or ``factor`` costs nothing.

    Examples
    --------
    A wall at x = 10 mm with a foundation of 20 kN/m^2 along the whole robot:

    >>> import casadi as ca
    >>> wall = PotentialLoad(lambda p: 1e4 * ca.fmax(p[0] - 0.01, 0) ** 2, start=0.0)
    >>> wall.distributed
    True
    """

    potential: ca.Function = attrs.field(converter=_potential, eq=CONTENT_EQ, hash=False)

    @property
    def field(self) -> Field:
        """The potential."""
        return potential(self.potential, self.tube)
