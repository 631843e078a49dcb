"""The C source of a compiled solver: generated routines, declarations from ``abi.py``, and headers."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from functools import cache
from importlib.resources import files

import casadi as ca

from ..layout.configuration import LARGEST_TURN, MOST_STEPS
from ..layout.ends import SAME_POINT
from ..mechanics.boundary import tip_rows
from ..mechanics.kind import Kind
from ..mechanics.law import Stiffness
from ..transcription.integrators import runge_kutta
from ..transcription.stability import MARGIN
from . import abi
from .equations import Equations
from .routines import array, enum

_NUMBERS = {"SAME_POINT": SAME_POINT, "LARGEST_TURN": LARGEST_TURN, "MOST_STEPS": float(MOST_STEPS), "MARGIN": MARGIN}
_HEADERS = (  # behind the generated text; trigonometry.h stands before it
    *("dense.h", "sweep.h", "layout.h", "pack.h", "shooting.h", "newton.h", "stability.h"),
    *("directions.h", "forcing.h", "actuators.h", "model.h", "sided.h", "sample.h", "driver.c"),
)
_INTEGRATORS = ("RK4", "RK8")  # coarse and fine
_TABLEAU = ("matrix", "weights", "nodes", "fifth", "third")
_WRITTEN_FROM = ("checks.py", "errors.py", "layout", "loads", "mechanics", "native", "robot", "transcription")


def library_source(tubes: int, kind: Kind) -> str:
    """The whole C source of the compiled solver for a number of tubes and a kind."""
    equations = Equations(tubes, kind)
    generated = [*(routine.source() for routine in equations.routines()), equations.products(), _tableaus()]
    generated += [abi.Sizes.of(tubes, kind).results(), abi.declarations()]
    headers = (_header(name, kind) for name in _HEADERS)
    return "\n".join((_constants(equations), _header("trigonometry.h", kind), *generated, *headers))


def _constants(equations: Equations) -> str:
    """C text of the numbers that the symbolic model determines."""
    sizes = {name: symbol.numel() for name, symbol in equations.data.items()}
    stages = {"MOST_STAGES": max(len(runge_kutta(name).nodes) for name in _INTEGRATORS)}
    text = "".join(f"static const double {name} = {value!r};\n" for name, value in _NUMBERS.items())
    text += f"#define LIVE {int(equations.kind.live)}\n"
    text += enum(equations.sizes() | stages) + array("int", "PART_SIZE", sizes.values())
    text += array("int", "STIFFNESS_LENGTHS", map(Stiffness.lengths, Stiffness.names()))
    text += array("int", "STIFFNESS_EVERYWHERE", (int(Stiffness.everywhere(name)) for name in Stiffness.names()))
    text += array("int", "PART_AT_NODES", (int(equations.at_nodes(name)) for name in sizes))
    return text + array("int", "TIP_ROWS", tip_rows(equations.tubes, equations.kind.live))


def _tableaus() -> str:
    text = ""
    for name in _INTEGRATORS:
        rk = runge_kutta(name)
        text += "".join(array("double", f"{name}_{part}", getattr(rk, part).ravel()) for part in _TABLEAU)
        parts = ", ".join(f"{name}_{part}" for part in _TABLEAU)
        text += f"static const Tableau {name} = {{{len(rk.nodes)}, {parts}}};\n"
    return text


def _header(name: str, kind: Kind) -> str:
    """The text of a header for a kind, without comments: these are not compiled."""
    text = re.sub(r"/\*.*?\*/|//[^\n]*", "", _read(name), flags=re.DOTALL)
    lines = _chosen(text, {flag.upper(): flag in kind.flags for flag in kind.known_flags()})
    return "".join(line for line in lines if line.strip())


def _read(name: str) -> str:
    return files("ctr_opt").joinpath("native", name).read_text(encoding="utf-8")


def _chosen(text: str, flags: dict[str, bool]) -> Iterator[str]:
    """The lines of C text for the given flags, without their ``#if FLAG``, ``#else`` and ``#endif``.

    The text of one kind is then independent of other kinds.
    """
    kept: list[bool | None] = []  # for each open #if: whether its lines are kept; None: not for a flag
    for line in text.splitlines(keepends=True):
        words = line.split()
        directive = words[0] if words else ""
        if directive.startswith("#if"):
            kept.append(flags.get(words[1]) if directive == "#if" else None)
            decided = kept[-1] is not None
        elif directive in ("#else", "#endif"):
            decided = kept[-1] is not None
            if directive == "#endif":
                kept.pop()
            elif decided:
                kept[-1] = not kept[-1]
        else:
            decided = False
        if not decided and False not in kept:
            yield line


@cache
def origin(tubes: int, kind: Kind) -> str:
    """Digest of everything that a library's source is written from; it changes with any edit."""
    digest = hashlib.sha256(f"{tubes} {kind.flags} {ca.CasadiMeta.version()}".encode())
    package = files("ctr_opt")
    for name in _WRITTEN_FROM:
        part = package.joinpath(name)
        for file in sorted(part.iterdir(), key=lambda entry: entry.name) if part.is_dir() else [part]:
            if file.name.endswith((".py", ".c", ".h")):
                digest.update(f"{name}/{file.name}".encode() + file.read_bytes())
    return digest.hexdigest()
