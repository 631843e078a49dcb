"""Plans of experiments: that of the paper on RJW-S1, and what a plan's files may say."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import ctr_opt as ctr
from ctr_opt.cli import cli
from ctr_opt.files.plans import find_plans
from ctr_opt.files.problem import find_problems
from tests.support.paper_tips import paper_equilibrium

FOLDER = Path("problems/rjw_s1")
PLAN = ctr.load_plan(FOLDER / "plan.toml")
CASES = {f"{k}": problem for k, problem in enumerate(PLAN.problems, start=1)}


# -- the paper's plan --------------------------------------------------------------------------------------------------


def test_the_plan_is_the_papers():
    assert len(PLAN.problems) == 80
    D = -1e3 * np.array([problem.actuation.translations for problem in PLAN.problems]).reshape(5, 8, 2, 2)
    alpha = np.rad2deg([problem.actuation.rotations for problem in PLAN.problems]).reshape(5, 8, 2, 2)
    np.testing.assert_allclose(D[..., 1], 30.7, rtol=1e-15)
    assert np.all(alpha[..., 1] == 0.0)
    expected = np.tile([[222.7], [199.7], [176.7], [154.7], [131.7]], (1, 8))
    expected[4, 6] = 130.7
    np.testing.assert_allclose(D[..., 0], np.repeat(expected[..., None], 2, axis=2), rtol=1e-15)
    angles = np.tile(np.arange(0.0, 360.0, 45.0), (5, 1))
    angles[4, 1] = 60.0
    np.testing.assert_allclose(alpha[..., 0], np.repeat(angles[..., None], 2, axis=2), rtol=1e-15)


def test_every_second_experiment_is_loaded_in_a_direction_of_its_own():
    assert not any(problem.loads for problem in PLAN.problems[::2])
    forces = np.array([problem.loads[0].force for problem in PLAN.problems[1::2]])
    sizes = np.linalg.norm(forces, axis=1)
    expected = np.repeat([4.905, 1.962, 1.962, 0.981, 0.981], 8)
    expected[0] = 1.962
    np.testing.assert_allclose(sizes, expected, atol=1e-6)  # components are written with six decimals
    directions = forces / sizes[:, None]
    apart = np.arccos(np.clip(directions @ directions.T, -1.0, 1.0)) + 10.0 * np.eye(40)
    assert np.rad2deg(apart.min()) > 4.0


@pytest.mark.parametrize("case", CASES)
def test_case_is_solved_as_expected(case):
    result = CASES[case].solve()
    ((deviation, allowed),) = CASES[case].deviations(result).values()
    assert deviation <= allowed
    # the default tolerance bounds estimate and shape by 1e-7 of the length
    assert deviation <= 1e-7 * result.length
    assert result.verify() <= 1e-7 * result.length


@pytest.mark.parametrize("case", [str(case) for case in range(2, 81, 13)])
def test_minimum_energy_finds_the_same_stable_shape(case):
    result = CASES[case].with_solver({"formulation": "energy"}).solve()
    ((deviation, allowed),) = CASES[case].deviations(result).values()
    assert deviation <= allowed
    assert result.stability_checked


@pytest.mark.parametrize("case", ["10", "30", "56", "78"])
def test_expected_tip_is_that_of_the_papers_equations(case):
    """Near the snap, in the middle, Fig. 9, and the paper's outlier."""
    problem = CASES[case]
    tip, *_ = paper_equilibrium(problem.robot, problem.actuation, problem.loads)
    # The same computation on another machine: integration to 1e-12, amplified along the robot by at most ten or so.
    np.testing.assert_allclose(problem.expected["tip_position"], tip, atol=1e-11)


def test_the_plan_holds_the_experiment_of_figure_9():
    for case, name in (("55", "fig9_unloaded"), ("56", "fig9_loaded")):
        figure = ctr.load_problem(FOLDER / f"{name}.toml")
        np.testing.assert_allclose(CASES[case].actuation.rotations, figure.actuation.rotations, rtol=1e-15)
        assert CASES[case].loads == figure.loads
        np.testing.assert_allclose(CASES[case].expected["tip_position"], figure.expected["tip_position"], atol=1e-13)


# -- the command line --------------------------------------------------------------------------------------------------


def written(folder, table=None, toml=""):
    """A small plan of the first cases of the paper's."""
    lines = (FOLDER / "plan.csv").read_text("utf-8").splitlines()[:4] if table is None else table
    (folder / "plan.csv").write_text("\n".join(lines))
    (folder / "robot.toml").write_text((FOLDER / "robot.toml").read_text("utf-8"))
    (folder / "plan.toml").write_text(toml or (FOLDER / "plan.toml").read_text("utf-8"))
    return folder / "plan.toml"


def run(*arguments):
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


def test_solve_prints_a_line_for_each_case_and_sums_up(tmp_path):
    result = run("solve", written(tmp_path), "--verify")
    assert result.exit_code == 0, result.output
    assert result.output.count("verified to") == 3
    assert "37.125928" in result.output
    assert "3 of 3 solved" in result.output
    assert "3 of 3 as expected" in result.output


def test_a_case_that_is_not_as_expected_ends_with_code_1(tmp_path):
    path = written(tmp_path)
    table = tmp_path / "plan.csv"
    table.write_text(table.read_text().replace("1.584125", "1.6"))
    result = run("solve", path)
    assert result.exit_code == 1
    assert "NOT AS EXPECTED" in result.output
    assert "2 of 3 as expected" in result.output


def test_a_case_that_is_not_solved_is_reported_and_the_others_go_on(tmp_path):
    # Pressed at a hundred times its critical load, shooting alone ends at the first bifurcation.
    rod = Path("problems/single_rod/straight_rod.toml").read_text("utf-8")
    plan = 'title = "rods"\nrobot = "rod.toml"\ncases = "plan.csv"\n[source]\ntext = "made up"\n'
    table = ["rotation_0, translation_0, force_x, force_y, force_z", "0, 0, 0, 0, -500", "0, 0, 1, 0, 0"]
    path = written(tmp_path, table, plan)
    (tmp_path / "rod.toml").write_text(rod)
    result = run("solve", path, "--formulation", "equilibrium")
    assert result.exit_code == 1
    assert "1 of 2 solved" in result.output
    assert "expected" not in result.output


def test_list_and_check_know_plans(tmp_path):
    assert find_plans("problems") == [FOLDER / "plan.toml"]
    assert FOLDER / "plan.toml" not in find_problems("problems")
    listed = run("list", FOLDER).output
    assert "RJW-S1, the plan of experiments" in listed
    assert "shot from straight tubes" in listed
    assert "80 cases, 40 of them loaded, lengths 105.900 to 197.900 mm" in run("check", FOLDER / "plan.toml").output


def test_a_plan_is_not_written_as_one_shape(tmp_path):
    for option in ("--output", "--figure"):
        result = run("solve", FOLDER / "plan.toml", option, tmp_path / ("a.csv" if option == "--output" else "a.png"))
        assert result.exit_code == 2
        assert "many shapes" in result.stderr


# -- wrong files -------------------------------------------------------------------------------------------------------


HEADER = "rotation_0,rotation_1,translation_0,translation_1,force_x,force_y,force_z,tip_x,tip_y,tip_z"
ROW = "0,0,-0.2,-0.03,0,0,0,0,0,0.1"
TOML = (FOLDER / "plan.toml").read_text("utf-8")


@pytest.mark.parametrize(
    ("table", "toml", "words"),
    [
        (
            [HEADER, ROW, ROW.replace("-0.2", "far")],
            "",
            ["plan.csv: line 3, column 'translation_0': 'far' must be"],
        ),
        ([HEADER, ROW.replace("-0.2", "nan")], "", ["line 2, column 'translation_0': 'nan' must be a finite"]),
        ([HEADER, "", "# a comment", ROW + ",1"], "", ["line 4 has 11 entries, but must have 10"]),
        ([HEADER, ROW.replace("-0.2", "0.2")], "", ["plan.csv: line 2: translations[0] = 0.2 m", "at most 0"]),
        ([HEADER, ROW.replace("-0.2", "-0.5")], "", ["plan.csv: line 2", "behind the entry"]),
        ([HEADER.replace("tip_z", "tipz"), ROW], "", ["plan.csv: unknown column 'tipz'", "tip_z"]),
        ([HEADER.replace("tip_z", "tip_y"), ROW], "", ["column 'tip_y' is given twice"]),
        ([HEADER.removesuffix(",tip_z"), ROW.removesuffix(",0.1")], "", ["plan.csv: column 'tip_z' is missing"]),
        ([HEADER], "", ["plan.csv must contain a line of column names (rotation_0, "]),
        ([HEADER, ROW], TOML.replace("plan.csv", "none.csv"), ["none.csv cannot be read"]),
        ([HEADER, ROW], TOML.replace("20 nm", "0 m"), ["expected: position_tolerance = 0", "above 0"]),
        ([HEADER, ROW], TOML.replace('position_tolerance = "20 nm"', ""), ["expected.position_tolerance is missing"]),
        ([HEADER, ROW], TOML + "[solver]\ntolerance = 1.0\n", ["plan.toml: solver: tolerance = 1 must be"]),
        ([HEADER, ROW], TOML.replace("cases =", "case ="), ["unknown key 'case'; did you mean 'cases'"]),
    ],
)
def test_wrong_plans_are_refused(tmp_path, table, toml, words):
    with pytest.raises(ctr.DefinitionError) as reported:
        ctr.load_plan(written(tmp_path, table, toml))
    for word in words:
        assert word in str(reported.value)


def test_columns_may_stand_in_any_order(tmp_path):
    header, *rows = [line.split(",") for line in (FOLDER / "plan.csv").read_text("utf-8").splitlines()[:4]]
    turned = [" , ".join(reversed(line)) for line in (header, *rows)]
    plan = ctr.load_plan(written(tmp_path, turned))
    for found, expected in zip(plan.problems, PLAN.problems, strict=False):
        assert found.actuation == expected.actuation
        assert found.loads == expected.loads
        assert found.expected == expected.expected


def test_a_plan_is_no_problem():
    with pytest.raises(ctr.DefinitionError, match=r"plan\.toml is a plan of many cases: read it with load_plan"):
        ctr.load_problem("problems/rjw_s1/plan.toml")


@pytest.mark.parametrize("kind", ["problem", "plan"])
def test_strict_checks_reach_the_robot_of_a_problem_and_a_plan(kind, tmp_path):
    for name in ("robot.toml", "plan.toml", "plan.csv", "fig9_loaded.toml"):
        (tmp_path / name).write_bytes(Path("problems/rjw_s1", name).read_bytes())
    robot = tmp_path / "robot.toml"
    robot.write_text(robot.read_text().replace('outer_diameter = "1.75 mm"', 'outer_diameter = "2.1 mm"'))
    file = str(tmp_path / ("plan.toml" if kind == "plan" else "fig9_loaded.toml"))
    done = CliRunner().invoke(cli, ["check", "--strict", file])
    assert done.exit_code == 2
    assert "does not fit into" in done.output
