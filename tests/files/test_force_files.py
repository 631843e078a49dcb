"""Force problems in files: they are what their truth gives, estimates meet it, the command, wrong files."""

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import ctr_opt as ctr
from benchmarks.force_data import FILES, points, tip
from ctr_opt.cli import cli
from ctr_opt.files.force import load_force_problem

pytestmark = pytest.mark.usefixtures("compiling")


def measured(given, kind):
    return next(each for each in given.measurements if isinstance(each, kind))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.parent.name)
def test_the_data_are_what_their_truth_gives(file):
    given = load_force_problem(file)
    if file.parent.name == "force_ill_posed":
        position, direction = tip(file)
        np.testing.assert_allclose(measured(given, ctr.PositionMeasurement).position[0], position, atol=1e-7)
        np.testing.assert_allclose(measured(given, ctr.TangentMeasurement).direction, direction, atol=1e-7)
        return
    kind = ctr.BackboneMeasurement if file.parent.name == "force_contact" else ctr.PositionMeasurement
    np.testing.assert_allclose(measured(given, kind).position, points(file)[1], atol=1e-7)  # 0.1 um is written


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.parent.name)
def test_the_command_prints_what_is_expected(file, tmp_path):
    figure = tmp_path / "figure.png"
    result = CliRunner().invoke(cli, ["estimate", str(file), "--figure", str(figure)])
    assert result.exit_code == 0, result.output
    assert "NOT AS EXPECTED" not in result.output
    assert figure.read_bytes().startswith(b"\x89PNG")
    given = load_force_problem(file)
    found = given.solve()
    assert len(given.verdicts(found)) == result.output.count("as expected")
    assert len(given.verdicts(found)) >= 2 if file.parent.name != "force_ill_posed" else 1
    if found.distributed:
        (line,) = re.findall(r"at    0\.0 mm +(.*)", result.output)
        expected = found.density(0.0)[0][0]
    else:
        (line,) = re.findall(r"force\.x +(.*)", result.output)
        expected = found.values["force.x"]
    assert float(line.split()[0]) == pytest.approx(expected, rel=2e-3)


def test_what_a_straight_rod_hides_is_named():
    found = load_force_problem("problems/force_ill_posed/problem.toml").solve()
    assert [text.split(":")[0] for text in found.undetermined] == ["axial force"]
    assert found.axes[2].standard_deviation > 3.0 * found.characteristic_force
    across = [axis.standard_deviation for axis in found.axes[:2]]
    rod = load_force_problem("problems/force_ill_posed/problem.toml").problem.robot.tubes[0]
    by_position, by_turn = rod.length**3 / 3.0 / 2e-4, rod.length**2 / 2.0 / 0.01  # of a cantilever, over sigma
    np.testing.assert_allclose(across, rod.bending_stiffness / np.hypot(by_position, by_turn), rtol=1e-3)


def test_a_shape_that_no_force_explains_is_not_consistent():
    """The base stood 1 mm beside where it is believed to be."""
    given = load_force_problem("problems/force_tip/problem.toml")
    seen = measured(given, ctr.PositionMeasurement)
    shifted = ctr.PositionMeasurement(seen.arc_length, seen.position + np.array([1e-3, 0.0, 0.0]), seen.sigma)
    found = given.problem.solve(given.actuation, [shifted])
    assert found.consistent is False
    assert "NOT CONSISTENT" in found.report()


UNKNOWN = {
    'kind = "tip_wrench"\n'
    'prior = { force_sigma = "1 N", moment_mean = "1 mN*m", moment_sigma = ["1 mN*m", 0.002, 0.003] }': (
        ctr.TipWrench(prior=([0.0] * 3 + [1e-3] * 3, [1.0] * 3 + [1e-3, 2e-3, 3e-3]))
    ),
    'kind = "point_force"\narc_length = "12 cm"\ntube = "inner"\nnormal = [0, 2, 0]\nfriction = 0.3': ctr.PointForce(
        0.12, 0, normal=[0.0, 1.0, 0.0], friction=0.3
    ),
    'kind = "contacts"\nmost = 2\nprior = { mean = 0.0, sigma = "1 N" }': ctr.Contacts(2, prior=(0.0, 1.0)),
    'kind = "distributed_force"\ncoefficients = 8\nend = "100 mm"\nsmoothness = 1e-3\n'
    'prior = { mean = 0, sigma = "5 N/m" }': ctr.DistributedForce(8, end=0.1, smoothness=1e-3, prior=(0.0, 5.0)),
}


@pytest.mark.parametrize("text", UNKNOWN, ids=lambda text: text.split('"')[1])
def test_every_unknown_load_can_be_written(tmp_path, text):
    read = load_force_problem(written(tmp_path, lambda whole: whole.replace('kind = "tip_force"', text)))
    (found,), expected = read.problem.unknown, UNKNOWN[text]
    assert type(found) is type(expected)
    for field in expected.__attrs_attrs__:
        name = field.name
        np.testing.assert_equal(getattr(found, name), getattr(expected, name), err_msg=name)


def test_a_pose_of_the_tip_can_be_written(tmp_path):
    """With standard deviations of position and turn in their units."""
    pose = 'kind = "tip_pose"\npose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.163], [0, 0, 0, 1]]\n'
    text = pose + 'position_sigma = "0.2 mm"\nrotation_sigma = ["1 deg", "1 deg", "5 deg"]\ntube = "inner"'
    points = 'kind = "points"\nfile = "points.csv"\nsigma = "0.2 mm"'
    (seen,) = load_force_problem(written(tmp_path, lambda whole: whole.replace(points, text))).measurements
    np.testing.assert_array_equal(seen.pose[:3, 3], [0.0, 0.0, 0.163])
    np.testing.assert_allclose(np.diag(seen.whitener[0]), [5e3] * 3 + [180.0 / np.pi] * 2 + [36.0 / np.pi], rtol=1e-12)
    assert seen.tube == 0


def written(folder, change=lambda text: text):
    """A problem's file in a folder, with its robot and table."""
    source = Path("problems/force_tip")
    robot = Path("problems/three_tubes/robot_b.toml").read_text("utf-8")
    (folder / "robot.toml").write_text(robot, "utf-8")
    (folder / "points.csv").write_text((source / "points.csv").read_text("utf-8"), "utf-8")
    text = (source / "problem.toml").read_text("utf-8").replace("../three_tubes/robot_b.toml", "robot.toml")
    (folder / "problem.toml").write_text(change(text), "utf-8")
    return folder / "problem.toml"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace('kind = "tip_force"', 'kind = "tip_push"'), "unknown[0].kind = 'tip_push' must be"),
        (lambda text: text.replace('"tip_force"', '"contacts"\nmost = 0'), "unknown[0]: most = 0 must be"),
        (lambda text: text.replace('"tip_force"', '"contacts"\nmost = 1.5'), "unknown[0].most"),
        (
            lambda text: text.replace('"tip_force"', '"point_force"\nnormal = [0, 0, 0]\narc_length = 0.1'),
            "unknown[0]: normal = [0.0, 0.0, 0.0] is zero, but must be a direction",
        ),
        (
            lambda text: text.replace('"tip_force"', '"distributed_force"\ncoeficients = 8'),
            "did you mean 'coefficients'",
        ),
        (lambda text: text.replace('"tip_force"', '"distributed_force"\nend = "30 cm"'), "which ends at 0.163 m"),
        (lambda text: text.replace('sigma = "0.2 mm"', 'sigma = "0.2 N"'), "measurements[0].sigma"),
        (lambda text: text.replace('"points.csv"', '"nothing.csv"'), "nothing.csv"),
        (lambda text: text.replace('sigma = "0.2 mm"', 'sigma = "0.2 mm"\nordered = true'), "ordered is for unknown"),
        (lambda text: text.replace("[-0.3, -0.2, -0.1]", "[-0.3, -0.2]"), "rotations has 3 entries"),
        (lambda text: text.replace("[-0.3, -0.2, -0.1]", "[-0.35, -0.2, -0.1]"), "is at s ="),
    ],
)
def test_wrong_files_are_reported_in_a_sentence(tmp_path, change, message):
    result = CliRunner().invoke(cli, ["estimate", str(written(tmp_path, change))])
    assert result.exit_code == 2
    assert message in str(result.exception) + result.output
