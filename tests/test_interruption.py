"""A run that is killed or interrupted leaves its output whole, as it was, or absent; never half of it."""

import json
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress

import numpy as np
import pytest

import ctr_opt as ctr
from tests.support.slow import some_slow

OLD = b"what was there before"

PROBLEM = "problems/rjw_s1/fig9_loaded.toml"

# Writes the shape over and over, so that it is stopped inside a write.
WRITE = """
import sys
import ctr_opt as ctr
shape = ctr.load_problem(sys.argv[1]).solve()
print("ready", flush=True)
while True:
    ctr.save_shape(shape, sys.argv[2])
"""

# The command, with a signal at the first call of a function from the moment on at which the report is printed.
AT = """
import os, signal, sys
from pathlib import Path
import click
from ctr_opt.cli import main
file, function, how, *arguments = sys.argv[1:]

def watch(frame, event, _):
    if event == "call" and frame.f_code.co_name == function and Path(frame.f_code.co_filename).name == file:
        sys.setprofile(None)
        print("sent", flush=True)
        os.kill(os.getpid(), signal.Signals[how])

def echo(*arguments, **options):
    sys.setprofile(watch)
    printed(*arguments, **options)

printed, click.echo = click.echo, echo
sys.argv = ["ctr-opt", *arguments]
main()
"""

# The command, whose writing goes on for ever, with a signal that a destructor swallows.
LOST = """
import os, signal, sys
from ctr_opt.cli import main
from ctr_opt.files.shapes import WRITERS

class Swallows:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGTERM)

def write(shape, path):
    path.write_text("half of it")
    Swallows()
    while True:
        pass

WRITERS[".csv"] = write
sys.argv = ["ctr-opt", *sys.argv[1:]]
main()
"""

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")


@contextmanager
def interrupts(answer):
    """How processes started meanwhile answer SIGINT: they inherit that it is ignored, and nothing else."""
    before = signal.signal(signal.SIGINT, answer)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(autouse=True)
def heard():
    """Also where the tests run in the background, which shells let ignore SIGINT."""
    with interrupts(signal.default_int_handler):
        yield


def started(*arguments):
    process = subprocess.Popen([sys.executable, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.readline()
    return process


def stopped(process, how):
    """Its exit code; an interrupt is sent again, as one that arrives inside a destructor is lost to Python."""
    for _ in range(4):
        process.send_signal(how)
        with suppress(subprocess.TimeoutExpired):
            process.communicate(timeout=5 if how == signal.SIGINT else 20)
            break
    return process.returncode


def whole(path, expected):
    """Whether a file is the old one or a complete new one."""
    if not path.exists() or path.read_bytes() == OLD:
        return True
    if path.suffix == ".json":
        return np.array_equal(json.loads(path.read_text())["columns"]["s"], expected)
    if path.suffix == ".npz":
        with np.load(path) as table:
            return np.array_equal(table["s"], expected)
    if path.suffix == ".csv":
        return np.array_equal(np.genfromtxt(path, delimiter=",", names=True)["s"], expected)
    return path.read_bytes().endswith(b"IEND\xaeB`\x82")


@pytest.fixture(scope="module")
def arc_length():
    return ctr.load_problem("problems/rjw_s1/fig9_loaded.toml").solve().arc_length


@pytest.mark.parametrize(
    ("suffix", "how"),
    some_slow(
        [(".csv", "SIGINT"), (".npz", "SIGKILL"), (".json", "SIGKILL")], [(".csv", "SIGINT"), (".npz", "SIGKILL")]
    ),
)
def test_a_stopped_program_leaves_its_output_whole(tmp_path, arc_length, suffix, how):
    path = tmp_path / f"shape{suffix}"
    path.write_bytes(OLD)
    process = started("-c", WRITE, PROBLEM, str(path))
    time.sleep(np.random.default_rng([3, len(suffix + how)]).uniform(0.0, 0.1))
    assert stopped(process, getattr(signal, how)) != 0
    assert whole(path, arc_length)
    left = [each.name for each in tmp_path.iterdir() if each != path]
    assert left == [] or how == "SIGKILL"
    assert all(name.startswith(".shape.") and name.endswith(f".part{suffix}") for name in left)  # hidden, and no output


@pytest.mark.parametrize(("how", "code"), [("SIGKILL", -9), ("SIGTERM", 143), ("SIGINT", 130)])
def test_a_stopped_command_leaves_its_outputs_whole_or_absent(tmp_path, arc_length, how, code):
    """From the moment on at which it has printed its report, so that it is writing."""
    shape, figure = tmp_path / "shape.csv", tmp_path / "shape.png"
    process = started("-u", "-m", "ctr_opt", "solve", PROBLEM, "--output", str(shape), "--figure", str(figure))
    time.sleep(np.random.default_rng([4, len(how)]).uniform(0.0, 0.3))
    assert stopped(process, getattr(signal, how)) == code
    assert whole(shape, arc_length)
    assert whole(figure, arc_length)
    left = [each.name for each in tmp_path.iterdir() if each not in (shape, figure)]
    assert left == [] or how == "SIGKILL"
    assert all(".part." in name for name in left)


MOMENTS = {
    "in a conversion that makes None of an error": ("casadi.py", "toarray", "SIGTERM"),
    "where Python makes another error of it": ("_base.py", "__set_name__", "SIGINT"),
    "before a file is in place": ("text.py", "_umask", "SIGTERM"),
    "when all is done": ("compiler.py", "_leave_nothing_behind", "SIGINT"),
}


@pytest.mark.parametrize("moment", some_slow(list(MOMENTS), [*MOMENTS][1:3]))
def test_a_command_tells_the_signal_that_stopped_it(tmp_path, arc_length, moment):
    """Also where the exception that a signal raises gets lost, or becomes another: such ended with status 0 or 1."""
    shape, figure = tmp_path / "shape.csv", tmp_path / "shape.png"
    file, function, how = MOMENTS[moment]
    drawn = ["--figure", str(figure)] if function == "__set_name__" else []
    run = [sys.executable, "-c", AT, file, function, how, "solve", PROBLEM, "--output", str(shape), *drawn]
    done = subprocess.run(run, capture_output=True, text=True, check=False, timeout=60)
    assert "sent" in done.stdout.splitlines()
    assert done.returncode == 128 + signal.Signals[how], done.stderr
    assert "Traceback" not in done.stderr
    assert whole(shape, arc_length)
    assert {each.name for each in tmp_path.iterdir()} <= {shape.name}


def test_a_signal_that_is_swallowed_ends_a_command_after_a_while(tmp_path):
    shape = tmp_path / "shape.csv"
    run = [sys.executable, "-c", LOST, "solve", PROBLEM, "--output", str(shape)]
    done = subprocess.run(run, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 143, done.stderr
    assert not list(tmp_path.iterdir())


def test_signals_that_the_parent_ignores_stay_ignored(tmp_path, arc_length):
    """As under nohup."""
    shape = tmp_path / "shape.csv"
    run = [sys.executable, "-c", AT, "text.py", "_umask", "SIGINT", "solve", PROBLEM, "--output", str(shape)]
    with interrupts(signal.SIG_IGN):
        done = subprocess.run(run, capture_output=True, check=False, timeout=60)
    assert done.returncode == 0
    assert np.array_equal(np.genfromtxt(shape, delimiter=",", names=True)["s"], arc_length)
