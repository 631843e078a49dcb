"""The symbolic model as C code: rates, their derivatives by parts, point loads, and what the C driver must know.

The derivative of a state's rate is applied in two sparse products, by way of the turn ``phi`` of the backbone frame and
the change of its curvature ``u_xy``: that takes a third of the operations of the plain Jacobian.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from functools import cache, cached_property
from importlib.resources import files
from typing import Any

import attrs
import casadi as ca
import numpy as np

from ..layout.columns import StepColumns
from ..layout.configuration import LARGEST_TURN, MOST_STEPS
from ..layout.ends import SAME_POINT
from ..mechanics import boundary, rod
from ..mechanics.fields import LoadKind
from ..mechanics.so3 import rotation_matrix, turn_of
from ..mechanics.state import State, slices
from ..transcription.integrals import integral_functions
from ..transcription.integrators import runge_kutta
from ..transcription.second_variation import second_variation_functions
from ..transcription.shooting import shooting_functions
from ..transcription.stability import MARGIN
from . import abi

_DRIVER = (
    "trigonometry.h",
    "dense.h",
    "sweep.h",
    "layout.h",
    "pack.h",
    "shooting.h",
    "newton.h",
    "stability.h",
    "directions.h",
    "forcing.h",
    "actuators.h",
    "model.h",
    "driver.c",
)


@attrs.frozen(eq=False)
class _Routine:
    """A C function: pointers by name and the symbols or expressions they stand for."""

    name: str
    inputs: dict[str, Any]
    outputs: dict[str, Any]

    def function(self) -> ca.Function:
        """The same for CasADi."""
        outputs = [ca.densify(expression) for expression in self.outputs.values()]
        return ca.Function(self.name, list(self.inputs.values()), outputs, {"cse": True})

    def source(self, body: str) -> str:
        """C text from the body that CasADi's code generator writes."""
        for i, name in enumerate(self.inputs):
            body = re.sub(rf"arg\[{i}\]\? arg\[{i}\]\[(\d+)\] : 0", rf"{name}[\1]", body)
        for i, name in enumerate(self.outputs):
            body = re.sub(rf"if \(res\[{i}\]!=0\) res\[{i}\]", name, body)
        body = _trigonometry(body)
        if "arg[" in body or "res[" in body:
            raise NotImplementedError(f"the generated code of {self.name} has an unknown form")
        pointers = {
            name.split("[")[0]: "const double *const *" if "[" in name else "const double *restrict "
            for name in self.inputs
        }
        arguments = [f"{kind}{name}" for name, kind in pointers.items()]
        arguments += [f"double *restrict {name}" for name in self.outputs]
        return f"static void {self.name}({', '.join(arguments)}) {{\n{body}\n}}\n"


def _trigonometry(body: str) -> str:
    """Sines and cosines of the tubes' angles, all of them together; others one by one."""
    held: dict[str, str] = {}
    lines = []
    for line in body.splitlines():
        assigned = re.fullmatch(r"  (a\d+)=(.*);", line)
        if assigned:
            name, value = assigned.groups()
            circular = re.fullmatch(r"(sin|cos)\((a\d+)\)", value)
            if circular:
                of, argument = circular.groups()
                known = re.fullmatch(r"x\[(\d+)\]", held.get(argument, ""))
                value = f"{of}_of[{known[1]} - AT_ANGLES]" if known else f"model_{of}({argument})"
                line = f"  {name}={value};"
            held[name] = value
        lines.append(line)
    text = "\n".join(lines)
    if "_of[" in text:
        text = "  double sin_of[LANES], cos_of[LANES];\n  circle(x + AT_ANGLES, sin_of, cos_of);\n" + text
    return text


def _bodies(routines: Sequence[_Routine]) -> tuple[str, list[str]]:
    """What CasADi's generator writes: auxiliary functions, and the body of each routine."""
    generator = ca.CodeGenerator("model.c", {"with_header": False})
    for routine in routines:
        generator.add(routine.function())
    text = generator.dump()
    auxiliary = re.findall(r"^casadi_real casadi_\w+\([^;{]*\) *\{.*?\}$", text, re.MULTILINE | re.DOTALL)
    bodies = re.findall(r"^static int casadi_f\d+\([^{]*\{\n(.*?)\n  return 0;\n\}", text, re.MULTILINE | re.DOTALL)
    if len(bodies) != len(routines):
        raise NotImplementedError("the code that CasADi generates has an unknown form")
    return "\n".join(f"INLINE {each}" for each in auxiliary), bodies


def _apply(name: str, matrix: ca.SX, inputs: Sequence[tuple[str, int]], output: str) -> str:
    """C text of ``output = matrix * inputs`` for ``width`` columns, ``matrix`` sparse, its nonzeros in ``a``."""
    rows, columns = matrix.sparsity().get_triplet()
    source = [(part, row) for part, size in inputs for row in range(size)]
    lines = []
    for row in range(matrix.shape[0]):
        terms = []
        for k, (r, c) in enumerate(zip(rows, columns, strict=True)):
            if r == row:
                part, of = source[c]
                terms.append(f"a[{k}] * {part}[{of} * width + k]")
        lines.append(f"  for (int k = 0; k < width; k++) {output}[{row} * width + k] = {' + '.join(terms) or '0.0'};")
    arguments = "".join(f", const double *restrict {part}" for part, _ in inputs)
    return (
        f"INLINE void {name}(const double *restrict a{arguments}, double *restrict {output}, const int width) {{\n"
        + "\n".join(lines)
        + "\n}\n"
    )


class _Model:
    """The symbols of one place along the robot, and the routines made of them."""

    def __init__(self, tubes: int, kind: LoadKind) -> None:
        self.tubes, self.kind = tubes, kind
        self.layout = StepColumns(tubes, 1, kind)
        self.functions = shooting_functions(tubes, "RK8", kind)
        self.x = ca.SX.sym("x", State.size(tubes))
        self.state = State.split(self.x, tubes)
        self.turn, self.bent = ca.SX.sym("phi", 3), ca.SX.sym("u", 2)
        self.frame = ca.SX.sym("R", 3, 3)
        self.turned_frame = self.frame @ (ca.SX.eye(3) + ca.skew(self.turn))
        parts = {name: part.stop - part.start for name, part in self.layout.parts.items() if name != "length"}
        self.data = {name: ca.SX.sym(name, size) for name, size in parts.items() if not name.startswith("point_")}
        self.point = ca.SX.sym("point", sum(size for name, size in parts.items() if name.startswith("point_")))
        self.column = ca.vertcat(0, *self.data.values(), self.point)
        self.local = self.layout.local(self.column, 0, self.state)

    def routines(self) -> list[_Routine]:
        """Rates, their derivatives, and the effect of a point load."""
        own = [self._rates(), self._slopes(), self._behind(), self._behind_slopes(), self._attitude()]
        own += [self._free(own[0]), self._free(own[1]), self._slopes_by_data("slopes_by_data", self._by_everything)]
        own += [self._free(self._slopes_by_data("slopes_by_data", self._by_tubes)), self._hamiltonian()]
        return own if self.kind.live else [*own, *self._second_variation()]

    def products(self) -> str:
        """The sparse products that belong to the derivatives."""
        size = State.size(self.tubes)
        tubes, everything = (sum(self.data[name].numel() for name in names) for names in (_TUBES, self.data))
        by_parts, by_tubes = self._by_tubes
        parts = [("along", size), ("part", 5)]
        return "".join(
            (
                _apply("apply_by_parts_and_data", by_parts, [("along", size), ("change", tubes)], "part"),
                _apply("apply_slopes_and_tubes", by_tubes, [*parts, ("change", tubes)], "out"),
                _apply("apply_slopes_and_data", self._by_everything[1], [*parts, ("change", everything)], "out"),
                _apply("apply_by_parts", self._by_parts, [("along", size)], "part"),
                _apply("apply_slopes", self._outer, [("along", size), ("part", 5)], "out"),
                _apply("apply_turn", self._turn_rows, [("along", size)], "part"),
                _apply("apply_behind", self._behind_outer, [("along", size), ("part", 3)], "out"),
            )
        )

    def _inputs(self) -> dict[str, Any]:
        return {"x": self.x} | {f"data[{i}]": symbol for i, symbol in enumerate(self.data.values())}

    @cached_property
    def _rate(self) -> ca.SX:
        rate: ca.SX = rod.rates(self.state, self.local).joined()
        return rate

    def _rates(self) -> _Routine:
        return _Routine("rates", self._inputs(), {"rate": self._rate})

    def _slopes(self) -> _Routine:
        outputs = {"rate": self._rate}
        outputs |= {"inner": _nonzeros(self._by_parts), "outer": _nonzeros(self._outer)}
        return _Routine("slopes", self._inputs(), outputs)

    def _free(self, routine: _Routine) -> _Routine:
        """The same where no load acts along the step."""
        loads = [self.data[name] for name in self.data if name not in _TUBES]
        zeros = [ca.SX.zeros(*load.shape) for load in loads]
        values = ca.substitute(list(routine.outputs.values()), loads, zeros)
        outputs = dict(zip(routine.outputs, values, strict=True))
        return _Routine(f"free_{routine.name}", routine.inputs, outputs)

    @cached_property
    def _turn_rows(self) -> ca.SX:
        rows = ca.SX(3, State.size(self.tubes))
        rows[:, State.parts(self.tubes)["orientation"]] = turn_of(self.state.orientation)
        return rows

    @cached_property
    def _by_parts(self) -> ca.SX:
        """``(phi, du)`` of a change of the state."""
        bent, _ = rod.curvature(self.state, self.local)
        return ca.vertcat(self._turn_rows, ca.jacobian(bent, self.x))

    @cached_property
    def _outer(self) -> ca.SX:
        """Change of the rate with the state itself, ``phi`` and ``u``."""
        rate = rod.rates_at(self.state, self.local, self.turned_frame, self.bent).joined()
        bent, _ = rod.curvature(self.state, self.local)
        matrix = ca.jacobian(rate, ca.vertcat(self.x, self.turn, self.bent))
        return self._there(ca.substitute(matrix, self.bent, bent))

    def _there(self, matrix: ca.SX) -> ca.SX:
        """A derivative by parts at the state itself."""
        frame = rotation_matrix(self.state.orientation)
        symbols = ca.vertcat(self.turn, ca.vec(self.frame))
        return ca.sparsify(ca.substitute(matrix, symbols, ca.vertcat(ca.SX.zeros(3), ca.vec(frame))))

    def _by_data(self, names: Sequence[str]) -> tuple[ca.SX, ca.SX]:
        """``_by_parts`` and ``_outer`` with columns behind them for changes of the data themselves."""
        data = ca.vertcat(*(self.data[name] for name in names))
        bent, _ = rod.curvature(self.state, self.local)
        rate = rod.rates_at(self.state, self.local, self.turned_frame, self.bent).joined()
        turned = ca.vertcat(ca.SX(3, data.numel()), ca.jacobian(bent, data))
        direct = self._there(ca.substitute(ca.jacobian(rate, data), self.bent, bent))
        return ca.horzcat(self._by_parts, turned), ca.horzcat(self._outer, direct)

    @cached_property
    def _by_tubes(self) -> tuple[ca.SX, ca.SX]:
        return self._by_data(_TUBES)

    @cached_property
    def _by_everything(self) -> tuple[ca.SX, ca.SX]:
        """The columns of the loads come last: without them, the first nonzeros are those of ``_by_tubes``."""
        return self._by_data(list(self.data))

    def _slopes_by_data(self, name: str, matrices: tuple[ca.SX, ca.SX]) -> _Routine:
        outputs = {"rate": self._rate, "inner": _nonzeros(self._by_tubes[0]), "outer": _nonzeros(matrices[1])}
        return _Routine(name, self._inputs(), outputs)

    def _behind(self) -> _Routine:
        load = self.layout.point_load(self.column, self.state)
        return _Routine("behind", {"x": self.x, "point": self.point}, {"y": boundary.jump(self.state, *load).joined()})

    @cached_property
    def _behind_outer(self) -> ca.SX:
        load = self.layout.point_load(self.column, self.state)
        after = boundary.jump_at(self.state, *load, self.turned_frame).joined()
        return self._there(ca.jacobian(after, ca.vertcat(self.x, self.turn)))

    def _behind_slopes(self) -> _Routine:
        outputs = {"inner": _nonzeros(self._turn_rows), "outer": _nonzeros(self._behind_outer)}
        return _Routine("behind_slopes", {"x": self.x, "point": self.point}, outputs)

    def _attitude(self) -> _Routine:
        """The backbone frame, row by row, and what makes a turn of a change of the state."""
        frame = rotation_matrix(self.state.orientation).T
        return _Routine("attitude", {"x": self.x}, {"frame": frame, "inner": _nonzeros(self._turn_rows)})

    def _hamiltonian(self) -> _Routine:
        """The Hamiltonian and its derivatives by state and data."""
        value = integral_functions(self.tubes, "RK8", self.kind).hamiltonian(self.x, self.column)
        outputs = {"value": value, "by_state": ca.gradient(value, self.x)}
        outputs["by_data"] = ca.gradient(value, ca.vertcat(*self.data.values()))
        return _Routine("hamiltonian", self._inputs(), outputs)

    def _second_variation(self) -> list[_Routine]:
        """The parts of the count of negative directions; directions stand row by row, other matrices by columns."""
        functions = second_variation_functions(self.tubes, "RK8", self.kind)
        count, lanes = 2 * functions.size, _lanes(2 * functions.size)
        rows = functions.directions(self.x)[:, 1:].T
        along = ca.SX.sym("along", lanes, State.size(self.tubes))
        column = ca.SX.sym("column", self.functions.columns.size)
        transfer, _, flexibility, doubtful, defect = functions.told(ca.horzcat(self.x, along[:count, :].T), column)
        told = {"transfer": transfer, "flexibility": flexibility, "doubtful": doubtful, "defect": defect}
        n = functions.size
        w, t, f = ca.SX.sym("W", n, n), ca.SX.sym("T", 2 * n, 2 * n), ca.SX.sym("flexibility", n)
        shift, compliance = ca.SX.sym("shift"), ca.SX.sym("compliance", self.tubes)
        before, negative, lost = functions.eliminate(w, t, ca.SX(0, 0), f, shift)
        inputs = {"W": w, "transfer": t, "flexibility": f, "shift": shift}
        at_entry = functions.entry(w, compliance, shift)
        return [
            _Routine(
                "directions", {"x": self.x}, {"along": ca.vertcat(rows, ca.SX.zeros(lanes - count, rows.shape[1]))}
            ),
            _Routine("told", {"x": self.x, "along": along, "column": column}, told),
            _Routine("eliminate", inputs, {"before": before, "negative": negative, "lost": lost}),
            _Routine("entry", {"W": w, "compliance": compliance, "shift": shift}, {"negative": at_entry}),
        ]

    def constants(self) -> str:
        """Sizes, the parts of a column, and where the parts of a state begin."""
        tubes, layout = self.tubes, self.layout
        nodal = {name: int(name not in _SHARED) for name in self.data}
        sizes = {name: symbol.numel() for name, symbol in self.data.items()}
        names = {
            "TUBES": tubes,
            "NX": State.size(tubes),
            "NZ": len(boundary.tip_rows(tubes, self.kind.live)),
            "PARTS": len(sizes),
            "SHARED": sum(size for name, size in sizes.items() if not nodal[name]),
            "AT_NODES": sum(size for name, size in sizes.items() if nodal[name]),
            "POINT": self.point.numel(),
            "INNER": self._by_parts.nnz(),
            "OUTER": self._outer.nnz(),
            "INNER_BY_DATA": self._by_tubes[0].nnz(),
            "OUTER_BY_TUBES": self._by_tubes[1].nnz(),
            "OUTER_BY_DATA": self._by_everything[1].nnz(),
            "BEHIND_INNER": self._turn_rows.nnz(),
            "BEHIND_OUTER": self._behind_outer.nnz(),
            "LANES": _lanes(tubes),
            "MOST_UNKNOWNS": State.size(tubes),
            "MOST_STAGES": max(len(runge_kutta(name).nodes) for name in _INTEGRATORS),
        }
        names |= {f"AT_{name.upper()}": part.start for name, part in State.parts(tubes).items()}
        names |= {f"PART_{name.upper()}": k for k, name in enumerate(sizes)}
        names |= {f"DATA_{name.upper()}": part.start for name, part in slices(sizes).items()}
        names["DATA"] = sum(sizes.values())
        assert layout.size == 1 + names["SHARED"] + names["AT_NODES"] + names["POINT"]
        text = "".join(f"static const double {name} = {value!r};\n" for name, value in _NUMBERS.items())
        text += f"#define BODY {int(self.kind.body)}\n#define LIVE {int(self.kind.live)}\n"
        text += f"enum {{ {', '.join(f'{name} = {value}' for name, value in names.items())} }};\n"
        text += _array("int", "PART_SIZE", sizes.values()) + _array("int", "PART_AT_NODES", nodal.values())
        return text + _array("int", "TIP_ROWS", boundary.tip_rows(tubes, self.kind.live))


_CIRCLE = """/* Sines and cosines of the tubes' angles; the lanes to spare take what stands behind them in the state. */
INLINE void circle(const double *restrict angles, double *restrict sines, double *restrict cosines) {
  for (int i = 0; i < LANES; i++) {
    sines[i] = model_sin(angles[i]);
    cosines[i] = model_cos(angles[i]);
  }
}
"""


_NUMBERS = {
    "SAME_POINT": SAME_POINT,
    "LARGEST_TURN": LARGEST_TURN,
    "MOST_STEPS": float(MOST_STEPS),
    "MARGIN": MARGIN,
}
_TUBES = ("bending_stiffness", "torsional_stiffness", "precurvature")
_SHARED = ("bending_stiffness", "torsional_stiffness", "unit")  # by all nodes of a step


def _lanes(count: int) -> int:
    """The next multiple of what processors take side by side."""
    return 4 * ((count + 3) // 4)


def _nonzeros(matrix: ca.SX) -> Any:
    return ca.densify(matrix.nz[:])


def _array(kind: str, name: str, values: Any) -> str:
    numbers = [repr(value.item() if isinstance(value, np.generic) else value) for value in values]
    return f"static const {kind} {name}[] = {{{', '.join(numbers)}}};\n"


_INTEGRATORS = ("RK4", "RK8")  # coarse and fine
_TABLEAU = ("matrix", "weights", "nodes", "fifth", "third")


def _tableaus() -> str:
    text = ""
    for name in _INTEGRATORS:
        rk = runge_kutta(name)
        for part in _TABLEAU:
            text += _array("double", f"{name}_{part}", getattr(rk, part).ravel())
        text += (
            f"static const Tableau {name} = {{{len(rk.nodes)}, {', '.join(f'{name}_{part}' for part in _TABLEAU)}}};\n"
        )
    return text


def library_source(tubes: int, kind: LoadKind) -> str:
    """The whole C source of the compiled solver for a number of tubes and a kind of loads."""
    model = _Model(tubes, kind)
    routines = model.routines()
    auxiliary, bodies = _bodies(routines)
    native = files("ctr_opt").joinpath("native")
    parts = {name: native.joinpath(name).read_text(encoding="utf-8") for name in _DRIVER}
    generated = [model.constants(), _CIRCLE, auxiliary]
    generated += [routine.source(body) for routine, body in zip(routines, bodies, strict=True)]
    generated += [model.products(), _tableaus(), abi.Sizes.of(tubes, kind).results(), abi.declarations()]
    head = parts.pop("trigonometry.h")
    return "\n".join((head, *generated, *parts.values()))


@cache
def content(tubes: int, kind: LoadKind) -> str:
    """What tells one library's source from another's, without writing it: the code it is made by."""
    digest = hashlib.sha256(f"{tubes} {kind} {ca.CasadiMeta.version()}".encode())
    package = files("ctr_opt")
    for folder in ("mechanics", "transcription", "native"):
        for file in sorted(package.joinpath(folder).iterdir(), key=lambda entry: entry.name):
            if file.name.endswith((".py", ".c", ".h")):
                digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()
