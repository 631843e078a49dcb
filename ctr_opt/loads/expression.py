"""A force and a moment of place, position and orientation, given as CasADi expressions."""

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
    """Any force and moment that depend on place, position and orientation: a magnetic field, a fluid's drag.

    Parameters
    ----------
    function
        ``(s, p, R) -> (force, moment)``: CasADi expressions ``(3,)`` each, world frame, of the arc length ``s`` (m),
        the position ``p (3,)`` (m, world frame) and the named tube's material frame ``R (3, 3)``; N and N m at a
        point, N/m and N m/m per arc length. They must be continuous; where one jumps in ``s``, cut it into loads with
        ``start`` and ``end`` of their own, and do so for one that is narrower than a thousandth of its interval.
    arc_length, start, end, tube, factor
        As in :class:`PotentialLoad`.

    Notes
    -----
    It is taken to have no potential: ``formulation="energy"`` refuses it. Otherwise as :class:`PotentialLoad`.

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
        """Why it is taken to have no potential."""
        return "is given as an expression (ExpressionLoad)"

    @property
    def field(self) -> Field:
        """The expression."""
        return free(self.function, self.tube)
