from pathlib import Path

import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.files.problem import find_problems
from tests.support.paper_tips import paper_equilibrium

ROOT = Path(__file__).parents[2] / "problems"


@pytest.mark.parametrize("path", find_problems(ROOT), ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_problem_is_solved_as_its_file_expects(path):
    problem = ctr.load_problem(path)
    assert problem.source
    assert problem.expected["text"]
    result = problem.solve()
    deviations = problem.deviations(result)
    assert deviations
    for name, (deviation, tolerance) in deviations.items():
        assert deviation <= tolerance, name
    # the default tolerance is 1e-7 of the length, for the estimate and so for the shape
    assert result.verify() <= 1e-7 * result.length


def test_every_robot_says_where_it_comes_from():
    import tomllib

    for path in ROOT.rglob("*.toml"):
        assert tomllib.loads(path.read_text("utf-8"))["source"]["text"], path


@pytest.mark.parametrize("name", ["fig9_unloaded", "fig9_loaded", "nuts_discrete", "nuts_distributed"])
def test_expected_values_of_rjw_s1_are_those_of_the_papers_equations(name):
    problem = ctr.load_problem(ROOT / "rjw_s1" / f"{name}.toml")
    values = paper_equilibrium(problem.robot, problem.actuation, problem.loads)
    # The same computation on another machine: integration to 1e-12, amplified along the robot by at most ten or so; the
    # direction is extrapolated over 2e-9 m at a curvature of 10 1/m.
    for key, value, atol in zip(
        ("tip_position", "tip_direction", "base_torsions"), values, (1e-11, 1e-9, 1e-9), strict=True
    ):
        np.testing.assert_allclose(problem.expected[key], value, atol=atol)


def test_the_nuts_weigh_what_the_paper_says():
    """Both ways to say it pull with 56.96 g."""
    for name in ("nuts_discrete", "nuts_distributed"):
        result = ctr.load_problem(ROOT / "rjw_s1" / f"{name}.toml").solve()
        # The nuts' masses are written with seven digits.
        np.testing.assert_allclose(result.internal_force(0.0), [-0.05696 * 9.81, 0.0, 0.0], atol=1e-7)


def test_a_file_of_a_user_needs_no_source(tmp_path):
    (tmp_path / "robot.toml").write_text((ROOT / "rjw_s1" / "robot.toml").read_text("utf-8"), "utf-8")
    (tmp_path / "problem.toml").write_text(
        'title = "mine"\nrobot = "robot.toml"\n[actuation]\nrotations = [0, 0]\ntranslations = [-0.1, -0.03]\n', "utf-8"
    )
    problem = ctr.load_problem(tmp_path / "problem.toml")
    assert (problem.source, problem.does_not_claim) == ("", "")
    assert problem.solve().converged
