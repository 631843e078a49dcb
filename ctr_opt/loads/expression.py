"""User-defined force and moment: CasADi expressions of arc length, position and orientation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import attrs
import casadi as ca

from ..errors import DefinitionError
from .expressed import CONTENT_EQ, Expressed, entries, expression
from .field import Field, free


def _wrench(value: Any) -> Sequence[ca.SX]:
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise DefinitionError(f"function(s, p, R) must return a pair (force, moment), but returned {value!r}")
    return [entries(part, 3, f"the {name} of function(s, p, R)") for name, part in zip(_WRENCH, value, strict=True)]


_WRENCH = ("force", "moment")


def _function(value: Any) -> ca.Function:
    return expression(value, "function", _wrench)


@attrs.frozen
class ExpressionLoad(Expressed):
    """A user-defined force and moment that may depend on arc length, position and orientation.

    Examples are a magnetic field and the drag of a fluid.

    Parameters
    ----------
    function
        ``(s, p, R) -> (force, moment)``: CasADi expressions, ``(3,)`` each, in the world frame. ``s`` is the arc
        length (m), ``p (3,)`` the position (m, world frame), ``R (3, 3)`` the named tube's material frame. Units are
        N and N m at a point, N/m and N m/m per arc length. The expressions must be continuous. Split a load that jumps
        in ``s`` into several with adjoining ``start`` and ``end``. Also bound a load that is narrower than a
        thousandth of its interval by ``start`` and ``end``.
    arc_length, start, end, tube, factor
        As in :class:`PotentialLoad`.

    Raises
    ------
    DefinitionError
        The function fails, or returns something other than two CasADi vectors of three.

    Notes
    -----
    The load is taken to have no potential: ``formulation="energy"`` refuses it. Otherwise :class:`PotentialLoad`'s
    notes apply.

    Examples
    --------
    A force of 0.1 N that pushes along the tip's tangent, whatever its direction:

    >>> push = ExpressionLoad(lambda s, p, R: (0.1 * R[:, 2], [0, 0, 0]))
    >>> push.nonconservative
    'is given as an expression (ExpressionLoad)'
    """

    function: ca.Function = attrs.field(converter=_function, eq=CONTENT_EQ, hash=False)

    @property
    def nonconservative(self) -> str:
        """Why the load is taken to have no potential."""
        return "is given as an expression (ExpressionLoad)"

    @property
    def field(self) -> Field:
        """The load's expression, without its place and factor."""
        return free(self.function, self.tube)
