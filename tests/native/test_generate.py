"""The C text of compiled libraries: what it says, what it depends on, and what it does not."""

import ast
import ctypes
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import attrs
import casadi as ca
import numpy as np
import pytest

from ctr_opt.mechanics.kind import DEAD, Kind
from ctr_opt.native import generate
from ctr_opt.native.cache import DIRECTORY
from ctr_opt.native.compile import Source, compiler, load
from ctr_opt.native.generate import library_source
from ctr_opt.native.routines import Routine

PACKAGE = Path(generate.__file__).parents[1]


@attrs.frozen
class Sheared(Kind):
    """A kind with one more flag."""

    shear: bool = False


BLOCK = "#if SHEAR\nint sheared;\n#if defined(_WIN32)\nint there;\n#else\nint here;\n#endif\n#else\nint {};\n#endif\n"


def test_one_more_flag_leaves_the_source_of_others_as_it_is(monkeypatch):
    """Neither its field nor its lines in a header are seen, but for those in place of which it has its own."""
    read, bodies = generate._read, [Kind(), Kind(body=True)]
    with monkeypatch.context() as patch:
        patch.setattr(generate, "_read", lambda name: read(name) + "int plain;\n" * (name == "model.h"))
        before = [library_source(1, kind) for kind in bodies]
    patched = {"model.h": BLOCK.format("plain")}
    monkeypatch.setattr(generate, "_read", lambda name: read(name) + patched.get(name, ""))
    assert [library_source(1, Sheared(body=kind.body)) for kind in bodies] == before
    on = library_source(1, Sheared(shear=True))
    assert "int sheared;\n#if defined(_WIN32)\nint there;\n#else\nint here;\n#endif\n" in on
    assert "int plain;" not in on


def test_the_default_source_names_no_flag():
    text = library_source(1, DEAD)
    assert not [flag for flag in Kind.known_flags() if flag.upper() in text]
    assert "BODY" in library_source(1, Kind(body=True))


def test_flags_are_joined():
    both = Sheared(body=True).joined(Sheared(shear=True))
    assert both == Sheared(body=True, shear=True)
    assert both.flags == ("body", "shear")


X = ca.SX.sym("x", 3)
EXPRESSIONS = ca.vertcat(
    *(X[0] + X[1], X[0] - X[1], X[0] * X[1], X[0] / X[1], -X[0], X[0] ** 2, 2 * X[0], 1 / X[0], ca.sqrt(X[2])),
    *(ca.fabs(X[0]), ca.fmin(X[0], X[1]), ca.fmax(X[0], X[1]), ca.sin(X[0] * X[1]), ca.cos(X[0] * X[1])),
    *(ca.exp(X[0]), ca.log(X[2]), X[2] ** X[0], X[2] ** 2.5, X[0] < X[1], X[0] <= X[1], ca.eq(X[0], X[1])),
    *(ca.ne(X[0], X[1]), ca.logic_not(X[0] < X[1]), ca.logic_and(X[0] < 0, X[1] < 0), ca.logic_or(X[0] < 0, X[1] < 0)),
    *(ca.if_else(X[0] < X[1], X[2], 3 * X[2]), ca.sin(X[1]), ca.cos(X[2]), 1e-300, 12345678.9),
)


@pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
def test_every_operation_is_what_casadi_computes():
    """Both round each operation; the compiled sine and cosine are within 2 units in the last place (trigonometry.h)."""
    text = [
        "enum { LANES = 4, AT_ANGLES = 0 };\n#include <string.h>\n",
        generate._header("trigonometry.h", DEAD),
        Routine("every", {"x": X}, {"out": EXPRESSIONS}).source(),
        "EXPORT void call(const double *x, double *out) {\n  double padded[4] = {0};\n"
        "  memcpy(padded, x, sizeof(double) * 3);\n  every(padded, out);\n}\n",
    ]
    library = load("operations", "".join(text))
    function, out = ca.Function("f", [X], [EXPRESSIONS]), np.empty(EXPRESSIONS.numel())
    rng = np.random.default_rng(1)
    for _ in range(50):
        x = np.concatenate((rng.normal(size=2), rng.uniform(0.1, 2.0, 1)))
        library.call(ctypes.c_void_p(x.ctypes.data), ctypes.c_void_p(out.ctypes.data))
        np.testing.assert_allclose(out, function(x).full().ravel(), rtol=1e-15, atol=5e-16)


def test_an_operation_without_c_text_is_named():
    with pytest.raises(NotImplementedError, match=r"angle: there is no C text for OP_ATAN2"):
        Routine("angle", {"x": X}, {"out": ca.atan2(X[0], X[1])}).source()


def imported(module):
    """The modules of the package that a file imports, relative to it, functions' imports included."""
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.ImportFrom) or node.level == 0:
            continue
        folder = module.parents[node.level - 1].joinpath(*(node.module or "").split("."))
        for name in node.names:
            for path in (folder / f"{name.name}.py", folder.with_suffix(".py"), folder / "__init__.py"):
                if path.is_file():
                    yield path
                    break


def test_the_origin_covers_every_module_that_text_is_written_from():
    found, waiting = set(), [Path(generate.__file__)]
    while waiting:
        module = waiting.pop()
        if module not in found:
            found.add(module)
            waiting += imported(module)
    parts = {path.relative_to(PACKAGE).parts[0] for path in found}
    assert parts <= set(generate._WRITTEN_FROM)
    assert {"mechanics", "layout", "transcription", "native"} <= parts


BUILD = """
import sys
from ctr_opt.mechanics.kind import DEAD
from ctr_opt.native.library import library
print(library(1, DEAD).built().sizes.states)
"""


def built(package, environment):
    """A process with its own copy of the package that needs the library for one tube."""
    environment = environment | {"PYTHONPATH": str(package), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", BUILD], env=environment, cwd=package, capture_output=True, text=True, check=True
    )
    assert done.stdout == "14\n"


def replaced(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert text.count(old) >= 1
    path.write_text(text.replace(old, new), encoding="utf-8")


@pytest.mark.slow
@pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
def test_what_is_compiled_decides_what_is_compiled_again(tmp_path):
    """A docstring does not, a formula and a header do."""
    package, cache, compilers = tmp_path / "ctr_opt", tmp_path / "cache", tmp_path / "cc"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    compilers.write_text(f'#!/bin/sh\nexec {compiler().command[0]} "$@" -O0\n')
    compilers.chmod(0o700)
    environment = {**os.environ, DIRECTORY: str(cache), "CC": str(compilers)}

    def libraries():
        built(tmp_path, environment)
        return {path.stem: path.stat().st_ctime_ns for path in cache.glob("*.so")}

    (first,) = libraries().items()
    law = package / "mechanics" / "law.py"
    replaced(law, '"""The constitutive', '"""Once more the constitutive')
    replaced(package / "native" / "equations.py", "\n\n\n", "\n\n# a comment\n\n")
    assert libraries().keys() == {first[0]}
    assert len(list(cache.glob("*.note"))) == 2
    replaced(
        law, "preset + torque / stiffness.torsional_stiffness", "preset + 2 * torque / stiffness.torsional_stiffness"
    )
    assert len(libraries()) == 2
    replaced(package / "native" / "newton.h", "CONTRACTION = 0.5", "CONTRACTION = 0.4")
    assert len(libraries()) == 3
    assert len(list(cache.glob("*.note"))) == 4


def test_text_is_not_written_where_its_library_is_known(tmp_path, monkeypatch):
    """And where the library is lost it is written once, and compiled."""
    monkeypatch.setenv(DIRECTORY, str(tmp_path))
    written = []

    def write():
        written.append(1)
        return "int answer(void) { return 42; }\n"

    for k in range(3):
        monkeypatch.setattr("ctr_opt.native.compile._loaded", {})
        assert load("answer", Source(write, "of-an-answer")).answer() == 42
        assert len(written) == (1 if k < 2 else 2)
        if k == 1:
            next(tmp_path.glob("*.so")).unlink()


@pytest.mark.parametrize("damage", ["", "key of-another\nnote 0\n", "\xff"])
def test_a_note_that_is_none_is_written_again(tmp_path, monkeypatch, damage):
    monkeypatch.setenv(DIRECTORY, str(tmp_path))
    source = "int answer(void) { return 42; }\n"
    load("answer", Source(source, "of-an-answer"))
    (note,) = tmp_path.glob("*.note")
    whole = note.read_text()
    note.write_bytes(damage.encode("latin-1"))
    monkeypatch.setattr("ctr_opt.native.compile._loaded", {})
    assert load("answer", Source(source, "of-an-answer")).answer() == 42
    assert note.read_text() == whole
    assert re.fullmatch(r"key of-an-answer\nnote [0-9a-f]{64}\n", whole)


def test_comments_of_headers_are_left_out():
    """They are no part of what is compiled: another comment costs nobody a compilation."""
    text = generate._header("layout.h", DEAD)
    assert "/*" in generate._read("layout.h")
    assert "/*" not in text
    assert "lay_out" in text
