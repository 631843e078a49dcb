"""Homes of the joints: what a fit adds to joints as they are read, and how it knows that it did."""

import copy
import pickle
import re
from types import SimpleNamespace

import attrs
import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.files import calibration_page
from tests.support.estimated import actuations, points, small_robot, solve

pytestmark = pytest.mark.usefixtures("compiling")

HOMES = ["tubes[0].rotation_offset", "tubes[1].rotation_offset", "tubes[1].translation_offset"]
OFFSETS = np.array([[0.1, -0.06], [0.0, -2e-3]])  # rad, m


def moved(read, offsets=OFFSETS):
    return ctr.Actuation(read.rotations + offsets[0], read.translations + offsets[1])


def fitted(names, count=6, offsets=OFFSETS):
    robot = small_robot(2)
    data = [
        ctr.Experiment(read, [], points(solve(robot, moved(read, offsets))))
        for read in actuations(np.random.default_rng(5), robot, count)
    ]
    return ctr.CalibrationProblem(robot, data, names, compiled=True).solve()


@pytest.fixture(scope="module")
def fit():
    return fitted(HOMES)


def test_the_homes_are_added_as_the_calibration_adds_them(fit):
    """Exact data: the offsets are found to 1e-6 of a radian and of a millimetre, what its tolerance leaves."""
    assert np.abs((fit.homes.offsets - OFFSETS) / [[1e-6], [1e-9]]).max() < 1.0
    for experiment, equilibrium in zip(fit.estimation.experiments, fit.equilibria, strict=True):
        read = experiment.actuation
        assert fit.actuation(read.rotations, read.translations) == equilibrium.actuation


def test_without_homes_the_joints_are_plain():
    fit = fitted(["tubes[0].bending_stiffness", "base.translation"], offsets=np.zeros((2, 2)))
    plain = fit.actuation([0.1, 0.2], [-0.1, -0.05])
    assert plain == ctr.Actuation([0.1, 0.2], [-0.1, -0.05])
    assert plain.read is None
    fit.homes.check(plain)


def test_the_mark_is_not_seen(fit):
    marked = fit.actuation([0.1, 0.2], [-0.1, -0.05])
    plain = ctr.Actuation(marked.rotations, marked.translations)
    assert marked == plain
    assert hash(marked) == hash(plain)
    assert repr(marked) == repr(plain)


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, attrs.evolve, lambda a: pickle.loads(pickle.dumps(a))])
def test_the_mark_stays_with_copies(fit, again):
    marked = again(fit.actuation([0.1, 0.2], [-0.1, -0.05]))
    assert fit.homes.within(marked)
    fit.homes.check(marked)


def test_the_mark_is_of_its_joints_and_its_offsets(fit):
    """Changed joints, or another fit's homes, are not taken for those that this fit made."""
    marked = fit.actuation([0.1, 0.2], [-0.1, -0.05])
    other = fitted(HOMES, offsets=OFFSETS + np.array([[1e-3], [0.0]])).actuation([0.1, 0.2], [-0.1, -0.05])
    third = ctr.Actuation([0.1] * 3, [-0.1] * 3, read=np.zeros((2, 3)))
    for wrong in (attrs.evolve(marked, rotations=[0.1, 0.2]), other, third, ctr.Actuation([0.1, 0.2], [-0.1, -0.05])):
        with pytest.raises(ctr.DefinitionError, match=r"tubes\[0\]\.rotation_offset.*fit\.actuation\(rotations"):
            fit.homes.check(wrong)


def test_a_base_in_front_of_the_entry_is_refused():
    fit = fitted(HOMES, offsets=-OFFSETS)
    with pytest.raises(
        ctr.DefinitionError, match=r"translations\[1\] = -0\.001 m .* 0\.002 m .* tube 1 0\.001 m in fro"
    ):
        fit.actuation([0.0, 0.0], [-0.1, -0.001])
    with pytest.raises(ctr.DefinitionError, match=r"rotations has shape \(3,\)"):
        fit.actuation([0.0, 0.0, 0.0], [-0.1, -0.001])


def test_joints_may_be_read_in_front_of_the_entry(fit):
    """What counts is where the base is."""
    assert fit.actuation([0.0, 0.0], [-0.1, 1e-3]).translations[1] == pytest.approx(-1e-3, abs=1e-8)


def test_an_estimate_at_its_bound_holds_the_base_at_the_entry():
    """Read at -4 mm and found 5 mm too far: the bound, 4 mm, is met to rounding."""
    robot = small_robot(2)
    true, read = ctr.Actuation([0.3, 0.5], [-0.15, 0.0]), ctr.Actuation([0.3, 0.5], [-0.15, -4e-3])
    data = [ctr.Experiment(read, [], points(solve(robot, true)))]
    fit = ctr.CalibrationProblem(robot, data, HOMES[2:], compiled=True).solve()
    assert fit.actuation([0.3, 0.5], [-0.15, -4e-3]).translations[1] == pytest.approx(0.0, abs=1e-6)


def test_homes_that_the_data_do_not_determine_are_no_number():
    """All tubes turned, or the base: positions do not tell."""
    fit = fitted(["base.rotation", *HOMES[:2]])
    with pytest.raises(ctr.EstimationError, match=r"homes of the joints: .*rotation_offset"):
        fit.actuation([0.0, 0.0], [-0.1, -0.05])


def test_other_experiments_are_given_as_they_are_read(fit):
    """``tested`` adds the homes itself."""
    read = fit.estimation.experiments[0]
    added = attrs.evolve(read, actuation=fit.actuation(read.actuation.rotations, read.actuation.translations))
    assert max(each.distance for each in fit.tested([read]).residuals) < 1e-6
    with pytest.raises(ctr.DefinitionError, match=r"experiments\[1\].*as read"):
        fit.tested([read, added])


def test_checks_of_a_calibration_page_have_the_homes(fit):
    """A tip that was not fitted, of joints as they are read: far off nominally, and right with the fit."""
    read = ctr.Actuation([0.5, -0.4], [-0.17, -0.1])
    problem = SimpleNamespace(title="another tip", actuation=read, loads=[])
    check = SimpleNamespace(problem=problem, tip_position=solve(fit.robot, moved(read)).tip_position)
    given = SimpleNamespace(robot=fit.robot, checks=[check])
    *_, row = calibration_page._checks(given, {"squared": fit})
    nominal, calibrated = (float(error) for error in re.findall(r"(\d+\.\d+) \(", row))
    assert nominal > 0.3  # mm
    assert calibrated == 0.0
