"""Loads that depend on where the robot is, as CasADi expressions: by a potential, or freely."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import attrs
import casadi as ca

from ..checks import number
from ..errors import DefinitionError
from . import places
from .kind import Conservative, Numbered

_ARGUMENTS = {"potential": ("p",), "function": ("s", "p", "R")}
_SHAPES = {"s": (1, 1), "p": (3, 1), "R": (3, 3)}


def _expression(value: Any, field: str, finish: Callable[[Any], Sequence[Any]]) -> ca.Function:
    """The user's function, called once with symbols and kept as a CasADi function."""
    names = _ARGUMENTS[field]
    if isinstance(value, ca.Function) and value.name() == field and _is_checked(value, field):
        return value
    arguments = f"{field}({', '.join(names)})"
    if not callable(value):
        raise DefinitionError(f"{field} = {value!r} must be a function {arguments} that returns CasADi expressions")
    symbols = [ca.SX.sym(name, *_SHAPES[name]) for name in names]
    try:
        results = finish(value(*symbols))
        return ca.Function(field, symbols, list(results))
    except DefinitionError:
        raise
    except Exception as error:
        reason = str(error).strip().splitlines()[-1] if str(error).strip() else type(error).__name__
        raise DefinitionError(
            f"{arguments} must return CasADi expressions of its arguments alone, built from elementary functions, "
            f"but failed: {type(error).__name__}: {reason}"
        ) from error


def _is_checked(function: ca.Function, field: str) -> bool:
    """Whether a CasADi function is one that was made here, of a load that is copied."""
    given = [function.size_in(i) for i in range(function.n_in())]
    returned = [function.size_out(i) for i in range(function.n_out())]
    wanted = [(1, 1)] if field == "potential" else [(3, 1), (3, 1)]
    arguments = [_SHAPES[name] for name in _ARGUMENTS[field]]
    return function.is_a("SXFunction") and given == arguments and returned == wanted


def _entries(value: Any, rows: int, what: str) -> ca.SX:
    result = ca.SX(ca.vertcat(*value)) if isinstance(value, (list, tuple)) else ca.SX(value)
    if result.shape != (rows, 1):
        wanted = "a scalar" if rows == 1 else f"a vector of {rows}"
        raise DefinitionError(f"{what} must be {wanted}, but has the shape {result.shape}")
    return ca.densify(result)


def _potential(value: Any) -> ca.Function:
    return _expression(value, "potential", lambda v: [_entries(v, 1, "potential(p)")])


def _wrench(value: Any) -> Sequence[ca.SX]:
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise DefinitionError(f"function(s, p, R) must return a pair (force, moment), but returned {value!r}")
    return [_entries(part, 3, f"the {name} of function(s, p, R)") for name, part in zip(_WRENCH, value, strict=True)]


_WRENCH = ("force", "moment")


def _function(value: Any) -> ca.Function:
    return _expression(value, "function", _wrench)


def _start(value: Any) -> float | None:
    return None if value is None else places.start(value)


def _factor(value: Any) -> float:
    return number(value, "factor")


_CONTENT_EQ = attrs.cmp_using(eq=lambda a, b: a.serialize() == b.serialize())


@attrs.frozen
class _Field(Numbered):
    """Where such a load acts."""

    units: ClassVar[dict[str, str]] = {"factor": "", "arc_length": "m", "start": "m", "end": "m"}
    arc_length: float | None = attrs.field(default=None, converter=places.arc_length, kw_only=True)
    start: float | None = attrs.field(default=None, converter=_start, kw_only=True)
    end: float | None = attrs.field(default=None, converter=places.end, kw_only=True)
    tube: int = attrs.field(default=0, converter=places.tube, kw_only=True)
    factor: float = attrs.field(default=1.0, converter=_factor, kw_only=True)

    def __attrs_post_init__(self) -> None:
        if self.distributed and self.arc_length is not None:
            raise DefinitionError(
                f"arc_length = {self.arc_length:g} m and start or end are both given: "
                "give arc_length for a load at a point, start and end for one per arc length"
            )
        places.check_interval(self.start or 0.0, self.end)

    @property
    def distributed(self) -> bool:
        """Whether it acts per arc length, between ``start`` and ``end``."""
        return self.start is not None or self.end is not None

    @property
    def fields(self) -> tuple[str, ...]:
        """The factor, and where it acts."""
        return ("factor", "start", "end") if self.distributed else ("factor", "arc_length")

    def idle(self, pulled: bool) -> str:  # noqa: ARG002
        """Why its numbers do not act."""
        return "" if self.factor != 0.0 else "factor = 0 leaves the load out"

    def times(self, factor: float) -> Any:
        """The load multiplied."""
        return attrs.evolve(self, factor=factor * self.factor)


@attrs.frozen
class PotentialLoad(_Field, Conservative):
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

    potential: ca.Function = attrs.field(converter=_potential, eq=_CONTENT_EQ, hash=False)


@attrs.frozen
class ExpressionLoad(_Field):
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

    function: ca.Function = attrs.field(converter=_function, eq=_CONTENT_EQ, hash=False)

    @property
    def nonconservative(self) -> str:
        """Why it is taken to have no potential."""
        return "is given as an expression (ExpressionLoad)"

    def conservative_part(self) -> None:
        """What of the load is known to have a potential: nothing."""
        return
