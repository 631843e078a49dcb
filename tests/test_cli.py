import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from ctr_opt.cli import cli

PROBLEM = "problems/rjw_s1/fig9_loaded.toml"


def run(*arguments):
    return CliRunner().invoke(cli, arguments)


def test_solve_prints_a_report():
    result = run("solve", PROBLEM, "--verify")
    assert result.exit_code == 0, result.output
    for word in (
        "status", "converged", "path", "homotopy", "iterations", "set-up", "solve", "residual", "discretization error",
        "tip position", "tip direction", "angle at its tip", "base torsion", "base moment", "elastic energy",
        "work of the loads", "verified", "as expected",
    ):  # fmt: skip
        assert word in result.output, word
    assert "-4.800681" in result.output  # mm: the x coordinate that the problem file expects
    assert "NOT" not in result.output


def test_solve_writes_shape_and_figure(tmp_path):
    shape, figure = tmp_path / "shape.csv", tmp_path / "shape.png"
    result = run("solve", PROBLEM, "--output", str(shape), "--figure", str(figure))
    assert result.exit_code == 0, result.output
    assert shape.read_text().startswith("s,position_x")
    assert figure.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("formulation", ["automatic", "equilibrium", "energy"])
def test_solve_by_every_formulation(formulation):
    result = run("solve", PROBLEM, "--formulation", formulation)
    assert result.exit_code == 0, result.output
    assert "NOT" not in result.output


def test_list_shows_source_and_expected_value():
    result = run("list")
    assert result.exit_code == 0
    for word in ("rjw_s1/fig9_loaded.toml", "source: ", "expected: ", "Three tubes, A4"):
        assert word in result.output


def test_list_goes_on_past_files_it_cannot_read(tmp_path):
    assert "no problem files" in run("list", str(tmp_path)).output
    (tmp_path / "broken.toml").write_text("[[")
    (tmp_path / "blog.toml").write_text('title = "x"')
    (tmp_path / "wrong.toml").write_text('title = "x"\nrobot = "none.toml"')
    (tmp_path / "folder.toml").mkdir()
    result = run("list", str(tmp_path))
    assert result.exit_code == 0
    assert "wrong.toml" in result.output
    assert "not readable" in result.output


def test_an_answer_that_is_not_as_expected_ends_with_code_1(tmp_path):
    folder = Path("problems/single_rod")
    text = (folder / "cantilever.toml").read_text().replace("20 N", "21 N")
    (tmp_path / "problem.toml").write_text(text)
    (tmp_path / "straight_rod.toml").write_text((folder / "straight_rod.toml").read_text())
    result = run("solve", str(tmp_path / "problem.toml"))
    assert result.exit_code == 1
    assert "NOT AS EXPECTED" in result.output


def test_check_says_what_a_file_holds():
    result = run("check", "problems/rjw_s1/robot.toml")
    assert result.exit_code == 0
    assert "Robot of 2 tubes" in result.output
    assert "length 173.900 mm, 1 load" in run("check", PROBLEM).output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("solve", "none.toml"), "none.toml cannot be read"),
        (("solve", PROBLEM, "--output", "shape.xyz"), "must end in .csv, .npz, .json"),
        (("solve", PROBLEM, "--figure", "nowhere/shape.png"), "does not exist"),
        (("check", "problems"), "cannot be read"),
        (("list", "nowhere"), "the folder 'nowhere' does not exist"),
        (
            ("check", "problems/rjw_s1/calibration.toml"),
            "unknown key 'experiments'; this is a calibration file: run `ctr-opt calibrate "
            "problems/rjw_s1/calibration.toml`",
        ),
        (
            ("solve", "problems/force_tip/problem.toml"),
            "unknown key 'measurements'; this is a force file: run `ctr-opt estimate problems/force_tip/problem.toml`",
        ),
    ],
)
def test_wrong_input_ends_with_a_sentence_and_code_2(arguments, words):
    result = run(*arguments)
    assert result.exit_code == 2
    assert words in result.stderr
    assert "Traceback" not in result.output


def test_a_failed_solve_ends_with_code_1(tmp_path):
    folder = Path("problems/single_rod")
    pressed = (folder / "cantilever.toml").read_text().replace('["20 N", 0.0, 0.0]', '[0.0, 0.0, "-20 N"]')
    (tmp_path / "problem.toml").write_text(pressed)
    (tmp_path / "straight_rod.toml").write_text((folder / "straight_rod.toml").read_text())
    # beyond Euler's load the straight branch has bifurcated, and shooting alone knows no way off it
    result = run("solve", str(tmp_path / "problem.toml"), "--formulation", "equilibrium")
    assert result.exit_code == 1
    assert "no equilibrium found" in result.stderr
    assert "What to do" in result.stderr
    assert "at 0.246" in result.stderr  # where Euler's load, 2.4674 EI/L^2, is reached on the way to 10 EI/L^2


def test_runs_as_a_module_and_prints_nothing_of_its_own():
    command = [sys.executable, "-c", "import ctr_opt as c; c.load_problem('problems/rjw_s1/fig9_loaded.toml').solve()"]
    silent = subprocess.run(command, capture_output=True, text=True, check=True)
    assert silent.stdout == ""
    assert silent.stderr == ""
    module = subprocess.run([sys.executable, "-m", "ctr_opt", "list"], capture_output=True, text=True, check=True)
    assert "fig9_loaded" in module.stdout
    light = "import sys, ctr_opt; print([m for m in ('scipy', 'matplotlib', 'pint') if m in sys.modules])"
    loaded = subprocess.run([sys.executable, "-c", light], capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == "[]"  # the import stays quick because the heavy ones wait until they are needed
