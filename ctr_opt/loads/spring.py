"""Linear spring from a point of a tube to a fixed point in the world."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

import attrs
import casadi as ca

from ..checks import ARRAY_EQ, Array, Entry, described, unchecked
from . import place
from .field import potential
from .kind import Load, Number, Push


@cache
def _energy() -> ca.Function:
    p, anchor = ca.SX.sym("p", 3), ca.SX.sym("anchor", 3)
    return ca.Function("spring", [p, anchor], [0.5 * ca.sumsqr(p - anchor)], ["p", "anchor"], ["energy"])


@attrs.frozen
class Spring(Load):
    """A linear spring of zero rest length from a point of a tube to a fixed point.

    The force is ``k (anchor - p)``, with the potential ``k |p - anchor|^2 / 2``. Energies and stability are therefore
    defined under it.

    Parameters
    ----------
    stiffness
        ``k >= 0``, N/m; a spring of zero stiffness is left out.
    anchor
        The fixed point ``(3,)``, m, world frame.
    arc_length
        ``s`` of the point of the tube, m; ``None``: the tube's distal end, wherever it is.
    tube
        Index of the tube, 0 the innermost.

    Notes
    -----
    Stiffness, anchor and place are data: springs that differ only in numbers share their equations.

    Examples
    --------
    >>> import ctr_opt as ctr
    >>> rod = ctr.Tube("rod", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)
    >>> spring = Spring(10.0, anchor=[0.02, 0.0, 0.1])
    >>> shape = ctr.ForwardProblem(ctr.Robot([rod])).solve(ctr.Actuation([0.0], [0.0]), [spring])
    >>> pull = 10.0 * (spring.anchor - shape.tip_position)
    >>> bool(abs(shape.internal_force(0.0) - pull).max() < 1e-9)
    True
    """

    kind = "spring"
    entries = described(stiffness=Entry("N/m", least=0.0), anchor=Entry("m", (3,)), **place.POINT)
    amounts = ("stiffness",)
    stiffness: float = attrs.field(converter=unchecked)
    anchor: Array = attrs.field(converter=unchecked, eq=ARRAY_EQ, hash=False)
    arc_length: float | None = attrs.field(default=None, converter=unchecked)
    tube: int = attrs.field(default=0, converter=unchecked)

    def lowered(self, number: Number, gravity: Any, masses: Sequence[Any]) -> Iterator[Push]:  # noqa: ARG002
        """Yield the spring's energy times its stiffness; nothing if the stiffness is zero."""
        if self.stiffness > 0.0:
            factor, numbers = number("stiffness"), number("anchor")
            field = potential(_energy(), self.tube)
            yield Push(self.tube, self.places, field=field, factor=factor, numbers=numbers, anchor=self.anchor)

    def idle(self, pulled: bool) -> str:  # noqa: ARG002
        """Why none of the spring's numbers acts; empty if they act."""
        return "" if self.stiffness > 0.0 else "stiffness = 0 leaves the spring out"
