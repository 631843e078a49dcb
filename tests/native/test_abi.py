"""The table that Python and C share: what differs is seen when C is compiled or when a library is loaded."""

import ctypes
import subprocess

import attrs
import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.errors import CompilationError
from ctr_opt.mechanics.kind import DEAD
from ctr_opt.native import abi, calls
from ctr_opt.native.compiler import FLAGS, compiler
from ctr_opt.native.generate import library_source
from ctr_opt.native.library import library
from tests.support.physics import held, rod

needs_compiler = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")


def complaints(text, tmp_path):
    """What the compiler says of C text, which it does not translate."""
    code = tmp_path / "code.c"
    code.write_text(text)
    command = [*compiler().command, *FLAGS, "-Wall", "-fsyntax-only", str(code)]
    return subprocess.run(command, capture_output=True, text=True, check=False).stderr


@needs_compiler
def test_the_source_compiles_without_a_warning(tmp_path):
    said = complaints(library_source(2, DEAD), tmp_path)
    assert [line for line in said.splitlines() if "warning" in line and "unused" not in line] == []


@needs_compiler
@pytest.mark.parametrize("change", ["prototype", "field"])
def test_a_definition_in_c_that_differs_does_not_compile(monkeypatch, tmp_path, change):
    if change == "prototype":
        monkeypatch.setitem(abi.FUNCTIONS, "warm", abi.FUNCTIONS["warm"] + ", int more")
    else:
        other = abi._struct("Goal", tolerance=ctypes.c_double)
        monkeypatch.setattr(abi, "_STRUCTS", [other if each is abi.Goal else each for each in abi._STRUCTS])
    said = complaints(library_source(1, DEAD), tmp_path)
    assert ("conflicting types" if change == "prototype" else "no member named") in said


@needs_compiler
@pytest.mark.parametrize("name", ["states", "unknowns"])
def test_a_library_of_other_sizes_is_refused(monkeypatch, name):
    native = library(1, DEAD).built()
    other = attrs.evolve(native.sizes, **{name: getattr(native.sizes, name) + 1})
    monkeypatch.setattr(abi.Sizes, "of", lambda *_: other)
    with pytest.raises(CompilationError, match="other structures"):
        calls.Native(native.library, 1, DEAD)


def test_rows_of_numbers_are_the_structures():
    """NumPy reads the layout of a structure by itself."""
    for struct in (abi.PointLoad, abi.SpanLoad):
        row = np.arange(ctypes.sizeof(struct) / 8)
        seen = row.view(np.dtype(struct))[0]
        for name, part in abi.columns(struct).items():
            np.testing.assert_array_equal(np.ravel(seen[name]), row[part])


@needs_compiler
def test_a_result_is_as_long_as_the_solver_says():
    problem = ctr.ForwardProblem(rod(), compiled=True)
    numbers, sizes = problem.solve(held()).record.numbers, abi.Sizes.of(1, DEAD)
    assert sizes.at("size", int(numbers[abi.Head.STEPS])) == numbers[abi.Head.NEEDED]
    assert sizes.states == 14
    assert sizes.unknowns == 3
