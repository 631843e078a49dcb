"""When compiled code is built and used: on request, from the disk, in the background, or not at all."""

import logging
import os
import subprocess
import sys
import threading

import pytest

import ctr_opt as ctr
from ctr_opt.forward.compiled import CompiledRecord
from ctr_opt.mechanics.kind import DEAD
from ctr_opt.native import compile as compilation
from ctr_opt.native import library as libraries
from ctr_opt.native.compiler import SWITCH
from tests.support.physics import held, rod

pytestmark = pytest.mark.skipif(compilation.compiler() is None, reason="needs a C compiler")


@pytest.fixture
def fresh(monkeypatch):
    """A process that has not asked for any library, and may build them in the background."""
    monkeypatch.delenv(SWITCH)
    libraries.library.cache_clear()
    yield monkeypatch
    libraries.library.cache_clear()


def compiled(problem):
    return isinstance(problem.solve(held()).record, CompiledRecord)


def test_what_is_on_the_disk_is_used_at_once(fresh):
    ctr.ForwardProblem(rod()).compile()
    libraries.library.cache_clear()
    assert compiled(ctr.ForwardProblem(rod()))
    assert not compiled(ctr.ForwardProblem(rod(), compiled=False))


def test_many_solves_are_worth_a_library_and_few_are_not(fresh):
    """Nothing is kept on the disk here; what is built is not looked at, only whether it was begun."""
    begun = []
    fresh.setattr(compilation, "kept", lambda *_: None)
    fresh.setattr(libraries, "library_source", lambda *_: "int nothing;")
    fresh.setattr(compilation, "Build", lambda *given: begun.append(given) or _Unfinished())
    problem = ctr.ForwardProblem(rod())
    for k in range(1, libraries._ENOUGH):
        assert not compiled(problem)
        assert not begun, k
    assert not compiled(problem)
    assert len(begun) == 1
    assert not compiled(problem)
    assert len(begun) == 1


class _Unfinished:
    def ready(self):
        return False


def test_a_build_in_the_background_is_taken_when_it_is_there(fresh):
    fresh.setattr(compilation, "kept", lambda *_: None)
    problem = ctr.ForwardProblem(rod())
    for _ in range(libraries._ENOUGH):
        problem.solve(held())
    build = libraries.library(1, DEAD)._build
    assert build.result(60.0) is not None
    assert compiled(problem)


def test_on_request_alone(monkeypatch):
    libraries.library.cache_clear()
    monkeypatch.setenv(SWITCH, "request")
    problem = ctr.ForwardProblem(rod())
    assert not any(compiled(problem) for _ in range(libraries._ENOUGH + 2))
    problem.compile()
    assert compiled(problem)


def test_switched_off(monkeypatch):
    libraries.library.cache_clear()
    monkeypatch.setenv(SWITCH, "0")
    assert not compiled(ctr.ForwardProblem(rod()))
    with pytest.raises(ctr.CompilationError, match="switched off by CTR_OPT_COMPILE=0"):
        ctr.ForwardProblem(rod(), compiled=True)


def test_without_a_compiler_everything_works_and_that_is_said_once(tmp_path):
    script = (
        "import logging, ctr_opt as ctr\n"
        "logging.basicConfig(format='%(message)s')\n"
        "tube = ctr.Tube('rod', 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)\n"
        "problem = ctr.ForwardProblem(ctr.Robot([tube]))\n"
        "shapes = [problem.solve(ctr.Actuation([0.01 * k], [0.0])) for k in range(15)]\n"
        "print(all(shape.converged for shape in shapes))\n"
    )
    environment = {**os.environ, "PATH": str(tmp_path), "CTR_OPT_CACHE": str(tmp_path)}
    environment.pop(SWITCH), environment.pop("CC", None)
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"
    assert done.stderr.count("no C compiler found") == 1
    assert len(done.stderr.splitlines()) == 1


def test_a_compiler_that_fails_is_reported_once(fresh, caplog, tmp_path):
    fresh.setenv("CTR_OPT_CACHE", str(tmp_path))
    fresh.setattr(libraries, "library_source", lambda *_: "this is no C")
    fresh.setattr(libraries, "origin", lambda *_: "of no C")
    problem = ctr.ForwardProblem(rod())
    with caplog.at_level(logging.WARNING):
        for _ in range(libraries._ENOUGH):
            problem.solve(held())
        build = libraries.library(1, DEAD)._build
        assert build.result(60.0) is None
        assert not compiled(problem)
    assert len([record for record in caplog.records if "compilation failed" in record.message]) == 1


def test_a_build_is_begun_when_threads_count_at_once(fresh):
    """Two solves, the tenth and the eleventh, are both counted before either asks which it is."""
    met = threading.Barrier(2, timeout=10.0)

    class Count(int):
        __hash__ = int.__hash__

        def __add__(self, other):
            return Count(int(self) + other)

        def __eq__(self, other):
            if other == 1:
                met.wait()
            return int(self) == other

    begun = []
    fresh.setattr(compilation, "compiler", lambda: "cc")
    fresh.setattr(libraries, "library_source", lambda *_: "int nothing;")
    fresh.setattr(compilation, "Build", lambda *given: begun.append(given) or _Unfinished())
    asked = libraries.Library(1, DEAD)
    asked._asked = Count(libraries._ENOUGH - 1)
    threads = [threading.Thread(target=asked.ready) for _ in range(2)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert asked._asked == libraries._ENOUGH + 1
    assert len(begun) == 1
