"""Every example runs from anywhere and holds what it asserts."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.slow import some_slow

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
SCRIPTS = sorted(EXAMPLES.glob("*.py"))
FIGURES = {
    "fig5": EXAMPLES / "precurvature_of_a_tube.py",
    "fig9": EXAMPLES / "loaded.py",
    "control_loop": EXAMPLES / "control_loop.py",
    "first_shape": EXAMPLES / "first_shape.py",
    "inverse_kinematics": EXAMPLES / "inverse_kinematics.py",
    "load_appears": EXAMPLES / "load_appears.py",
    "random_workspace": EXAMPLES / "random_workspace.py",
    "strains_to_force": EXAMPLES / "strains_to_force.py",
    "unknown_contact": EXAMPLES / "unknown_contact.py",
} | {path.stem: path for path in (EXAMPLES / "figures").glob("*.py")}
DOCS = EXAMPLES.parent / "docs" / "figures"

LONG = {  # from three to nine seconds each
    *("calibrate_from_tip_poses", "calibration", "control_loop", "design", "force_map", "gravity_and_wall"),
    *("inverse_kinematics", "load_appears", "palpation", "path_following", "unknown_contact", "distributed_force"),
}


def run(script, *arguments, folder):
    package = os.pathsep.join(path for path in (str(EXAMPLES.parent), os.environ.get("PYTHONPATH")) if path)
    environment = {**os.environ, "MPLBACKEND": "Agg", "PYTHONPATH": package}
    environment.pop("CTR_OPT_COMPILE", None)  # as a user runs them
    command = [sys.executable, "-W", "error", str(script), *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


@pytest.mark.parametrize(
    "script",
    [
        pytest.param(path, marks=pytest.mark.slow if path.stem in LONG else (), id=path.stem)
        for path in SCRIPTS
        if path not in FIGURES.values()  # these run once, below
    ],
)
def test_example_runs(script, tmp_path):
    assert run(script, folder=tmp_path)
    assert not list(tmp_path.iterdir())  # it writes nothing unless asked


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_example_is_short_and_asserts_something(script):
    text = script.read_text("utf-8")
    assert len(text.splitlines()) < 80
    assert "assert" in text


@pytest.mark.parametrize("name", some_slow(sorted(FIGURES), set(FIGURES) - LONG))
def test_figure_is_drawn(name, tmp_path):
    run(FIGURES[name], "figure.png", folder=tmp_path)
    (only,) = tmp_path.iterdir()
    assert only.read_bytes().startswith(b"\x89PNG")


def test_every_figure_of_the_docs_has_a_script_and_is_small():
    assert {path.stem for path in DOCS.glob("*.png")} == {*FIGURES, "transcriptions"}
    assert (EXAMPLES.parent / "benchmarks" / "transcriptions.py").exists()
    assert all(path.stat().st_size < 200_000 for path in DOCS.glob("*.png"))
