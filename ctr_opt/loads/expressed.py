"""Common part of user-defined loads given as CasADi expressions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import attrs
import casadi as ca

from ..checks import Entry, described, unchecked
from ..errors import DefinitionError
from . import place
from .field import Field
from .kind import Load, Number, Push

_ARGUMENTS = {"potential": ("p",), "function": ("s", "p", "R")}
_SHAPES = {"s": (1, 1), "p": (3, 1), "R": (3, 3)}


def expression(value: Any, field: str, finish: Callable[[Any], Sequence[Any]]) -> ca.Function:
    """Call the user's function once with symbols and keep the result as a CasADi function."""
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
    """Whether :func:`expression` made this CasADi function, for a load that is now copied."""
    inputs = [function.size_in(i) for i in range(function.n_in())]
    outputs = [function.size_out(i) for i in range(function.n_out())]
    expected_outputs = [(1, 1)] if field == "potential" else [(3, 1), (3, 1)]
    expected_inputs = [_SHAPES[name] for name in _ARGUMENTS[field]]
    return function.is_a("SXFunction") and inputs == expected_inputs and outputs == expected_outputs


def entries(value: Any, rows: int, what: str) -> ca.SX:
    """Convert the result of a user's function to a column of ``rows`` entries; messages call it ``what``."""
    result = ca.SX(ca.vertcat(*value)) if isinstance(value, (list, tuple)) else ca.SX(value)
    if result.shape != (rows, 1):
        wanted = "a scalar" if rows == 1 else f"a vector of {rows}"
        raise DefinitionError(f"{what} must be {wanted}, but has shape {result.shape}")
    return ca.densify(result)


CONTENT_EQ = attrs.cmp_using(eq=lambda a, b: a.serialize() == b.serialize())


@attrs.frozen
class Expressed(Load):
    """Base of loads given as expressions: where the load acts, and its factor."""

    entries = described(factor=Entry("1"), **place.POINT, start=place.ARC_LENGTH, end=place.ARC_LENGTH)
    arc_length: float | None = attrs.field(default=None, converter=unchecked, kw_only=True)
    start: float | None = attrs.field(default=None, converter=unchecked, kw_only=True)
    end: float | None = attrs.field(default=None, converter=unchecked, kw_only=True)
    tube: int = attrs.field(default=0, converter=unchecked, kw_only=True)
    factor: float = attrs.field(default=1.0, converter=unchecked, kw_only=True)

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        if self.distributed and self.arc_length is not None:
            raise DefinitionError(
                f"arc_length = {self.arc_length:g} m and start or end are both given: "
                "give arc_length for a load at a point, start and end for one per arc length"
            )
        place.check_interval(self.start or 0.0, self.end)

    @property
    def distributed(self) -> bool:
        """Whether the load acts per arc length, between ``start`` and ``end``."""
        return self.start is not None or self.end is not None

    @property
    def places(self) -> tuple[str, ...]:
        """Names of the arguments that say where the load acts."""
        return ("start", "end") if self.distributed else ("arc_length",)

    @property
    def field(self) -> Field:
        """The load's expression, without its place and factor."""
        raise NotImplementedError

    def lowered(self, number: Number, gravity: Any, masses: Sequence[Any]) -> Iterator[Push]:  # noqa: ARG002
        """Yield the expression times the factor; nothing if the factor is zero."""
        if self.factor != 0.0:
            yield Push(self.tube, self.places, field=self.field, factor=number("factor"))

    def idle(self, pulled: bool) -> str:  # noqa: ARG002
        """Why none of the load's numbers acts; empty if they act."""
        return "" if self.factor != 0.0 else "factor = 0 leaves the load out"
