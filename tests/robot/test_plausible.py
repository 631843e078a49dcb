"""Warnings of numbers that are hardly meant: slips of units and of order, and never for what is usual."""

import re
import warnings
from pathlib import Path

import pytest

import ctr_opt as ctr
from ctr_opt.files.problem import check_file

GOOD = {"outer_diameter": 1.6e-3, "inner_diameter": 1.2e-3, "youngs_modulus": 58e9, "shear_modulus": 21.5e9}


def tube(name="a", length=0.2, curvature=5.0, **changed):
    return ctr.Tube(name, precurvature=ctr.Arc(length, curvature), **GOOD | changed)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"youngs_modulus": 37.258, "shear_modulus": None, "poisson_ratio": 0.3}, "youngs_modulus = 37.258 Pa .* GPa"),
        ({"youngs_modulus": 58e3, "shear_modulus": 21.5e3}, "youngs_modulus = 58000 Pa .* MPa"),
        ({"youngs_modulus": 58e18, "shear_modulus": 21.5e18}, "multiplied twice"),
        ({"youngs_modulus": 500e9, "shear_modulus": 23e9}, "Poisson ratio of 9.87"),
        ({"outer_diameter": 1.75, "inner_diameter": 1.25}, "outer_diameter = 1.75 m .* in mm"),
        ({"outer_diameter": 1.6e-6, "inner_diameter": 1.2e-6}, "outer_diameter = 1.6e-06 m .* divided twice"),
        ({"length": 97.0}, "length of 97 m is 60625 diameters: is it in mm"),
        ({"curvature": 5000.0}, "precurvature of 5000 1/m bends it more tightly"),
    ],
)
def test_slips_of_units(changed, message):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ctr.Robot([tube(**changed)])
    assert {one.category for one in caught} == {ctr.PlausibilityWarning}
    assert any(re.search(rf"^tubes\[0\] \('a'\): .*{message}", str(one.message)) for one in caught)


def test_tubes_in_the_wrong_order():
    outer = tube("outer", outer_diameter=2.4e-3, inner_diameter=2e-3)
    order = "from the innermost to the outermost"
    with pytest.warns(ctr.NestingWarning), pytest.warns(ctr.PlausibilityWarning, match=order):
        ctr.Robot([outer, tube("inner")])


def test_what_is_usual_is_not_doubted():
    """Neither stiffnesses, whatever the diameters stand for, nor any robot of the repository."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", ctr.PlausibilityWarning)
        stiff = {"bending_stiffness": 1.0, "torsional_stiffness": 1.0, "youngs_modulus": None, "shear_modulus": None}
        ctr.Robot([tube(outer_diameter=2.0, inner_diameter=1.0, length=500.0, **stiff)])
        ctr.Robot([tube()])
        robots = [path for path in Path("problems").rglob("*.toml") if "[[tubes]]" in path.read_text("utf-8")]
        assert len(robots) > 5
        for path in robots:
            ctr.load_robot(path, on_overlap="warn")


def test_a_check_shows_stiffnesses_with_four_digits(tmp_path):
    thin = tube(outer_diameter=4e-4, inner_diameter=0.0)
    ctr.save_robot(ctr.Robot([thin]), tmp_path / "robot.toml")
    text = check_file(tmp_path / "robot.toml")
    assert f"{thin.bending_stiffness:.4g}" in text
