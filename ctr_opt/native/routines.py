"""C functions from CasADi's: straight-line code, one statement for each instruction of a ``Function`` of SX.

The instructions are read by CasADi's public interface (``n_instructions``, ``instruction_id``, ...). The text of its
code generator may change with any version, and its functions check their pointers at each call.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import attrs
import casadi as ca
import numpy as np

_OPERATIONS = {
    **{ca.OP_ADD: "{} + {}", ca.OP_SUB: "{} - {}", ca.OP_MUL: "{} * {}", ca.OP_DIV: "{} / {}", ca.OP_NEG: "-{}"},
    **{ca.OP_SQ: "{0} * {0}", ca.OP_TWICE: "2.0 * {}", ca.OP_INV: "1.0 / {}", ca.OP_ASSIGN: "{}"},
    **{ca.OP_SQRT: "sqrt({})", ca.OP_FABS: "fabs({})", ca.OP_FMIN: "fmin({}, {})", ca.OP_FMAX: "fmax({}, {})"},
    **{ca.OP_EXP: "exp({})", ca.OP_LOG: "log({})", ca.OP_POW: "pow({}, {})", ca.OP_CONSTPOW: "pow({}, {})"},
    **{ca.OP_SIN: "model_sin({})", ca.OP_COS: "model_cos({})"},
    **{ca.OP_LT: "{} < {}", ca.OP_LE: "{} <= {}", ca.OP_EQ: "{} == {}", ca.OP_NE: "{} != {}"},
    **{ca.OP_NOT: "!{}", ca.OP_AND: "{} && {}", ca.OP_OR: "{} || {}", ca.OP_IF_ELSE_ZERO: "{} != 0.0 ? {} : 0.0"},
}
_CIRCULAR = {ca.OP_SIN: "sin_of", ca.OP_COS: "cos_of"}
_CIRCLE = "  double sin_of[LANES], cos_of[LANES];\n  circle(x + AT_ANGLES, sin_of, cos_of);\n"


@attrs.frozen(eq=False)
class Routine:
    """A C function: its pointers by name, with their symbols or expressions.

    Inputs named ``data[k]`` are one argument, an array of pointers. ``circle`` computes the sines and cosines of all
    tubes' angles in a state ``x`` together.
    """

    name: str
    inputs: Mapping[str, Any]
    outputs: Mapping[str, Any]

    def source(self) -> str:
        """C text of the function."""
        outputs = [ca.densify(expression) for expression in self.outputs.values()]
        function = ca.Function(self.name, list(self.inputs.values()), outputs, {"cse": True})
        pointers = {name.split("[")[0]: "*const *" if "[" in name else "*restrict " for name in self.inputs}
        arguments = [f"const double {pointer}{name}" for name, pointer in pointers.items()]
        arguments += [f"double *restrict {name}" for name in self.outputs]
        return f"static void {self.name}({', '.join(arguments)}) {{\n{self._body(function)}}}\n\n"

    def _body(self, function: ca.Function) -> str:
        inputs, outputs = list(self.inputs), list(self.outputs)
        held: dict[int, tuple[str, int]] = {}  # registers that hold an entry of an input
        lines, together = [], False
        for k in range(function.n_instructions()):
            code, of, to = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
            if code == ca.OP_OUTPUT:
                lines.append(f"  {outputs[to[0]]}[{to[1]}] = a{of[0]};\n")
                continue
            if code == ca.OP_INPUT:
                held[to[0]] = inputs[of[0]], of[1]
                lines.append(f"  a{to[0]} = {inputs[of[0]]}[{of[1]}];\n")
                continue
            source = held.get(of[0], ("", 0)) if code in _CIRCULAR else ("", 0)
            if source[0] == "x":
                value, together = f"{_CIRCULAR[code]}[{source[1]} - AT_ANGLES]", True
            elif code == ca.OP_CONST:
                value = repr(float(function.instruction_constant(k)))
            else:
                value = _operation(code, self.name).format(*(f"a{i}" for i in of))
            held.pop(to[0], None)
            lines.append(f"  a{to[0]} = {value};\n")
        registers = ", ".join(f"a{i}" for i in range(function.sz_w()))
        return (_CIRCLE if together else "") + f"  double {registers};\n" + "".join(lines)


def _operation(code: int, name: str) -> str:
    if code in _OPERATIONS:
        return _OPERATIONS[code]
    known = {value: key for key, value in vars(ca).items() if key.startswith("OP_")}
    raise NotImplementedError(f"{name}: there is no C text for {known.get(code, code)}; add it to _OPERATIONS")


def product(name: str, matrix: ca.SX, inputs: Sequence[tuple[str, int]], output: str) -> str:
    """C text of ``output = matrix * inputs`` for ``width`` columns, ``matrix`` sparse, its nonzeros in ``a``."""
    rows, columns = matrix.sparsity().get_triplet()
    source = [(part, row) for part, size in inputs for row in range(size)]
    terms: list[list[str]] = [[] for _ in range(matrix.shape[0])]
    for k, (row, column) in enumerate(zip(rows, columns, strict=True)):
        part, of = source[column]
        terms[row].append(f"a[{k}] * {part}[{of} * width + k]")
    lines = [
        f"  for (int k = 0; k < width; k++) {output}[{row} * width + k] = {' + '.join(sums) or '0.0'};\n"
        for row, sums in enumerate(terms)
    ]
    arguments = "".join(f", const double *restrict {part}" for part, _ in inputs)
    head = f"INLINE void {name}(const double *restrict a{arguments}, double *restrict {output}, const int width) {{\n"
    return head + "".join(lines) + "}\n\n"


def array(kind: str, name: str, values: Iterable[Any]) -> str:
    """C text of a constant array."""
    numbers = [repr(value.item() if isinstance(value, np.generic) else value) for value in values]
    return f"static const {kind} {name}[] = {{{', '.join(numbers)}}};\n"


def enum(values: Mapping[str, int]) -> str:
    """C text of named integers."""
    return f"enum {{ {', '.join(f'{name} = {value}' for name, value in values.items())} }};\n"
