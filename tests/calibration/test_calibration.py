"""Calibration: derivatives, both ways to an answer, what data determine, tables, the report and the command."""

import numpy as np
import pytest

import ctr_opt as ctr
from benchmarks.calibration_data import PLACES, checks, experiments, true_robot
from benchmarks.synthetic import synthetic_experiments
from ctr_opt.calibration.estimation import Estimation
from ctr_opt.files.calibration import load_calibration
from ctr_opt.files.experiments import read_experiments, write_experiments
from tests.support.slow import some_slow

pytestmark = pytest.mark.usefixtures("compiling")

FILE = "problems/rjw_s1/calibration.toml"
NOISE = 0.2e-3
STIFFNESSES = [f"tubes[{i}].{kind}_stiffness" for kind in ("bending", "torsional") for i in (0, 1)]


@pytest.fixture(scope="module")
def given():
    return load_calibration(FILE)


@pytest.fixture(scope="module")
def cases():
    return [(each.actuation, each.loads) for each in ctr.load_plan("problems/rjw_s1/plan.toml").problems]


def flat(fit):
    return np.concatenate([np.ravel(value) for value in fit.values.values()])


@pytest.mark.parametrize("compiled", some_slow([None, False], [None]), ids=["default", "virtual machine"])
def test_slopes_against_differences(given, cases, compiled):
    """Of misfit and residual by all that acts, away from the solution; differences are good to 1e-8 of the largest."""
    names = [
        *given.parameters,
        "tubes[0].rotation_offset",
        "tubes[1].translation_offset",
        "tubes[0].precurvature[1].coefficients",
    ]
    made = synthetic_experiments(given.robot, cases[8:12], PLACES, sigma=NOISE, seed=1)
    estimation = Estimation(given.robot, made, names, "squared", 1e-9, compiled)
    x = estimation.unknowns.initial
    equilibria = estimation.equilibria(x)
    estimation.prepare(equilibria)
    moments = [1.02 * each.unknowns + 1e-5 for each in equilibria]
    x = x + 0.01 * estimation.unknowns.scale * np.linspace(-1.0, 1.0, len(x))
    reported = estimation.linearize(x, moments)
    for k in range(len(x)):
        h = np.zeros(len(x))
        h[k] = 1e-6 * estimation.unknowns.scale[k]
        after, before = estimation.linearize(x + h, moments), estimation.linearize(x - h, moments)
        for layout, one, a, b in zip(estimation.layouts, reported, after, before, strict=True):
            (column,) = np.flatnonzero(layout.acting == k)
            for field in ("misfit", "residual"):
                expected = (getattr(a, field) - getattr(b, field)) / (2.0 * h[k])
                found = getattr(one, f"{field}_x")[:, column]
                np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(getattr(one, f"{field}_x")).max())


def test_compiled_and_symbolic_models_agree(given, cases):
    made = synthetic_experiments(given.robot, cases[30:36], PLACES, sigma=NOISE, seed=2)
    found = []
    for compiled in (None, False):
        estimation = Estimation(given.robot, made, given.parameters, "squared", 1e-9, compiled)
        equilibria = estimation.equilibria(estimation.unknowns.initial)
        estimation.prepare(equilibria)
        found.append(estimation.linearize(estimation.unknowns.initial, [each.unknowns for each in equilibria]))
    for a, b in zip(*found, strict=True):
        np.testing.assert_allclose(a.misfit, b.misfit, atol=1e-4)  # 1e-9 of 0.2 m, in units of 0.2 mm, and more
        np.testing.assert_allclose(a.reduced, b.reduced, rtol=1e-5, atol=1e-5 * np.abs(b.reduced).max())


def test_exact_data_give_the_truth(given, cases):
    made = synthetic_experiments(true_robot(given), cases[::3], PLACES, sigma=1e-9, seed=4)
    made = [
        ctr.Experiment(
            e.actuation, e.loads, [ctr.PositionMeasurement(m.arc_length, m.position, 1e-4) for m in e.measurements]
        )
        for e in made
    ]
    fit = ctr.CalibrationProblem(given.robot, made, given.parameters, tolerance=1e-9).solve()
    for name, value in given.truth["values"].items():
        np.testing.assert_allclose(fit.values[name], value, rtol=1e-4, atol=1e-7)


def test_the_data_are_what_their_truth_gives(given, tmp_path):
    made = experiments(given, ctr.load_plan("problems/rjw_s1/plan.toml"))
    write_experiments(tmp_path / "again.csv", made)
    again = read_experiments(tmp_path / "again.csv", 2, sigma=NOISE)
    for a, b in zip(again, given.experiments, strict=True):
        np.testing.assert_allclose(
            a.measurements[0].position, b.measurements[0].position, atol=2e-7
        )  # 0.1 um is written
        np.testing.assert_allclose(a.actuation.rotations, b.actuation.rotations, atol=1e-12)
    np.testing.assert_allclose(checks(given)[0], given.checks[0].tip_position, atol=1e-7)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("rotation_0 [deg]", "rotation_0 [mm]"), "must be an angle"),
        (lambda text: text.replace("tip_x [mm]", "top_x [mm]"), "unknown column 'top_x .mm.'"),
        (lambda text: text.replace("case 1,0,0", "case 1,zero,0"), "line 3, column 'rotation_0': 'zero' must be"),
    ],
)
def test_wrong_tables(tmp_path, given, change, message):
    file = tmp_path / "table.csv"
    file.write_text(change(given.table.read_text("utf-8")), "utf-8")
    with pytest.raises(ctr.DefinitionError, match=message):
        read_experiments(file, 2, sigma=NOISE)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda e: {"parameters": ["tubes[0].bending"]}, r"is not a parameter \(did you mean"),
        (lambda e: {"parameters": []}, "at least one parameter"),
        (lambda e: {"loss": "l1"}, "loss = 'l1' must be"),
        (lambda e: {"experiments": []}, "at least one experiment"),
        (lambda e: {"parameters": ["tubes[5].rotation_offset"]}, "the robot has 2 tubes"),
    ],
)
def test_wrong_problems(given, make, message):
    arguments = {"experiments": given.experiments[:2], "parameters": ["base.rotation"], "loss": "squared"} | make(None)
    with pytest.raises(ctr.DefinitionError, match=message):
        ctr.CalibrationProblem(given.robot, arguments["experiments"], arguments["parameters"], loss=arguments["loss"])
