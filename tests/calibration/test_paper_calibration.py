"""The paper's calibration on synthetic data, as a whole: objective, parameters, outlier, prediction, page, command."""

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import ctr_opt as ctr
from ctr_opt.cli import cli
from ctr_opt.estimation.losses import SMOOTHING
from ctr_opt.files.calibration import load_calibration
from ctr_opt.robot.names import robot_with

pytestmark = pytest.mark.usefixtures("compiling")

FILE = "problems/rjw_s1/calibration.toml"
OUTLIER = 77


@pytest.fixture(scope="module")
def given():
    return load_calibration(FILE)


@pytest.fixture(scope="module")
def fits(given):
    return {loss: given.problem(loss).solve() for loss in given.losses}


def misses(robot, experiments):
    """Predicted minus measured points ``(experiments, 3, 3)``, m, from forward solves alone."""
    problem = ctr.ForwardProblem(robot, tolerance=1e-9, compiled=True)
    found = []
    for each in experiments:
        shape = problem.solve(each.actuation, each.loads)
        end = robot.tubes[1].length + each.actuation.translations[1]
        points = np.array([shape.position(0.0), shape.position(end), shape.tip_position])
        found.append(points - each.measurements[0].position)
    return np.array(found)


def distances(robot, experiments, sigma):
    """The paper's objective: the sum of distances, smoothed, in root-mean-square standard deviations."""
    squares = (misses(robot, experiments) ** 2).sum(axis=-1) / np.mean(np.square(sigma))
    return float((np.sqrt(squares + SMOOTHING**2) - SMOOTHING).sum())


def test_the_sum_of_distances_is_least(given, fits):
    """The loss of the fit is that of plain solves (1e-7 of the length is 0.06 of 1e-3 deviations, 240 points), and any
    step of half a standard error from it costs more."""
    fit, sigma = fits["distance"], given.sigma["position"]
    least = distances(fit.robot, given.experiments, sigma)
    assert fit.objective == pytest.approx(least, abs=2e-3)
    rng = np.random.default_rng(3)
    steps = rng.normal(size=(3, len(fit.labels)))
    steps = 0.5 * steps * fit.deviations / np.linalg.norm(steps, axis=1, keepdims=True) * np.sqrt(len(fit.labels))
    for step in steps:
        for sign in (-1.0, 1.0):
            x = fit.estimates + sign * step
            robot = robot_with(given.robot, fit.estimation.unknowns.robot_numbers(x))
            assert distances(robot, given.experiments, sigma) > least


def test_distances_are_not_misled(given, fits):
    """Each within four of its standard errors of the truth, in spite of the outlier."""
    fit = fits["distance"]
    assert fit.outliers == [OUTLIER]
    truth = fit.estimation.unknowns
    true = np.concatenate([np.ravel(given.truth["values"][entry.name]) for entry in truth.entries])
    assert (np.abs(fit.estimates - true) < 4.0 * fit.deviations).all()


def test_squares_are_misled_and_say_so(given, fits):
    """The mistyped case is found; the noise level rejected; without it, neither, and the truth is met."""
    fit = fits["squared"]
    assert OUTLIER in fit.outliers
    assert int(np.argmax(fit.influence)) == OUTLIER
    assert not fit.noise_accepted
    rest = fit.without(OUTLIER)
    assert rest.noise_accepted
    assert rest.outliers == []
    true = np.concatenate([np.ravel(given.truth["values"][entry.name]) for entry in fit.estimation.unknowns.entries])
    normalized = np.linalg.solve(rest.covariance, rest.estimates - true) @ (rest.estimates - true)
    assert normalized < 29.6  # chi-square of ten numbers: 99.9 %


def test_residuals_are_those_of_plain_solves(given, fits):
    found = misses(fits["squared"].robot, given.experiments)
    reported = np.array([each.value for each in fits["squared"].residuals]).reshape(found.shape)
    np.testing.assert_allclose(reported, found, atol=4e-8)  # 1e-7 of 0.2 m, twice


def numbers(line):
    return [float(x) for x in re.findall(r"-?\d+\.\d+", line)]


def test_the_command_writes_the_whole_page(given, fits, tmp_path):
    result = CliRunner().invoke(cli, ["calibrate", FILE, "--report", str(tmp_path / "report")])
    assert result.exit_code == 0, result.output
    page = (tmp_path / "report" / "report.md").read_text("utf-8")
    nominal = 1e3 * np.linalg.norm(misses(given.robot, given.experiments)[:, 2], axis=-1)
    lines = page.splitlines()
    (first, *_) = [line for line in lines if line.startswith("| tip |")]
    expected = [nominal.mean(), np.median(nominal), nominal.std(), nominal.min(), nominal.max()]
    np.testing.assert_allclose(numbers(first), expected, atol=0.0051)  # two digits are written
    assert f"{np.mean(nominal < 3.0):.0%} below 3 mm and {np.mean(nominal < 4.0):.0%} below 4 mm" in page
    for loss in fits:
        row = next(line for line in lines if line.startswith("| GJ_0"))
        error = fits[loss].standard_errors["tubes[0].torsional_stiffness"]
        assert f"{fits[loss].values['tubes[0].torsional_stiffness']:.5g} ± {error:.2g}" in row
        assert f"case {OUTLIER + 1}" in page[page.index("## Experiments that do not fit") :]
    assert "weighted least squares without case 78 |" in page
    assert "The given noise level is then accepted (p = 0.29)" in page
    assert "No number here or computed from these data is one that the paper measured" in page
    (check,) = [line for line in lines if line.startswith("| RJW-S1, nuts, spread out")]
    before, after = float(numbers(check)[0]), float(numbers(check)[2])
    assert after < 0.25 * before
    figures = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page)
    assert len(figures) == 3
    assert all((tmp_path / "report" / name).read_bytes().startswith(b"\x89PNG") for name in figures)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace('"calibration.csv"', '"nowhere.csv"'), "nowhere.csv"),
        (lambda text: text.replace('"distance", "squared"', '"l1"'), "losses = 'l1' must be"),
        (lambda text: text.replace('"base.rotation",\n', '"base.spin",\n'), "'base.spin' is not a parameter"),
        (lambda text: text.replace('"0.627 mm"', '"0.627 kg"'), "sigma.position"),
    ],
)
def test_wrong_files_are_reported_in_a_sentence(tmp_path, change, message):
    folder = tmp_path / "rjw"
    folder.mkdir()
    source = Path(FILE).parent
    for name in ("robot.toml", "calibration.csv", "nuts_distributed.toml"):
        (folder / name).write_text((source / name).read_text("utf-8"), "utf-8")
    (folder / "calibration.toml").write_text(change(Path(FILE).read_text("utf-8")), "utf-8")
    result = CliRunner().invoke(cli, ["calibrate", str(folder / "calibration.toml")])
    assert result.exit_code != 0
    assert message in str(result.exception) + result.output
