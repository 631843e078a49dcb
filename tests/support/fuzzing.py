"""Robot and problem files that are wrong in every way: strategies of hypothesis, and what must hold for each file.

``damaged``: valid texts with bytes and tokens changed; ``stretched``: numbers of other sizes; ``rebuilt``: tables with
wrong types, values, keys and depth.
"""

import copy
import math
import re
import signal
import tempfile
import tomllib
import warnings
from collections import Counter
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter

import numpy as np
import tomli_w
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

import ctr_opt as ctr
from ctr_opt.files.problem import check_file

LONGEST = 30.0  # seconds that reading and solving a file may take before it counts as a hang
SMALL = 60  # steps of a problem that is solved too
LONGEST_MESSAGE = 1000

ROBOT = """name = "fuzz"
[base]
pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
[[tubes]]
name = "inner"
outer_diameter = "1 mm"
inner_diameter = "0.5 mm"
youngs_modulus = "58 GPa"
poisson_ratio = 0.3
density = "6450 kg/m^3"
precurvature = [
    { kind = "straight", length = "50 mm" },
    { kind = "arc", length = "40 mm", curvature = ["5 1/m", 1.0, 0] },
    { kind = "sampled", file = "curvature.csv" },
]
[[tubes]]
name = "outer"
outer_diameter = 2e-3
inner_diameter = 1.2e-3
bending_stiffness = "0.02 N*m^2"
torsional_stiffness = 0.015
precurvature = [
    { kind = "polynomial", length = 0.05, coefficients = [[0, 5, 0], [1, 2, 0.5]] },
    { kind = "sampled", arc_length = [0, "20 mm", 0.05], curvature = [[0, 7, 0], [0, 8, 0], [0, 9, 0]] },
]
"""
PROBLEM = """title = "fuzz"
description = "made up"
robot = "robot.toml"
[source]
text = "made up"
[actuation]
rotations = ["10 deg", -1.5]
translations = ["-20 mm", 0]
[[loads]]
kind = "point"
tube = "inner"
arc_length = "60 mm"
force = ["0.3 N", 0, -0.1]
moment = [0, 0, "2 N*mm"]
[[loads]]
kind = "distributed"
tube = 1
force = ["2 N/m", 0, 0]
start = 0.01
end = "40 mm"
[[loads]]
kind = "distributed"
file = "load.csv"
[[loads]]
kind = "gravity"
acceleration = [0, 0, -9.81]
[[loads]]
kind = "point_mass"
mass = "2 g"
[[loads]]
kind = "distributed_mass"
mass_per_length = 0.1
end = 0.05
[[loads]]
kind = "spring"
stiffness = "5 N/m"
anchor = [0, "20 mm", 0.1]
[solver]
formulation = "automatic"
tolerance = 1e-6
integrator = "RK4"
[expected]
text = "unknown"
tip_position = [0, 0, "100 mm"]
position_tolerance = 1
base_torsions = [0, 0]
torsion_tolerance = "100 1/m"
"""
CURVATURE = "# s, ux, uy, uz\n0, 0, 3, 0\n0.02, 0, 5, 0\n0.04, 1, 4, 0.5\n"
LOAD = "0, 1, 0, 0, 0, 0, 0\n0.05, 1, 0, 0, 0, 0, 0.01\n0.1, 3, 0, 0, 0, 0, 0\n"
FILES = {"robot.toml": ROBOT, "problem.toml": PROBLEM, "curvature.csv": CURVATURE, "load.csv": LOAD}

_TOKENS = [
    *re.findall(
        r'"[^"]*"|\S+',
        "0 -0.0 -1 1 2 7.5 1e-300 1e300 -1e30 1e29 1e400 nan inf -inf true false 1979-05-27 07:32:00 0x7fffffff "
        '999999999999999999999999 "" "1 mm" "-1 mm" "1 GPa" "10 deg" "1e999 m" "nan m" "5 furlong" "inner" "outer" '
        '"point" "arc" "sampled" "straight" "RK8" "energy" "newton" "/" ".." "robot.toml" "load.csv" "curvature.csv" '
        '"\\u0000" "äöü" "日本" [ ] { } , = . [] {} [[]] [tubes] [[tubes]] [[loads]] [base] kind name tube length '
        "tubes loads #",
    ),
    " ",
    "\n",
]
_WORD = re.compile(r'"[^"\n]*"|[\w.+-]+|\s+|.')


# -- texts with bytes and tokens changed -------------------------------------------------------------------------------


@st.composite
def damaged(draw):
    """The files with some of their bytes or tokens removed, replaced, repeated or put elsewhere."""
    files = {name: text.encode() for name, text in FILES.items()}
    name = draw(st.sampled_from(["robot.toml", "robot.toml", "problem.toml", "problem.toml", *FILES]))
    spoil = draw(st.sampled_from([_bytes_spoiled, _tokens_spoiled, _tokens_spoiled]))
    files[name] = spoil(draw, files[name])
    return files


def _bytes_spoiled(draw, content):
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(content)))
        end = min(len(content), start + draw(st.sampled_from([0, 1, 1, 5, 10**6])))
        content = content[:start] + draw(st.binary(max_size=8)) + content[end:]
    return content


def _tokens_spoiled(draw, content):
    words = _WORD.findall(content.decode())
    for _ in range(draw(st.integers(1, 3))):
        k, j = (draw(st.integers(0, len(words) - 1)) for _ in range(2))
        if not words[k].strip():
            k = min(k + 1, len(words) - 1)
        words[k] = draw(st.sampled_from([*_TOKENS, words[j], "", words[k] * 2, words[k] + " " + words[j]]))
    return "".join(words).encode()


# -- numbers of other sizes --------------------------------------------------------------------------------------------

_FACTORS = (0.0, -1.0, 0.3, 3.0, 0.1, 10.0, 1e-3, 1e3, 1e-6, 1e6, 1e-12, 1e12)


@st.composite
def stretched(draw):
    """The files with some of their numbers multiplied: most are still right, and solved."""
    files = {name: text.encode() for name, text in FILES.items()}
    for _ in range(draw(st.integers(1, 3))):
        name = draw(st.sampled_from(["robot.toml", "problem.toml", *FILES]))
        text = files[name].decode()
        places = list(re.finditer(r"(?<![\w.^])-?\d+(?:\.\d+)?(?:e-?\d+)?(?!\w)", text))
        found = draw(st.sampled_from(places))
        number = float(found[0]) * draw(st.sampled_from(_FACTORS))
        files[name] = (text[: found.start()] + repr(number) + text[found.end() :]).encode()
    return files


# -- tables built anew -------------------------------------------------------------------------------------------------

_NUMBERS = st.one_of(
    st.sampled_from(
        [0, 1, -1, 0.0, -0.0, 1e-300, 5e-324, 1e29, 1e31, 1e300, 2**63, 10**40, math.nan, math.inf, -math.inf]
    ),
    st.integers(),
    st.floats(),
    st.floats(-1.0, 1.0),
)
_TEXTS = st.one_of(st.text(max_size=20), st.sampled_from([token.strip('"') for token in _TOKENS]))
_LEAVES = st.one_of(_NUMBERS, _TEXTS, st.booleans(), st.dates(), st.times())
_JUNK = st.recursive(
    _LEAVES,
    lambda inner: st.one_of(st.lists(inner, max_size=5), st.dictionaries(st.text(max_size=8), inner, max_size=3)),
    max_leaves=12,
)


def _deep(depth):
    value = []
    for _ in range(depth):
        value = [value]
    return value


@st.composite
def rebuilt(draw):
    """The files' tables with values exchanged, keys missing or unknown, lists of other lengths and deep nesting."""
    files = {name: text.encode() for name, text in FILES.items()}
    name = draw(st.sampled_from(["robot.toml", "problem.toml"]))
    data = tomllib.loads(FILES[name])
    for _ in range(draw(st.integers(1, 3))):
        _spoil(draw, data)
    try:
        files[name] = tomli_w.dumps(data).encode("utf-8", "surrogatepass")
    except (TypeError, ValueError, RecursionError):
        files[name] = repr(data).encode("utf-8", "surrogatepass")
    if draw(st.booleans()):
        table = st.lists(st.lists(st.one_of(_NUMBERS, st.text(max_size=4)), max_size=8), max_size=6)
        rows = draw(table)
        text = draw(st.sampled_from(["\n", "\r\n", "\r", "\n\n#"])).join(", ".join(map(str, row)) for row in rows)
        files[draw(st.sampled_from(["curvature.csv", "load.csv"]))] = text.encode("utf-8", "surrogatepass")
    return files


def _spoil(draw, data):
    """Change something at a random place below ``data``."""
    holder = data
    while True:
        keys = list(holder) if isinstance(holder, dict) else range(len(holder))
        if not keys:
            return
        key = draw(st.sampled_from(list(keys)))
        if not (isinstance(holder[key], (dict, list)) and holder[key] and draw(st.integers(0, 4))):
            break
        holder = holder[key]
    action = draw(st.integers(0, 5))
    if action == 0:
        del holder[key]
    elif action == 1 and isinstance(holder, dict):
        holder[draw(st.text(max_size=8))] = draw(_JUNK)
    elif action == 1:
        holder.append(copy.deepcopy(holder[key]))
    elif action == 2:
        holder[key] = _deep(draw(st.sampled_from([2, 20, 200])))
    elif action == 3:
        holder[key] = draw(_NUMBERS)
    else:
        holder[key] = draw(_JUNK)


# -- what must hold ----------------------------------------------------------------------------------------------------


class Hang(Exception):
    pass


@contextmanager
def _time_limit(seconds):
    def stop(*_):
        raise Hang(f"no answer within {seconds:g} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def check(files):
    """Read (and solve) the files; returns what became of them. Anything undeclared that is raised goes through."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(), _time_limit(LONGEST):
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", ctr.NestingWarning)
        for name, content in files.items():
            Path(folder, name).write_bytes(content)
        _read(ctr.load_robot, Path(folder, "robot.toml"))
        _read(check_file, Path(folder, "robot.toml"))
        _read(check_file, Path(folder, "problem.toml"))
        problem = _read(ctr.load_problem, Path(folder, "problem.toml"))
        return "refused" if problem is None else _solve(problem)


def _read(reader, path):
    try:
        return reader(path)
    except ctr.DefinitionError as error:
        message = str(error)
        assert 0 < len(message) <= LONGEST_MESSAGE, message
        assert "\n" not in message, message
        return None


def _solve(problem):
    configuration = ctr.ForwardProblem(problem.robot).check(problem.actuation, problem.loads)
    if len(configuration.mesh()) > SMALL:
        return "too large to solve"
    try:
        shape = problem.solve(throw=False)
    except ctr.DefinitionError:
        return "refused by the solver"
    if not shape.converged:
        assert shape.message
        return shape.status.name
    assert np.all(np.isfinite(shape.position(shape.arc_length)))
    assert shape.discretization_error <= problem.solver.get("tolerance", 1e-7) * shape.length
    problem.deviations(shape)
    return "solved"


def fuzz(count, seeded):
    """What became of ``count`` files, how many of each, and the seconds of each file."""
    outcomes, seconds = Counter(), []

    @seed(seeded)
    @settings(max_examples=count, deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(st.one_of(damaged(), stretched(), rebuilt()))
    def every(files):
        begin = perf_counter()
        outcomes[check(files)] += 1
        seconds.append(perf_counter() - begin)

    every()
    return outcomes, seconds
