"""The system's C compiler: which one is used, and how it runs without hanging or being left behind."""

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

SWITCH = "CTR_OPT_COMPILE"  # environment variable: "0" switches compilation off, "request" compiles on request only
FLAGS = (
    *("-O3", "-std=c11", "-shared", *(() if os.name == "nt" else ("-fPIC",))),
    # Fused multiply-add, which -std=c11 forbids, gains a fifth. Never -ffast-math: it removes the checks for NaN.
    # No rounding is trapped, so that the compiler may round and compare several numbers at once.
    *("-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast"),
)
TUNINGS = ("-march=native", "-mcpu=native")  # the first that the compiler and its assembler accept is used
SUFFIX = ".dll" if os.name == "nt" else ".so"  # of a library
SLOWER = "where an integration takes about 25 times and a solve 300 to 600 times as long"
"""The cost of running without compiled code, as measured in ``docs/evidence/performance.md``."""

_USUAL = ("cc", "gcc", "clang")
_TIMEOUT = 120.0  # seconds for one compilation
_ANSWER = 10.0  # seconds to print the version
_LINES = 20  # of the compiler's output are kept
_TRIAL = "void f(double *a, const double *b) { for (int i = 0; i < 64; i++) a[i] += a[i] * b[i]; }\n"

_LOG = logging.getLogger(__name__)
_lock = threading.Lock()
_starting = threading.RLock()  # held to start what must be ended when the interpreter exits
leaving = threading.Event()  # set when the interpreter exits: later failures are not reported
_running: set[subprocess.Popen[bytes]] = set()
_private: set[Path] = set()


@attrs.frozen
class Compiler:
    """A C compiler: the command that starts it, its arguments included, and the first line of its ``--version``."""

    command: tuple[str, ...]
    version: str

    @property
    def flags(self) -> tuple[str, ...]:
        """The flags with which libraries are compiled."""
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
            status, output = _run(command, timeout, directory)
        except OSError as error:
            raise CompilationError(f"cannot compile: {error}") from error
        if status != 0 or not library.is_file():
            ending = "took too long and was stopped" if status is None else f"ended with status {status}"
            last = "\n".join(output.splitlines()[-_LINES:])
            raise CompilationError(f"the C compiler {ending}: {shlex.join(command)}\n{last}".rstrip())
        return library


def switched_off() -> bool:
    """Whether the environment forbids compilation."""
    return os.environ.get(SWITCH, "").strip() == "0"


def on_request_only() -> bool:
    """Whether the environment allows compilation on request only."""
    return os.environ.get(SWITCH, "").strip() == "request"


def required() -> Compiler:
    """The system's C compiler; raises ``CompilationError`` if there is none or it must not be used."""
    if switched_off():
        raise CompilationError(f"compilation is switched off by {SWITCH}=0")
    available = compiler()
    if available is None:
        raise CompilationError(_no_compiler())
    return available


def compiler() -> Compiler | None:
    """The system's C compiler: ``$CC``, which may hold arguments, or the first of cc, gcc and clang.

    None if there is no compiler, which is logged once, or if compilation is switched off. The search runs once per
    process.
    """
    if switched_off():
        return None
    with _lock:
        return _find(_requested(), os.environ.get("PATH"))


def _requested() -> str:
    return os.environ.get("CC", "").strip()


def _no_compiler() -> str:
    return (
        f"no C compiler found ({f'CC={_requested()}' if _requested() else ', '.join(_USUAL)}): ctr_opt runs in "
        f"CasADi's virtual machine, {SLOWER}; install gcc or clang, name a compiler in CC, or set {SWITCH}=0 to run "
        "without a compiler"
    )


@cache
def _find(requested: str, path: str | None) -> Compiler | None:
    for words in [_words(requested)] if requested else [[name] for name in _USUAL]:
        program = shutil.which(words[0], path=path)
        if program is not None:
            command = (str(Path(program).absolute()), *words[1:])
            with suppress(OSError):
                status, answer = _run((*command, "--version"), _ANSWER)
                if status == 0 and answer.strip():
                    return Compiler(command, answer.strip().splitlines()[0])
    _LOG.warning(_no_compiler())
    return None


def _words(command: str) -> list[str]:
    try:
        return shlex.split(command, posix=os.name != "nt")
    except ValueError:  # a quotation without its end
        return [command]


@cache
def _tuning(tried: Compiler) -> tuple[str, ...]:
    """The flag that makes the compiler use all features of this processor, if it accepts one."""
    for flag in TUNINGS:
        with private_directory() as directory, suppress(CompilationError):
            tried._build(_TRIAL, directory, (*FLAGS, flag), _ANSWER)
            return (flag,)
    return ()


@contextmanager
def private_directory() -> Iterator[Path]:
    """A new directory that only this user can access, removed at the end or when the interpreter exits.

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
    """Run a command: its exit status, None after ``timeout`` seconds, and its output.

    Temporary files of the command are in ``directory`` and are removed with it if the command is killed. The output
    goes to a file: a pipe would stay open while any child of the compiler lives.
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
    """End a process and its children, unless it has ended."""
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
    """End running compilers and remove their files at exit; they would outlive the threads that wait for them."""
    with _starting:
        leaving.set()
    for process in list(_running):
        _kill(process)
    for directory in list(_private):
        shutil.rmtree(directory, ignore_errors=True)


def _forget_parent() -> None:
    """Reset a forked process: compilers and directories are the parent's, and no thread will release its locks."""
    global _lock, _starting
    _lock, _starting = threading.Lock(), threading.RLock()
    _running.clear()
    _private.clear()


if hasattr(os, "register_at_fork"):
    # No fork while a compiler starts: Popen waits until all copies of a pipe are closed. The forked process would hold
    # a copy, and may itself wait for the library.
    os.register_at_fork(
        before=lambda: _starting.acquire() and None,
        after_in_parent=lambda: _starting.release(),
        after_in_child=_forget_parent,
    )
