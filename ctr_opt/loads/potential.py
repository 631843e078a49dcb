"""User-defined conservative force: its potential is a CasADi expression of the position."""

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
    """A user-defined force ``-dV/dp`` that depends only on the position, such as an elastic wall.

    Parameters
    ----------
    potential
        ``V(p)``: a function of the position ``p (3,)`` (m, world frame, a CasADi symbol). It returns a scalar CasADi
        expression: J at a point, J/m per arc length. Its gradient must be continuous; it may have kinks, where the
        solver takes short steps.
    arc_length
        ``s`` of the point where the force acts, m; ``None``: the named tube's distal end.
    start, end
        Interval of ``s`` for a load per arc length, m; ``start=None``: 0, ``end=None``: the named tube's end.
        The load is distributed if either is given.
    tube
        Index of the tube that carries the load, 0 the innermost.
    factor
        Multiplies the potential.

    Raises
    ------
    DefinitionError
        The function fails, or returns something other than a CasADi scalar.

    Notes
    -----
    Each new expression builds the equations again, in a fraction of a second. The equations of the last few expressions
    are kept and recognized by content. Another place or ``factor`` builds nothing.

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
        """The load's potential, without its place and factor."""
        return potential(self.potential, self.tube)
