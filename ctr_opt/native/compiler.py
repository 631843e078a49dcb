"""The system's C compiler: which one it is, and how it is run without hanging or being left behind."""

from __future__ import annotations

import atexit
import logging
import os
import shlex
import shutil
import signal
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

import attrs

from ..errors import CompilationError

SWITCH = "CTR_OPT_COMPILE"  # environment variable: "0" switches compilation off, "request" compiles only when asked to
FLAGS = (
    *("-O3", "-std=c11", "-shared", *(() if os.name == "nt" else ("-fPIC",))),
    # Fused multiply-add, which -std=c11 forbids, gains a fifth. Never -ffast-math: it removes the checks for NaN.
    # No rounding is trapped, so that the compiler may round and compare several numbers at once.
    *("-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast"),
)
TUNINGS = ("-march=native", "-mcpu=native")  # the first that the compiler and its assembler accept is used
SUFFIX = ".dll" if os.name == "nt" else ".so"  # of a library

_USUAL = ("cc", "gcc", "clang")
_TIMEOUT = 120.0  # seconds for one compilation
_ANSWER = 10.0  # seconds to tell the version
_LINES = 20  # of what the compiler says are kept
_TRIAL = "void f(double *a, const double *b) { for (int i = 0; i < 64; i++) a[i] += a[i] * b[i]; }\n"

_LOG = logging.getLogger(__name__)
_lock = threading.Lock()
_starting = threading.RLock()  # held to start what must be ended when the interpreter exits
leaving = threading.Event()  # set when the interpreter exits: what fails from then on is not worth a word
_running: set[subprocess.Popen[bytes]] = set()
_private: set[Path] = set()


@attrs.frozen
class Compiler:
    """A C compiler: the command that starts it, its arguments included, and the first line of its ``--version``."""

    command: tuple[str, ...]
    version: str

    @property
    def flags(self) -> tuple[str, ...]:
        """What libraries are compiled with."""
        return (*FLAGS, *_tuning(self))

    def build(self, source: str, directory: Path) -> Path:
        """Compile C text into a shared library in ``directory``, which is the caller's alone, and return its path.

        Raises
        ------
        CompilationError
            The compiler failed, was killed, or took longer than two minutes.
        """
        return self._build(source, directory, self.flags, _TIMEOUT)

    def _build(self, source: str, directory: Path, flags: tuple[str, ...], timeout: float) -> Path:
        code, library = directory / "code.c", directory / f"code{SUFFIX}"
        command = (*self.command, *flags, "-o", str(library), str(code), "-lm")
        try:
            code.write_text(source, encoding="utf-8")
            status, said = _run(command, timeout, directory)
        except OSError as error:
            raise CompilationError(f"cannot compile: {error}") from error
        if status != 0 or not library.is_file():
            ending = "took too long and was stopped" if status is None else f"ended with status {status}"
            last = "\n".join(said.splitlines()[-_LINES:])
            raise CompilationError(f"the C compiler {ending}: {shlex.join(command)}\n{last}".rstrip())
        return library


def switched_off() -> bool:
    """Whether the environment forbids compilation."""
    return os.environ.get(SWITCH, "").strip() == "0"


def on_request_only() -> bool:
    """Whether the environment forbids compilation but where it is asked for."""
    return os.environ.get(SWITCH, "").strip() == "request"


def required() -> Compiler:
    """The system's C compiler; a :class:`CompilationError` if there is none or it must not be used."""
    if switched_off():
        raise CompilationError(f"compilation is switched off by {SWITCH}=0")
    found = compiler()
    if found is None:
        raise CompilationError(_none_found())
    return found


def compiler() -> Compiler | None:
    """The system's C compiler: ``$CC`` if set, which may hold arguments, else the first of cc, gcc and clang.

    None if there is none, which is logged once, or compilation is switched off. It is asked once per process.
    """
    if switched_off():
        return None
    with _lock:
        return _find(_given(), os.environ.get("PATH"))


def _given() -> str:
    return os.environ.get("CC", "").strip()


def _none_found() -> str:
    return (
        f"no C compiler found ({f'CC={_given()}' if _given() else ', '.join(_USUAL)}): ctr_opt works in CasADi's "
        "virtual machine, about ten times slower; install gcc or clang, name a compiler in CC, or set "
        f"{SWITCH}=0 to go without"
    )


@cache
def _find(given: str, path: str | None) -> Compiler | None:
    for words in [_words(given)] if given else [[name] for name in _USUAL]:
        program = shutil.which(words[0], path=path)
        if program is not None:
            command = (str(Path(program).absolute()), *words[1:])
            with suppress(OSError):
                status, said = _run((*command, "--version"), _ANSWER)
                if status == 0 and said.strip():
                    return Compiler(command, said.strip().splitlines()[0])
    _LOG.warning(_none_found())
    return None


def _words(command: str) -> list[str]:
    try:
        return shlex.split(command, posix=os.name != "nt")
    except ValueError:  # a quotation without its end
        return [command]


@cache
def _tuning(tried: Compiler) -> tuple[str, ...]:
    """The flag by which the compiler uses all of this processor, if it takes one."""
    for flag in TUNINGS:
        with private_directory() as directory, suppress(CompilationError):
            tried._build(_TRIAL, directory, (*FLAGS, flag), _ANSWER)
            return (flag,)
    return ()


@contextmanager
def private_directory() -> Iterator[Path]:
    """A new directory that nobody else can read or write, removed at the end or when the interpreter exits.

    Raises
    ------
    CompilationError
        There is no place for temporary files.
    """
    with _until_exit():
        try:
            directory = Path(tempfile.mkdtemp(prefix="ctr_opt-"))
        except OSError as error:
            raise CompilationError(f"no directory for temporary files: {error}") from error
        _private.add(directory)
    try:
        yield directory
    finally:
        _private.discard(directory)
        shutil.rmtree(directory, ignore_errors=True)


def _run(command: tuple[str, ...], timeout: float, directory: Path | None = None) -> tuple[int | None, str]:
    """Exit status, None after ``timeout`` seconds, and all that the command said.

    Its own temporary files are in ``directory``, so that they go with it when the command is killed.

    The output goes to a file, as a pipe stays open, and is waited for, while any child of the compiler lives.
    """
    with tempfile.TemporaryFile() as output:
        with _until_exit():
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env={**os.environ, **dict.fromkeys(("TMPDIR", "TMP", "TEMP") if directory else (), str(directory))},
                start_new_session=True,
            )
            _running.add(process)
        status = None
        try:
            with suppress(subprocess.TimeoutExpired):
                status = process.wait(timeout)
        finally:
            _kill(process)
            _running.discard(process)
        output.seek(0)
        return status, output.read().decode(errors="replace")


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End a process and those that it started, unless it has ended."""
    if process.poll() is not None:
        return
    with suppress(OSError):
        if os.name == "posix":
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
        process.wait(_ANSWER)


@contextmanager
def _until_exit() -> Iterator[None]:
    with _starting:
        if leaving.is_set():
            raise CompilationError("the interpreter exits")
        yield


@atexit.register
def _leave_nothing_behind() -> None:
    """Threads that wait for a compiler end with the interpreter; the compiler and its files would stay."""
    with _starting:
        leaving.set()
    for process in list(_running):
        _kill(process)
    for directory in list(_private):
        shutil.rmtree(directory, ignore_errors=True)


def _forget_parent() -> None:
    """In a forked process: the compilers and directories are the parent's, and its threads will release no lock."""
    global _lock, _starting
    _lock, _starting = threading.Lock(), threading.RLock()
    _running.clear()
    _private.clear()


if hasattr(os, "register_at_fork"):
    # No fork while a compiler starts: Popen waits for all copies of a pipe to be closed, and the forked process, which
    # would have one, may wait for the library.
    os.register_at_fork(
        before=lambda: _starting.acquire() and None,
        after_in_parent=lambda: _starting.release(),
        after_in_child=_forget_parent,
    )
