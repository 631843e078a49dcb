from pathlib import Path

import pytest

import ctr_opt as ctr
from ctr_opt.files import find_problems

ROOT = Path(__file__).parent.parent / "problems"


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
