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


def test_joints_as_read_are_checked():
    with pytest.raises(ctr.DefinitionError, match=r"read = .x. must be numbers of shape"):
        ctr.Actuation([0.0], [0.0], read="x")


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
    with pytest.raises(ctr.DefinitionError, match=r"experiments\[1\].*joint readings"):
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


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "virtual machine"])
def test_poses_at_the_tip_are_those_of_the_tube_that_the_estimate_puts_there(compiled):
    """Joints as read put one tube at the tip, those with the true homes the other: exact data give the homes."""
    inner = ctr.Tube(
        "inner", 1e-3, 0.6e-3, [ctr.Straight(0.1), ctr.Arc(0.05, 8.0)], youngs_modulus=60e9, poisson_ratio=0.3
    )
    outer = ctr.Tube(
        "outer", 1.6e-3, 1.2e-3, [ctr.Straight(0.05), ctr.Arc(0.05, 5.0)], youngs_modulus=60e9, poisson_ratio=0.3
    )
    robot = ctr.Robot([inner, outer])
    problem = ctr.ForwardProblem(robot, tolerance=1e-9)
    homes, lengths = np.array([[0.2, -0.1], [-0.002, 0.001]]), [tube.length for tube in robot.tubes]
    rng, experiments, at_tip = np.random.default_rng(0), [], []
    for _ in range(12):
        rotations = rng.uniform(-1.2, 1.2, 2)
        translations = np.array([-0.08 - 0.02 * rng.random(), -0.03 - 0.02 * rng.random()])
        shape = problem.solve(ctr.Actuation(rotations + homes[0], translations + homes[1]))
        seen = [
            ctr.PoseMeasurement(None, shape.tip_pose, [1e-4] * 3 + [1e-3] * 3),
            ctr.PositionMeasurement(0.03, shape.position(0.03), 1e-4),
        ]
        experiments.append(ctr.Experiment(ctr.Actuation(rotations, translations), [], seen))
        at_tip.append([int(np.argmax(shifts + lengths)) for shifts in (translations, translations + homes[1])])
    assert sum(read != true for read, true in at_tip) > 0
    names = [f"tubes[{tube}].{what}_offset" for what in ("rotation", "translation") for tube in (0, 1)]
    fit = ctr.CalibrationProblem(robot, experiments, names, compiled=compiled).solve()
    np.testing.assert_allclose([fit.values[name] for name in names], homes.ravel(), atol=1e-7)
    assert "as the estimates move their ends" in fit.method
    others = fit.without([k for k, (read, true) in enumerate(at_tip) if read == true][:3])
    np.testing.assert_allclose([others.values[name] for name in names], homes.ravel(), atol=1e-7)


def test_a_load_that_is_not_in_all_experiments_is_named():
    robot = small_robot(1)
    seen = [ctr.PositionMeasurement(0.02, [0.0, 0.0, 0.02], 1e-4)]
    experiment = ctr.Experiment(ctr.Actuation([0.0], [-0.1]), [], seen)
    with pytest.raises(
        ctr.DefinitionError, match=r"parameters = 'loads\[0\]\.force' must be .*; experiments\[0\] has no"
    ):
        ctr.CalibrationProblem(robot, experiment, ["loads[0].force"])
