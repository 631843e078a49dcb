"""A nonlinear program of named blocks, so that failures are reported in terms of the model."""

from __future__ import annotations

from collections.abc import Sequence

import attrs
import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..checks import Array


@attrs.frozen(eq=False)
class Block:
    """Rows of a vector that belong together: a matrix whose columns are steps (or nodes) and whose rows have names."""

    name: str
    start: int
    rows: tuple[str, ...]
    columns: int

    @property
    def indices(self) -> NDArray[np.intp]:
        """Positions in the vector, shape ``(rows, columns)``."""
        size = len(self.rows) * self.columns
        return np.arange(self.start, self.start + size).reshape((len(self.rows), self.columns), order="F")

    def take(self, vector: Array) -> Array:
        """The block's part of the whole vector, ``(rows, columns)``."""
        return np.asarray(vector[self.indices])


@attrs.frozen(eq=False)
class Nlp:
    """A program: minimize ``f(x, p)`` subject to ``g(x, p) = 0``, with the blocks of ``x`` and ``g``."""

    x: ca.MX
    p: ca.MX
    f: ca.MX
    g: ca.MX
    variables: dict[str, Block]
    constraints: dict[str, Block]

    def describe_constraint(self, index: int) -> str:
        """The name of a row of ``g``, like ``collocation 3, node 2, psi_1``."""
        block = next(b for b in self.constraints.values() if b.start <= index < b.start + len(b.rows) * b.columns)
        column, row = divmod(index - block.start, len(block.rows))
        return f"{block.name}{'' if block.columns == 1 else f' {column}'}, {block.rows[row]}"


def padded(count: int) -> int:
    """The count rounded up to a size that programs are built for: 4, 6, 8, 12, 16, 24, 32, 48, ..."""
    size = 4
    while size < count:
        size = size * 3 // 2 if size & (size - 1) == 0 else size * 4 // 3
    return size


class NlpBuilder:
    """Collects named variables, parameters and equations; ends with :meth:`build`."""

    def __init__(self) -> None:
        self._x: list[ca.MX] = []
        self._p: list[ca.MX] = []
        self._g: list[ca.MX] = []
        self._variables: dict[str, Block] = {}
        self._constraints: dict[str, Block] = {}

    def variable(self, name: str, rows: Sequence[str], columns: int = 1) -> ca.MX:
        """A block of decision variables, ``(rows, columns)``."""
        symbol = ca.MX.sym(name, len(rows), columns)
        self._variables[name] = Block(name, sum(x.numel() for x in self._x), tuple(rows), columns)
        self._x.append(symbol)
        return symbol

    def parameter(self, name: str, rows: int, columns: int = 1) -> ca.MX:
        """A block of parameters; the solver takes them in the order of these calls."""
        symbol = ca.MX.sym(name, rows, columns)
        self._p.append(symbol)
        return symbol

    def equation(self, name: str, rows: Sequence[str], expression: ca.MX) -> None:
        """Add the block of equations ``expression (rows, columns) = 0``."""
        columns = expression.numel() // len(rows)
        self._constraints[name] = Block(name, sum(g.numel() for g in self._g), tuple(rows), columns)
        self._g.append(expression)

    def build(self, objective: ca.MX | float = 0.0) -> Nlp:
        """Build the program from all variables, parameters and equations."""
        objective = ca.MX(objective)
        return Nlp(
            ca.veccat(*self._x), ca.veccat(*self._p), objective, ca.veccat(*self._g), self._variables, self._constraints
        )
