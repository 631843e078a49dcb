"""C text becomes a loaded library: once per machine, whatever happens to the compiler, the cache or the process."""

import ctypes
import errno
import hashlib
import logging
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from ctr_opt.errors import CompilationError
from ctr_opt.native import cache as library_cache
from ctr_opt.native import compile as compilation
from ctr_opt.native import compiler as compilers
from ctr_opt.native.compile import Build, Source, compiler, load
from tests.support.slow import some_slow

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the compilers are shell scripts")

PRINT = "import sys\nfrom ctr_opt.native.compile import load\nprint(load('answer', sys.argv[1]).answer())"


def answer(value):
    return f"int answer(void) {{ return {value}; }}\n"


def forty_two():
    return answer(42)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """An empty cache, and a process that has compiled nothing yet."""
    for name in ("CC", compilers.SWITCH):
        monkeypatch.delenv(name, raising=False)
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setenv(library_cache.DIRECTORY, str(tmp_path / "cache"))
    monkeypatch.setattr(compilation, "_loaded", {})
    monkeypatch.setattr(compilation, "_said", {})
    compilers._find.cache_clear()
    compilers._tuning.cache_clear()
    yield tmp_path / "cache"
    compilers._find.cache_clear()
    assert not list(temporary.iterdir())  # nothing is left behind


@pytest.fixture
def calls(tmp_path, monkeypatch):
    """A compiler that notes its calls, but for the question of its version."""
    return Script(tmp_path, monkeypatch)


class Script:
    """A shell script in place of the compiler: it notes a call, does something, and calls the compiler."""

    def __init__(self, directory, monkeypatch, first=":"):
        self.path, self.notes = directory / "script", directory / "calls"
        self.does(first)
        monkeypatch.setenv("CC", str(self.path))

    def does(self, first, version="exec cc --version"):
        asked = f'case "$*" in *--version*) {version};; esac'
        self.path.write_text(f'#!/bin/sh\n{asked}\necho $$ >> {self.notes}\n{first}\nexec cc "$@"\n')
        self.path.chmod(0o700)
        compilers._find.cache_clear()

    @property
    def pids(self):
        return self.notes.read_text().split() if self.notes.exists() else []

    def __len__(self):
        return len(self.pids)

    def wait(self):
        """Until the compiler has been called."""
        end = time.monotonic() + 20
        while not len(self):
            assert time.monotonic() < end
            time.sleep(0.01)


COMPILED = 2  # calls of the compiler for one library: the trial of the flags, and the library


def spawned(code, *arguments):
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def finished(process, status=0):
    out, err = process.communicate(timeout=60)
    assert process.returncode == status, err
    return out.strip(), err


def other_process(source):
    """What another process gets from the library, and what it says."""
    out, err = finished(spawned(PRINT, source))
    return int(out), err


def libraries(directory):
    return sorted(directory.glob("*.so"))


def gone(pid):
    """Whether a process has ended, its zombie not counted."""
    try:
        return ") Z" in Path(f"/proc/{pid}/stat").read_text() if sys.platform == "linux" else bool(os.kill(pid, 0))
    except OSError:
        return True


def test_compiles_and_calls():
    library = load("half", "#include <math.h>\ndouble half(double x) { return sqrt(x) / 2; }\n")
    library.half.restype, library.half.argtypes = ctypes.c_double, [ctypes.c_double]
    assert library.half(9.0) == 1.5
    assert library.half(-1.0) != library.half(-1.0)  # NaN stays NaN


def test_the_compiler_tells_its_version_and_flags(calls):
    found = compiler()
    assert found.command == (str(calls.path),)
    assert found.version == subprocess.check_output(["cc", "--version"], text=True).splitlines()[0]
    assert {"-O3", "-shared", "-std=c11", "-fno-math-errno"} <= set(found.flags)
    assert "-ffast-math" not in found.flags


def test_the_version_is_asked_once(calls, tmp_path):
    calls.does(":", version=f"echo asked >> {tmp_path}/asked; exec cc --version")
    assert compiler() is compiler()
    load("answer", answer(1))
    assert (tmp_path / "asked").read_text() == "asked\n"


@pytest.mark.parametrize("rejected", ["-march=native", "native"])
def test_a_tuning_that_is_rejected_is_left_out(calls, rejected):
    calls.does(f'case "$*" in *{rejected}*) exit 1;; esac')
    assert not any(rejected in flag for flag in compiler().flags)
    assert load("answer", answer(42)).answer() == 42


def test_a_second_process_does_not_compile(calls):
    assert other_process(answer(42)) == (42, "")
    assert len(calls) == COMPILED
    assert other_process(answer(42)) == (42, "")
    assert load("answer", answer(42)).answer() == 42
    assert load("answer", answer(42)) is load("answer", answer(42))
    assert len(calls) == COMPILED


@pytest.mark.slow
def test_of_eight_processes_at_once_one_compiles(calls):
    calls.does("sleep 0.3")
    running = [spawned(PRINT, answer(42)) for _ in range(8)]
    assert {finished(process) for process in running} == {("42", "")}
    assert len(calls) == COMPILED


def flip(library, record):
    content = bytearray(library.read_bytes())
    content[len(content) // 2] ^= 1
    library.write_bytes(content)


def truncate(library, record):
    os.truncate(library, library.stat().st_size // 2)


def empty(library, record):
    library.write_bytes(b"")


def unrecorded(library, record):
    record.unlink()


def half_recorded(library, record):
    os.truncate(record, record.stat().st_size // 2)


def other_key(library, record):
    """Both files of another entry under the names of this one."""
    finished(spawned(PRINT, answer(13)))
    other = next(path for path in libraries(library.parent) if path != library)
    other.replace(library)
    other.with_suffix(".record").replace(record)


def no_library(library, record):
    """Its record is right, but it is no library: as one of a system with another libc."""
    library.write_bytes(b"text")
    key = record.read_text().splitlines()[0]
    record.write_text(f"{key}\nsha256 {hashlib.sha256(b'text').hexdigest()}\n")


def directories(library, record):
    for path in (library, record, library.with_suffix(".lock")):
        path.unlink()
        path.mkdir()
        (path / "file").touch()


def pipe(library, record):
    library.unlink()
    os.mkfifo(library)


def link(library, record):
    elsewhere = library.parent / "elsewhere"
    library.rename(elsewhere)
    library.symlink_to(elsewhere)


def open_to_others(library, record):
    library.chmod(0o666)


DAMAGE = [
    *(flip, truncate, empty, unrecorded, half_recorded, other_key, no_library),
    *(directories, pipe, link, open_to_others),
]


@pytest.mark.parametrize("damage", some_slow(DAMAGE, [flip, unrecorded, link]))
def test_a_damaged_entry_is_rebuilt(cache, calls, damage):
    other_process(answer(42))
    (library,) = libraries(cache)
    damage(library, library.with_suffix(".record"))
    before = len(calls)
    assert other_process(answer(42)) == (42, "")
    assert load("answer", answer(42)).answer() == 42  # as it is again, it is loaded
    assert len(calls) == before + COMPILED


def test_a_process_killed_while_compiling_leaves_nothing_in_the_way(cache, calls, tmp_path):
    calls.does("exec sleep 60")
    process = spawned(PRINT, answer(42))
    calls.wait()
    process.kill()
    finished(process, -signal.SIGKILL)
    assert not libraries(cache)
    calls.does(":")
    assert other_process(answer(42)) == (42, "")
    os.kill(int(calls.pids[0]), signal.SIGKILL)  # which nobody could end, nor remove its files
    for path in Path(tempfile.gettempdir()).glob("ctr_opt-*"):
        library_cache._make_way(path)


KILLED_AT = """
import os, signal, sys
from ctr_opt.native import cache as library_cache
from ctr_opt.native.compile import load
at, calls, real = int(sys.argv[2]), 0, {}
def dying(name):
    def call(*arguments, **named):
        global calls
        calls += 1
        if calls > at:
            os.kill(os.getpid(), signal.SIGKILL)
        return real[name](*arguments, **named)
    return call
for name in ("fdopen", "utime"):
    real[name] = getattr(os, name)
    setattr(os, name, dying(name))
real["replace"] = library_cache.Path.replace
library_cache.Path.replace = dying("replace")
load("answer", sys.argv[1])
"""


@pytest.mark.parametrize("at", some_slow([0, 1, 2, 3], [1]))
def test_a_process_killed_while_writing_leaves_nothing_that_is_loaded(cache, calls, at):
    """Before the library is written, before it has its name, and the same of the record."""
    finished(spawned(KILLED_AT, answer(42), at), -signal.SIGKILL)
    before = len(calls)
    for path in Path(tempfile.gettempdir()).glob("ctr_opt-*"):
        library_cache._make_way(path)
    assert other_process(answer(42)) == (42, "")
    assert len(calls) == before + COMPILED


def test_without_a_compiler_it_is_said_once(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert compiler() is None
    assert compiler() is None
    with pytest.raises(CompilationError, match=r"no C compiler found \(cc, gcc, clang\).*install gcc or clang"):
        load("answer", answer(42))
    build = Build("answer", Source(forty_two))
    assert build.result() is None
    assert "no C compiler found" in str(build.error)
    assert [record.levelno for record in caplog.records] == [logging.WARNING]


@pytest.mark.parametrize("given", ["no-such-compiler -O1", "cc 'open", "false", "/"])
def test_a_compiler_that_is_named_but_does_not_work(monkeypatch, caplog, given):
    monkeypatch.setenv("CC", given)
    assert compiler() is None
    assert f"CC={given}" in caplog.text


def test_an_error_in_the_source_is_reported(cache):
    with pytest.raises(CompilationError, match=r"ended with status 1: .*-O3(.|\n)*code.c(.|\n)*error"):
        load("answer", "int answer( {")
    assert not libraries(cache)


def test_the_last_lines_of_a_failing_compiler_are_reported(calls):
    calls.does("for i in $(seq 100); do echo line $i; done; echo out of order >&2; exit 3")
    with pytest.raises(CompilationError, match=r"status 3(.|\n)*line 100\nout of order$") as raised:
        load("answer", answer(42))
    assert "line 50" not in str(raised.value)


def test_a_compiler_that_hangs_is_stopped_with_all_it_started(calls, monkeypatch, tmp_path):
    no_trial = 'case "$*" in *native*) exit 1;; esac'
    calls.does(f"{no_trial}; echo working; sh -c 'echo $$ > {tmp_path}/child; sleep 60'; exit")
    monkeypatch.setattr(compilers, "_TIMEOUT", 1.5)  # for two shells to start and write a word each
    with pytest.raises(CompilationError, match=r"took too long and was stopped(.|\n)*working"):
        load("answer", answer(42))
    assert gone((tmp_path / "child").read_text().strip())


def test_a_file_in_place_of_the_cache(cache, calls, caplog):
    cache.touch()
    assert load("answer", answer(42)).answer() == 42
    assert load("answer", answer(42)).answer() == 42
    assert load("other", answer(43)).answer() == 43
    assert len(calls) == COMPILED + 1
    (message,) = caplog.messages
    assert library_cache.DIRECTORY in message


def test_a_full_disk(calls, caplog, monkeypatch):
    def full(path, content):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(library_cache, "_write", full)
    assert load("answer", answer(42)).answer() == 42
    assert len(calls) == COMPILED  # what was compiled is not compiled again
    assert "No space left" in caplog.text


def test_a_lock_that_never_opens(cache, caplog, monkeypatch):
    monkeypatch.setattr(library_cache, "_PATIENCE", 0.1)
    monkeypatch.setattr(compilation, "Kept", Locked)
    assert load("answer", answer(42)).answer() == 42
    assert "lock" in caplog.text


class Locked(library_cache.Kept):
    """An entry that another holds."""

    def lock(self):
        other = library_cache.FileLock(self._path(".lock"))
        other.acquire()
        self.held.append(other)
        return super().lock()

    held = []  # noqa: RUF012


def test_no_home(monkeypatch, caplog):
    monkeypatch.delenv(library_cache.DIRECTORY)
    monkeypatch.setattr(library_cache, "user_cache_dir", lambda name: f"~/.cache/{name}")
    assert load("answer", answer(42)).answer() == 42
    assert "no home directory" in caplog.text


def test_the_cache_is_the_users_alone(cache):
    load("answer", answer(42))
    assert cache.stat().st_mode & 0o777 == 0o700
    assert all(path.stat().st_mode & 0o077 == 0 for path in cache.iterdir())


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
def test_a_cache_where_others_may_write_is_not_used(cache, caplog, mode):
    cache.mkdir()
    cache.chmod(mode)
    assert load("answer", answer(42)).answer() == 42
    assert "other users may write" in caplog.text
    assert not list(cache.iterdir())


def test_a_cache_of_another_user_is_not_used(cache, caplog, monkeypatch):
    cache.mkdir(mode=0o700)
    monkeypatch.setattr(os, "geteuid", lambda: 12345)
    assert load("answer", answer(42)).answer() == 42
    assert "belongs to another user" in caplog.text
    assert not list(cache.iterdir())


def test_a_link_to_ones_own_directory_is_used(cache, tmp_path, caplog):
    (tmp_path / "real").mkdir(mode=0o700)
    cache.symlink_to(tmp_path / "real")
    load("answer", answer(42))
    assert libraries(tmp_path / "real")
    assert not caplog.messages


def test_arguments_in_cc(cache, monkeypatch):
    source = "int answer(void) { return ANSWER; }\n"
    for count, value in enumerate(("7", "8"), start=1):
        monkeypatch.setenv("CC", f"cc '-DANSWER= {value}'")
        assert load("answer", source).answer() == int(value)
        assert len(libraries(cache)) == count


def change_source(calls, monkeypatch):
    return answer(43)


def change_version(calls, monkeypatch):
    calls.does(":", version="echo cc 99; exit")
    return answer(42)


def change_flags(calls, monkeypatch):
    monkeypatch.setattr(compilation, "FLAGS", (*compilers.FLAGS, "-O1"))
    return answer(42)


def change_processor(calls, monkeypatch):
    monkeypatch.setattr(compilation, "_processor", lambda: "another")
    return answer(42)


@pytest.mark.parametrize("change", [change_source, change_version, change_flags, change_processor])
def test_what_the_library_depends_on_makes_another_entry(cache, calls, monkeypatch, change):
    load("answer", answer(42))
    source = change(calls, monkeypatch)
    assert load("answer", source).answer() == int(source.split()[-2].rstrip(";"))
    assert len(libraries(cache)) == 2


def test_entries_unused_for_long_are_forgotten(cache):
    load("answer", answer(1))
    load("answer", answer(2))
    old, used = sorted(libraries(cache), key=lambda path: path.stat().st_mtime_ns)
    mine = cache / "notes.so"
    half = cache / f"{old.name}.a1b2.tmp"
    mine.touch()
    half.touch()
    for path in cache.iterdir():
        days = 80 if path.stem == used.stem else 100
        os.utime(path, times=(time.time() - days * 86400.0,) * 2)
    assert other_process(answer(2)) == (2, "")  # does not write: nothing is forgotten
    assert old.exists()
    assert used.stat().st_mtime > time.time() - 3600.0
    load("answer", answer(3))
    left = {path.stem for path in cache.iterdir()}
    assert left == {used.stem, mine.stem, *(path.stem for path in libraries(cache))} - {old.stem}
    assert len(libraries(cache)) == 3  # used, new, and what is none of the cache's


def test_a_build_in_the_background(calls, tmp_path):
    gate = tmp_path / "gate"
    calls.does(f"while [ ! -e {gate} ]; do sleep 0.02; done")
    build = Build("answer", Source(forty_two))
    calls.wait()
    assert not build.ready()
    assert build.result(timeout=0.0) is None
    gate.touch()
    assert build.result().answer() == 42
    assert build.ready()
    assert build.error is None


def fails():
    raise ValueError("no source")


def test_a_background_build_that_fails_is_reported_once_and_raises_nothing(caplog):
    builds = [Build("answer", Source(fails)) for _ in range(2)]
    assert [build.result() for build in builds] == [None, None]
    assert not any(build.ready() for build in builds)
    assert all(isinstance(build.error, ValueError) for build in builds)
    (message,) = caplog.messages
    assert "no source" in message
    assert "virtual machine" in message


def test_no_more_threads(monkeypatch, caplog):
    def none_left(thread):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(compilation.threading.Thread, "start", none_left)
    build = Build("answer", Source(forty_two))
    assert build.result() is None
    assert "new thread" in caplog.text


def test_switched_off(monkeypatch, caplog, calls):
    monkeypatch.setenv(compilers.SWITCH, "0")
    assert compiler() is None
    with pytest.raises(CompilationError, match="switched off by CTR_OPT_COMPILE=0"):
        load("answer", answer(42))
    build = Build("answer", Source(fails))
    assert build.result() is None
    assert isinstance(build.error, CompilationError)
    assert not caplog.messages
    assert not len(calls)


EXIT = """
import sys, time
from ctr_opt.native.compile import Build, Source
build = Build("answer", Source(sys.argv[1]))
while not __import__("os").path.exists(sys.argv[2]):
    time.sleep(0.01)
"""


def test_exit_ends_an_unfinished_build(cache, calls):
    calls.does("touch $TMPDIR/of-the-compiler; sleep 600")  # longer than finished() waits
    assert finished(spawned(EXIT, answer(42), calls.notes)) == ("", "")
    assert gone(calls.pids[0])
    assert not libraries(cache)


FORK = """
import os, signal, sys, time
from ctr_opt.mechanics.kind import DEAD
from ctr_opt.native import library as libraries
signal.alarm(50)
libraries.library_source, libraries.Native = lambda *_: sys.argv[1], lambda library, *_: library
parent = libraries.library(1, DEAD)
for _ in range(libraries._ENOUGH):
    assert parent.ready() is None
while not os.path.exists(sys.argv[2]):
    time.sleep(0.01)
if os.fork() == 0:
    signal.alarm(50)
    child = libraries.library(1, DEAD)
    assert child.ready() is None
    open(sys.argv[3], "w").close()
    assert child.built().answer() == 42
    print("child", flush=True)
    sys.exit()
if sys.argv[4] == "killed":
    os.kill(os.getpid(), signal.SIGKILL)
assert parent._build.result().answer() == 42
assert os.wait()[1] == 0
print("parent")
"""


@pytest.mark.parametrize("parent", ["lives", "killed"])
def test_a_process_forked_during_a_build_builds_its_own(calls, tmp_path, parent):
    gate = tmp_path / "gate"
    calls.does(f"while [ ! -e {gate} ]; do sleep 0.02; done")
    process = spawned(FORK, answer(42), calls.notes, gate, parent)
    out, err = process.communicate(timeout=60)
    assert process.returncode == (-signal.SIGKILL if parent == "killed" else 0), err
    assert out == ("child\n" if parent == "killed" else "child\nparent\n")
    if parent == "lives":
        assert len(calls) <= COMPILED + 1  # the trial in both at most
    else:
        for path in Path(tempfile.gettempdir()).glob("ctr_opt-*"):
            library_cache._make_way(path)
