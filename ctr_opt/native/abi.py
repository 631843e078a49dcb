"""The interface of Python and the compiled solver, stated once: structures, enumerations, functions, results.

Python calls with the declarations below; :func:`declarations` and :meth:`Sizes.results` write the C text from them. A
definition in ``driver.c`` that differs from its prototype here does not compile. The sizes of all structures are
compared when a library is loaded.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from enum import IntEnum
from functools import cache, cached_property
from itertools import accumulate
from typing import Any

import attrs
import numpy as np

from ..mechanics.boundary import tip_rows
from ..mechanics.kind import Kind
from ..mechanics.state import State, slices
from .routines import enum

_INT, _DOUBLE, _ROOM = ctypes.c_int, ctypes.c_double, ctypes.c_void_p
_INTS, _DOUBLES, _VECTOR = ctypes.POINTER(_INT), ctypes.POINTER(_DOUBLE), _DOUBLE * 3


def _struct(name: str, **fields: Any) -> Any:
    """A structure of C and of Python."""
    return type(name, (ctypes.Structure,), {"_fields_": list(fields.items())})


# -- inputs of the solver, SI ------------------------------------------------------------------------------------------

Robot = _struct(
    "Robot",
    stiffness=_DOUBLES,  # STIFFNESSES of each tube, in the order of mechanics/law.py
    pieces=_INTS,  # TUBES + 1: where each tube's pieces of precurvature begin
    degree=_INT,
    breaks=_DOUBLES,  # arc lengths of the pieces' ends from the tube's base; tube i's from pieces[i] + i
    coefficients=_DOUBLES,  # (degree + 1) x 3 of each piece, powers of the length from its beginning
    position=_DOUBLES,  # of the entry point
    orientation=_DOUBLES,  # of the entry point, a quaternion
)
# An arc length of NaN moves with the tube's end. Frame zero is the world's, any other the tube's. A point load of zeros
# breaks no step: it only marks a place.
PointLoad = _struct("PointLoad", s=_DOUBLE, tube=_DOUBLE, frame=_DOUBLE, force=_VECTOR, moment=_VECTOR)
SpanLoad = _struct("SpanLoad", ends=_DOUBLE * 2, tube=_DOUBLE, frame=_DOUBLE, force=_VECTOR, moment=_VECTOR)
Loads = _struct("Loads", points=_INT, spans=_INT, point=ctypes.POINTER(PointLoad), span=ctypes.POINTER(SpanLoad))
Goal = _struct("Goal", error=_DOUBLE, residual=_DOUBLE)  # of positions over the length; of scaled tip conditions


class By(IntEnum):
    """Kinds of directions of change, and the meaning of their index and component."""

    STIFFNESS = 0  # of a tube; the component is the number of the stiffness
    ROTATION = 1  # of a tube
    TRANSLATION = 2  # of a tube
    POSITION = 3  # of the entry point, along an axis of the world
    TURN = 4  # of the entry point, about its own axis
    FORCE = 5  # of a point load, a component as it stands there
    MOMENT = 6
    PLACE = 7  # the arc length of a point load that has one
    SPAN_FORCE = 8  # of a load per length
    SPAN_MOMENT = 9
    PRECURVATURE = 10  # a table like the robot's coefficients; the component is the tube it is for


Direction = _struct("Direction", kind=_INT, index=_INT, component=_INT)
Probe = _struct("Probe", point=_INT, tube=_INT)  # where a point load is, seen in the frame of a tube; -1: the innermost
# The same number of directions and probes for each experiment, in succession; tables: changes of coefficients.
_LISTS = {"directions": ctypes.POINTER(Direction), "tables": _DOUBLES, "probes": ctypes.POINTER(Probe)}
Asked = _struct("Asked", **_LISTS, count=_INT, probe_count=_INT)

# -- its answers -------------------------------------------------------------------------------------------------------

ANSWER: Mapping[str, tuple[Any, ...]] = {
    "residual": ("unknowns",),
    "slopes": ("unknowns", "columns"),
    "poses": ("probes", 3, 4),
    "rates": ("probes", 6, "columns"),
    "curvatures": ("probes", 3),
    "curvature_rates": ("probes", 3, "columns"),
    "forces": ("tubes",),
    "force_rates": ("tubes", "columns"),
    "wrench": (6,),
    "wrench_rates": (6, "columns"),
}
"""Shapes of the model's answers for an experiment, SI, by name; ``columns``: unknowns, then directions."""

Answer = _struct("Answer", **dict.fromkeys(ANSWER, _ROOM))  # of successive experiments; NULL: not wanted


class Failure(IntEnum):
    """Why a function gave up; it returns 0 otherwise."""

    REFUSED = 1
    NO_MEMORY = 2
    TOO_SMALL = 3  # the memory for the result: it needs Head.NEEDED
    DIVERGED = 10
    SINGULAR = 11
    PERHAPS_ANOTHER_BRANCH = 12
    INACCURATE = 13
    PATH_ENDED = 14


class Head:
    """Positions of the numbers at the beginning of a result."""

    ITERATIONS, RESIDUAL, STEPS, LENGTH, REFINEMENTS, NEEDED, COLD = range(7)
    ERROR = 7  # of positions over the length; negative if only an upper bound is known
    FAR = 8  # the start was so far away that Broyden's method failed or was slow
    STEPS_OF_PATH = 9  # of a continuation from another equilibrium; 0: none was needed
    REACHED = 10  # how far a continuation got that ended


_HEAD = 16  # numbers in front of a result's blocks
_STRUCTS = (Robot, PointLoad, SpanLoad, Loads, Goal, Direction, Probe, Asked, Answer)
_ENUMS = {"BY_": By.__members__, "": Failure.__members__, "R_": {k: v for k, v in vars(Head).items() if k.isupper()}}
_CASE = "const Robot *robot, const Loads *loads, const double *actuation"
_CASES = "const Robot *robot, const Loads *const *loads, const double *actuations"
FUNCTIONS = {
    "warm": f"{_CASE}, const double *start, const Goal *goal, double *result, long capacity",
    "travel": "const Robot *robot, const Loads *from_loads, const double *from, const Loads *loads, "
    "const double *actuation, const double *start, const Goal *goal, double *result, long capacity",
    "cold": f"{_CASE}, const Goal *goal, double *result, long capacity",
    "many": f"{_CASES}, int count, const double *first, int chained, const Goal *goal, double *results, long size, "
    "int *failed",
    "derive": f"{_CASE}, const double *z, int refinements, int side, double s, int frame, double load_at, int tube, "
    "double *jacobian, double *compliance, double *unknowns, int *coincide",
    "sample": f"{_CASE}, const double *result, int count, const double *s, const int *left, double *values",
    "push": f"{_CASE}, const double *z, int refinements, int tube, int side, double *force",
    "models": f"{_CASES}, const double *z, int count, int refinements, int side, const Asked *asked, "
    "const Answer *answers, int *failed",
    "stability": f"{_CASE}, const double *result, double *margin",
    "inspect": f"{_CASE}, const double *result, double *out",
    "integrate": f"{_CASE}, const double *z, int repeats, int derivative, double *tip",
}
"""The exported functions, with their arguments in C."""


@attrs.frozen
class Sizes:
    """Sizes of states and results of a library, ``NX`` and ``NZ`` in C."""

    tubes: int
    states: int
    unknowns: int

    @classmethod
    def of(cls, tubes: int, kind: Kind) -> Sizes:
        """The sizes for a number of tubes and a kind."""
        return cls(tubes, State.size(tubes), len(tip_rows(tubes, kind.live)))

    @cached_property
    def start(self) -> dict[str, slice]:
        """Parts of the block that a solve may start from: unknowns, RK4 Jacobian and conditions, units, rotations."""
        k = self.unknowns
        return slices({"unknowns": k, "jacobian": k * k, "conditions": k, "units": 2, "rotations": self.tubes})

    @cached_property
    def _blocks(self) -> dict[str, tuple[int, int]]:
        """Beginnings ``a + b steps`` of the blocks of a result; states are behind and before the loads at nodes."""
        start, n = self.start["rotations"].stop, self.states
        sizes = {"head": (_HEAD, 0), "start": (start, 0), "mesh": (0, 2), "right": (n, n), "left": (0, n)}
        ends = accumulate(sizes.values(), lambda a, b: (a[0] + b[0], a[1] + b[1]), initial=(0, 0))
        return dict(zip((*sizes, "size"), ends, strict=True))

    @cached_property
    def place(self) -> dict[str, slice]:
        """Parts of the values at a place: state, curvatures, tubes' moments, density of elastic energy."""
        n = self.tubes
        return slices({"state": self.states, "bent": 2, "twisted": n, "moments": 3 * n, "energy": 1})

    def at(self, block: str, steps: int) -> int:
        """The beginning of a block in a result with this number of steps; ``"size"``: the end of the result."""
        fixed, step = self._blocks[block]
        return fixed + step * steps

    def results(self) -> str:
        """C text of the beginnings of the blocks of results, and of the parts of ``start``."""
        parts = {f"START_{name.upper()}": part.start for name, part in self.start.items()}
        parts |= {f"PLACE_{name.upper()}": part.start for name, part in self.place.items()}
        parts |= {"PLACE_SIZE": self.place["energy"].stop, "START_SIZE": self.start["rotations"].stop}
        rows = [f"#define RESULT_{name.upper()}(n) ({a} + {b} * (n))\n" for name, (a, b) in self._blocks.items()]
        return "".join(rows) + enum(parts)

    @property
    def expected(self) -> list[int]:
        """The numbers that the library's ``sizes`` must write."""
        return [self.states, self.unknowns, self.at("size", 1), *map(ctypes.sizeof, _STRUCTS)]


@cache
def _offsets(struct: Any) -> dict[str, int]:
    """Where the fields of a structure begin."""
    return {name: getattr(struct, name).offset for name, *_ in struct._fields_}


class Structure:
    """A structure at an ``address``; arrays among its ``values`` become its pointers."""

    def __init__(self, struct: Any, **values: Any) -> None:
        self.values = values
        self._struct = struct()
        self.address = ctypes.addressof(self._struct)
        offsets = _offsets(struct)
        for name, x in values.items():
            if isinstance(x, np.ndarray):  # an address, as typed pointers are slow to create
                _ROOM.from_address(self.address + offsets[name]).value = x.__array_interface__["data"][0]
            else:
                setattr(self._struct, name, x)


def columns(struct: Any) -> dict[str, slice]:
    """The slices of the fields of a structure of doubles in a row of numbers."""
    return slices({name: ctypes.sizeof(kind) // ctypes.sizeof(_DOUBLE) for name, kind in struct._fields_})


def arguments(function: str) -> list[Any]:
    """The ``ctypes`` of a function's arguments: every pointer is an address."""
    numbers = {"int": _INT, "long": ctypes.c_long, "double": _DOUBLE}
    return [_ROOM if "*" in argument else numbers[argument.split()[0]] for argument in FUNCTIONS[function].split(", ")]


def declarations() -> str:
    """C text of the structures, enumerations and prototypes."""
    text = "".join(_declared_struct(struct) for struct in _STRUCTS)
    text += "".join(enum({prefix + name: int(k) for name, k in table.items()}) for prefix, table in _ENUMS.items())
    text += enum({"DIRECTIONS": len(By)}) + "".join(f"EXPORT int {n}({given});\n" for n, given in FUNCTIONS.items())
    values = ["NX", "NZ", "RESULT_SIZE(1)", *(f"sizeof({struct.__name__})" for struct in _STRUCTS)]
    text += f"EXPORT void sizes(int *out) {{\n  const int values[] = {{{', '.join(values)}}};\n"
    return text + "  memcpy(out, values, sizeof values);\n}\n" + _answer_of()


def _declared_struct(struct: Any) -> str:
    fields = "".join(f"  {_declared(kind, name)};\n" for name, kind in struct._fields_)
    return f"typedef struct {{\n{fields}}} {struct.__name__};\n"


def _declared(kind: Any, name: str) -> str:
    """A C declaration."""
    if kind is _ROOM:
        return f"double *{name}"
    if issubclass(kind, ctypes.Array):
        return _declared(kind._type_, f"{name}[{kind._length_}]")
    if hasattr(kind, "contents"):
        return f"const {_declared(kind._type_, f'*{name}')}"
    return f"{ {_INT: 'int', _DOUBLE: 'double'}.get(kind, kind.__name__) } {name}"


def _answer_of() -> str:
    """C text of a function that locates the k-th experiment's answer."""
    sizes = {name: " * ".join(map(str, shape)) for name, shape in ANSWER.items()}
    rows = [f"    all->{name} ? all->{name} + k * {size} : NULL,\n" for name, size in sizes.items()]
    head = "static Answer answer_of(const Answer *all, size_t k, size_t columns, size_t probes) {\n"
    return head + "  const size_t unknowns = NZ, tubes = TUBES;\n  return (Answer){\n" + "".join(rows) + "  };\n}\n"
