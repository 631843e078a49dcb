"""The README and the docs tell the truth: their code runs, their files load, the modules they name are there."""

import re
from pathlib import Path

import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.files.calibration import load_calibration
from ctr_opt.files.force import load_force_problem

PAGES = (  # pieces of code one behind the other, each with what it prints
    "explanation/what_shape_tells",
    "how_to/control_loops_and_rates",
    "how_to/from_strains_to_force",
    "how_to/workspaces_and_batches",
    "start/first_shape",
    "start/from_points_to_force",
)


def blocks(path, language):
    return re.findall(rf"```{language}\n(.*?)```", Path(path).read_text("utf-8"), re.S)


def test_the_code_in_the_readme_runs(capsys):
    (code,) = blocks("README.md", "python")
    scope = {}
    exec(code, scope)
    assert "converged" in capsys.readouterr().out
    assert scope["pushed"].verify() < scope["pushed"].discretization_error


def test_the_table_of_the_experiments_is_what_its_code_prints(capsys):
    path = "docs/evidence/experiments.md"
    (code,) = blocks(path, "python")
    exec(code, {})
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 5
    for line in lines:
        assert line in Path(path).read_text("utf-8")


def test_the_commands_of_the_experiments_name_files_that_exist():
    words = " ".join(blocks("docs/evidence/experiments.md", "sh")).split()
    files = [word for word in words if "/" in word]
    assert len(files) > 5
    assert all(Path(file).exists() for file in files)


def test_the_code_of_the_transcriptions_runs():
    (code,) = blocks("docs/explanation/transcriptions.md", "python")
    scope = {}
    exec(code, scope)
    pose = ctr.Actuation([1.0, 0.0], [-0.1547, -0.0307])
    shapes = [scope[name].solve(pose) for name in ("by_default", "radau", "fifth")]
    for shape in shapes[1:]:
        assert abs(shape.tip_position - shapes[0].tip_position).max() < 2e-7 * shape.length


@pytest.mark.usefixtures("compiling")
def test_the_code_of_the_calibration_runs(capsys):
    scope = {}
    exec("".join(blocks("docs/how_to/calibration.md", "python")), scope)
    assert "sum of distances" in capsys.readouterr().out
    assert abs(scope["touch"].force).max() < 1e-6  # N: from a tip that nothing pushed
    assert scope["calibrated"].tubes[0].bending_stiffness == scope["fit"].values["tubes[0].bending_stiffness"]


def test_the_code_of_force_estimation_runs(capsys):
    (code,) = blocks("docs/how_to/force_estimation.md", "python")
    scope = {}
    exec(code, scope)
    assert "force.x" in capsys.readouterr().out
    apart = scope["pushed"].tip_position - scope["estimate"].shape.tip_position
    assert abs(apart).max() < 1e-7 * scope["pushed"].length


@pytest.mark.usefixtures("compiling")
@pytest.mark.parametrize("page", PAGES)
def test_pages_are_what_their_code_prints(page, capsys):
    path = f"docs/{page}.md"
    exec("".join(blocks(path, "python")), {})
    assert capsys.readouterr().out == "".join(blocks(path, "text"))


def test_the_code_of_the_force_stream_runs(capsys):
    (code,) = blocks("docs/how_to/force_stream.md", "python")
    scope = {}
    exec(code, scope)
    assert "used: force.x = " in capsys.readouterr().out
    assert (scope["lost"].deviations > scope["estimate"].deviations).all()
    assert abs(scope["estimate"].force - [0.05, 0.0, 0.0]).max() < 4.0 * scope["estimate"].deviations.max()


def test_the_file_of_a_calibration_loads(tmp_path):
    (text,) = blocks("docs/how_to/calibration.md", "toml")
    (tmp_path / "my_robot.toml").write_text(text)
    for name, source in (("robot.toml", "robot_b.toml"), ("tip_poses.csv", "tip_poses.csv")):
        (tmp_path / name).write_text(Path("problems/three_tubes", source).read_text("utf-8"))
    given = load_calibration(tmp_path / "my_robot.toml")
    assert (len(given.experiments), len(given.held)) == (800, 200)


def test_the_readme_has_exactly_two_commands():
    run, test = blocks("README.md", "sh")
    assert run.strip().endswith("ctr-opt solve problems/rjw_s1/fig9_loaded.toml")
    assert test.strip().endswith("pytest")


def _experiments():
    """A table of ten experiments with the columns that the calibration file of the page has standard deviations for."""
    names = ["rotation_0", "rotation_1", "translation_0", "translation_1"]
    names += [f"{what}_{axis}" for what in ("tip", "direction", "base_force", "base_moment") for axis in "xyz"]
    rows = [f"{k},0,-0.15,-0.03,0.05,0,0.15,0,0,1,0.1,0,0,0,0,0" for k in range(10)]
    return "\n".join([",".join(names), *rows, ""])


def test_the_files_in_the_docs_load(tmp_path):
    robot, problem, plan, calibration, force, unknown = blocks("docs/reference/files.md", "toml")
    second = robot[robot.index("[[tubes]]") :].replace("inner", "outer").replace("1.25 mm", "2 mm")
    second = second.replace("1.75 mm", "2.4 mm").replace('outer_diameter = "2 mm"', 'inner_diameter = "2 mm"', 1)
    second = re.sub(r'outer_diameter = "2 mm".*\n', "", second)
    (tmp_path / "robot.toml").write_text(robot + second)
    (tmp_path / "problem.toml").write_text(problem)
    (tmp_path / "curvature.csv").write_text("0, 0, 7, 0\n0.02, 0, 7, 0\n0.05, 0, 8, 0\n")
    (tmp_path / "load.csv").write_text("0, 1, 0, 0, 0, 0, 0\n0.1, 1, 0, 0, 0, 0, 0\n")
    assert len(ctr.load_problem(tmp_path / "problem.toml").loads) == 7
    (tmp_path / "plan.toml").write_text(plan)
    (tmp_path / "plan.csv").write_text(*blocks("docs/reference/files.md", "csv"))
    assert len(ctr.load_plan(tmp_path / "plan.toml").problems) == 1
    (tmp_path / "calibration.toml").write_text(calibration)
    (tmp_path / "calibration.csv").write_text(_experiments())
    (tmp_path / "other_load.toml").write_text(problem)
    assert len(load_calibration(tmp_path / "calibration.toml").experiments) == 8
    (tmp_path / "force.toml").write_text(force)
    (tmp_path / "points.csv").write_text("x [mm], y [mm], z [mm]\n0, 0, 50\n1, 0, 100\n")
    (tmp_path / "curvatures.csv").write_text("s [mm], u_x [1/m], u_y [1/m]\n20, 7, 0\n40, 7, 0.1\n")
    assert len(load_force_problem(tmp_path / "force.toml").measurements) == 7
    start, end = force.index("[[unknown]]"), force.index("[[measurements]]")
    (tmp_path / "others.toml").write_text(force[:start] + unknown.replace('"150 mm"', '"15 mm"') + force[end:])
    assert len(load_force_problem(tmp_path / "others.toml").problem.unknown) == 4


@pytest.mark.parametrize("path", ["docs/explanation/theory.md"])
def test_modules_named_in_the_docs_exist(path):
    text = Path(path).read_text("utf-8")
    named = set(re.findall(r"`((?:robot|mechanics|transcription|solvers|tests)/\w+\.py)(?:: ([\w.]+))?`", text))
    assert len(named) > 10
    for file, name in named:
        module = Path(file) if file.startswith("tests") else Path("ctr_opt", file)
        assert module.exists(), file
        for part in name.split("."):
            assert part in module.read_text("utf-8"), (file, name)


def test_the_code_of_the_inverse_kinematics_runs(capsys):
    (code,) = blocks("docs/how_to/inverse_kinematics.md", "python")
    scope = {}
    exec(code, scope)
    assert "converged" in capsys.readouterr().out
    assert scope["near"].converged
    assert scope["path"].position_errors.max() < 1e-6


def test_the_code_of_the_derivatives_runs(capsys):
    code = "".join(blocks("docs/how_to/derivatives.md", "python"))
    exec(code, {})
    assert capsys.readouterr().out == "(6, 4) (6, 6) (3,) (3, 5) (2, 2)\n(10, 6, 6)\n"


def test_the_code_of_the_contacts_runs(capsys):
    (code,) = blocks("docs/how_to/contacts.md", "python")
    exec(code, {})
    assert capsys.readouterr().out == "at 120 mm, force [0.2 0.1 0. ] N\n1 contact\n"


def test_the_code_of_the_loads_runs(capsys):
    scope = {}
    exec("".join(blocks("docs/how_to/loads.md", "python")), scope)
    assert capsys.readouterr().out == "True True\nNone\n"
    shapes = [scope[name] for name in ("pushed", "hanging", "tied", "leaning", "drifting")]
    assert all(np.linalg.norm(shape.tip_position - scope["free"].tip_position) > 1e-4 for shape in shapes)


def anchors(page):
    """What links may point to in a page: its headings, as they are made by sites that show Markdown."""
    text = re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.S)
    headings = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", line) for line in re.findall(r"^#+ (.*)$", text, re.M)]
    return {re.sub(r"[^\w\- ]", "", line.strip().lower()).replace(" ", "-") for line in headings}


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", *map(str, sorted(Path("docs").rglob("*.md")))])
def test_links_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", Path(page).read_text("utf-8"), flags=re.S)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if not link.startswith("http"):
            target, _, anchor = link.partition("#")
            file = Path(page).parent / target if target else Path(page)
            assert file.exists(), link
            assert not anchor or anchor in anchors(file), link
