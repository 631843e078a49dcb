"""Force problems in files: they are what their truth gives, estimates meet it, the command, wrong files."""

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import ctr_opt as ctr
from benchmarks.force_data import FILES, points, tip
from ctr_opt.cli import cli
from ctr_opt.force_files import load_force_problem

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
    kind = ctr.PositionMeasurement if file.parent.name == "force_tip" else ctr.BackboneMeasurement
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
    (line,) = re.findall(r"force\.x +(.*)", result.output)
    assert float(line.split()[0]) == pytest.approx(found.values["force.x"], rel=1e-3)


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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace('kind = "tip_force"', 'kind = "tip_push"'), "unknown[0].kind = 'tip_push' must be"),
        (lambda text: text.replace('sigma = "0.2 mm"', 'sigma = "0.2 N"'), "measurements[0].sigma"),
        (lambda text: text.replace('"points.csv"', '"nothing.csv"'), "nothing.csv"),
        (lambda text: text.replace('sigma = "0.2 mm"', 'sigma = "0.2 mm"\nordered = true'), "ordered is for points"),
        (lambda text: text.replace("[-0.3, -0.2, -0.1]", "[-0.3, -0.2]"), "rotations has 3 entries"),
        (lambda text: text.replace("[-0.3, -0.2, -0.1]", "[-0.35, -0.2, -0.1]"), "is at s ="),
    ],
)
def test_wrong_files_are_told_in_a_sentence(tmp_path, change, message):
    source = Path("problems/force_tip")
    robot = Path("problems/three_tubes/robot_b.toml").read_text("utf-8")
    (tmp_path / "robot.toml").write_text(robot, "utf-8")
    (tmp_path / "points.csv").write_text((source / "points.csv").read_text("utf-8"), "utf-8")
    text = (source / "problem.toml").read_text("utf-8").replace("../three_tubes/robot_b.toml", "robot.toml")
    (tmp_path / "problem.toml").write_text(change(text), "utf-8")
    result = CliRunner().invoke(cli, ["estimate", str(tmp_path / "problem.toml")])
    assert result.exit_code == 2
    assert message in str(result.exception) + result.output
