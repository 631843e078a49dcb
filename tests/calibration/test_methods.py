"""Both ways to the least loss: the same answer, the truth from exact data, priors, bounds, exceptions on the way."""

import numpy as np
import pytest
from scipy.stats import norm

import ctr_opt as ctr
from ctr_opt.robot.names import robot_with
from tests.support.estimated import NOISE, every_kind, experiments, flat, off_by, points, small_robot, with_points
from tests.support.slow import some_slow

pytestmark = pytest.mark.usefixtures("compiling")

LOSSES = ("squared", "distance", "huber", "cauchy")
METHODS = ("simultaneous", "reduced")
STIFFNESSES = ["tubes[0].bending_stiffness", "tubes[1].bending_stiffness"]
NAMES = [*STIFFNESSES, "base.translation", "tubes[0].rotation_offset"]
CURVATURE = "tubes[1].precurvature[1].curvature"
WAYS = {False: "virtual machine", True: "compiled"}
COMPILED = pytest.mark.parametrize("compiled", WAYS, ids=WAYS.get)


@pytest.fixture(scope="module")
def robot():
    return small_robot(2)


@pytest.fixture(scope="module")
def noisy(robot):
    return experiments(robot, 6, 1, size=1.0)


@pytest.mark.parametrize(
    ("loss", "compiled"),
    some_slow(
        [(loss, way) for way in WAYS for loss in LOSSES], [("squared", False), *((loss, True) for loss in LOSSES)]
    ),
    ids=WAYS.get,
)
def test_both_ways_end_at_the_same_answer(robot, noisy, loss, compiled):
    """1e-5 standard errors apart: the reduced way stops where the loss is least to 1e-12, a step of 1e-6."""
    off = off_by(robot, {STIFFNESSES[0]: 1.25, STIFFNESSES[1]: 0.75})
    problem = ctr.CalibrationProblem(off, noisy, NAMES, loss=loss, compiled=compiled)
    a, b = (problem.solve(method=method) for method in METHODS)
    assert (a.method, b.method) == METHODS
    errors = flat(a.standard_errors)
    np.testing.assert_allclose(flat(a.values) / errors, flat(b.values) / errors, rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(a.objective, b.objective, rtol=1e-10)
    np.testing.assert_allclose(a.correlation, b.correlation, rtol=0.0, atol=1e-4)
    np.testing.assert_allclose(errors, flat(b.standard_errors), rtol=1e-4)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("loss", LOSSES)
def test_exact_data_give_the_truth(robot, loss, method):
    """From a start a fourth off, to the forward solves' 1e-9; least squares also find a curvature 30 % off."""
    data = experiments(robot, 6, 1, noise=False, size=1.0)
    off, names = {STIFFNESSES[0]: 1.25, STIFFNESSES[1]: 0.75}, NAMES
    truth = [*(tube.bending_stiffness for tube in robot.tubes), *[0.0] * 4]
    if loss == "squared":
        data, names, off = with_points(data, sigma=1e-5), [*names, CURVATURE], off | {CURVATURE: 1.3}
        truth += list(robot.tubes[1].precurvature[1].curvature)
    problem = ctr.CalibrationProblem(off_by(robot, off), data, names, loss=loss, tolerance=1e-9, compiled=True)
    fit = problem.solve(method=method)
    assert fit.method == method
    scale = fit.estimation.unknowns.scale
    np.testing.assert_allclose(flat(fit.values) / scale, truth / scale, rtol=0.0, atol=1e-7)
    assert fit.objective < 1e-8
    found = [tube.bending_stiffness for tube in fit.robot.tubes]
    np.testing.assert_allclose(found, truth[:2], rtol=1e-6)


@pytest.mark.parametrize("method", some_slow(METHODS, ["simultaneous"]))
def test_exact_data_of_every_kind_give_the_truth(method):
    """Three tubes; forces, rotations of an experiment, a base that was moved and turned, a tied factor."""
    robot = small_robot(3)
    moved = {"base.translation": [2e-3, -1e-3, 3e-3], "base.rotation": [0.02, -0.03, 0.01]}
    true = robot_with(off_by(robot, {f"tubes[{i}].bending_stiffness": 1.2 for i in range(3)}), moved)
    data = experiments(true, 6, 4, every_kind, noise=False, size=1.0)
    force = np.array(data[1].loads[0].force)
    wrong = ctr.Actuation(data[2].actuation.rotations + np.array([0.1, -0.1, 0.05]), data[2].actuation.translations)
    data[1] = ctr.Experiment(data[1].actuation, [ctr.PointWrench(0.7 * force)], data[1].measurements)
    data[2] = ctr.Experiment(wrong, data[2].loads, data[2].measurements)
    factor = ctr.Parameter("bending", tied=[f"tubes[{i}].bending_stiffness" for i in range(3)])
    names = [*moved, factor, "experiments[1].loads[0].force", "experiments[2].rotations"]
    fit = ctr.CalibrationProblem(robot, data, names, tolerance=1e-9, compiled=False).solve(method=method)
    truth = [*moved["base.translation"], *moved["base.rotation"], 1.2, *force, *(wrong.rotations - [0.1, -0.1, 0.05])]
    np.testing.assert_allclose(flat(fit.values), truth, rtol=0.0, atol=1e-7)
    assert fit.undetermined == []


@pytest.mark.parametrize("method", METHODS)
def test_densities_are_found_under_gravity(method):
    """A heavy rod; without gravity in any experiment it is refused."""
    rod = small_robot(1)
    true = ctr.Robot([ctr.Tube("rod", 1e-3, 0.7e-3, rod.tubes[0].precurvature, 60e9, 22e9, density=9e4)])
    near = ctr.Robot([ctr.Tube("rod", 1e-3, 0.7e-3, rod.tubes[0].precurvature, 60e9, 22e9, density=7e4)])
    weight, data = [ctr.Gravity([0.0, -9.81, 0.0])], []
    for rotation in (0.0, 1.0, 2.0):
        held = ctr.Actuation([rotation], [-0.05])
        tip = ctr.ForwardProblem(true, tolerance=1e-9).solve(held, weight).tip_position
        data.append(ctr.Experiment(held, weight, [ctr.PositionMeasurement(None, tip, sigma=1e-4)]))
    fit = ctr.CalibrationProblem(near, data, ["tubes[0].density"], tolerance=1e-9).solve(method=method)
    np.testing.assert_allclose(fit.values["tubes[0].density"], 9e4, rtol=1e-6)
    unloaded = [ctr.Experiment(each.actuation, [], each.measurements) for each in data]
    with pytest.raises(ctr.DefinitionError, match=r"parameters = 'tubes\[0\].density' does not act: there is no Grav"):
        ctr.CalibrationProblem(near, unloaded, ["tubes[0].density"])


@COMPILED
@pytest.mark.parametrize("method", METHODS)
def test_diameters_that_must_not_cross(robot, method, compiled):
    """From walls of 17 and 40 micrometres, where a full step leads to no tube at all."""
    data = experiments(robot, 4, 1, noise=False)
    names = ["tubes[0].inner_diameter", "tubes[1].outer_diameter"]
    thin = off_by(robot, {names[0]: 1.38, names[1]: 0.8})
    fit = ctr.CalibrationProblem(thin, data, names, tolerance=1e-9, compiled=compiled).solve(method=method)
    np.testing.assert_allclose(flat(fit.values), [0.7e-3, 1.6e-3], rtol=1e-6)


# -- priors and bounds ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_a_narrow_prior_is_the_answer(robot, noisy, method):
    """A millionth of the data's own error: they move it by 1e-12 of that, and its error is the prior's to 1e-6."""
    free = ctr.CalibrationProblem(robot, noisy, STIFFNESSES, compiled=True).solve(method=method)
    name, other = STIFFNESSES
    sigma = 1e-4 * free.standard_errors[name]
    mean = 1.1 * robot.tubes[0].bending_stiffness
    fit = ctr.CalibrationProblem(robot, noisy, [ctr.Parameter(name, prior=(mean, sigma)), other], compiled=True).solve(
        method=method
    )
    assert abs(fit.values[name] - mean) < 1e-2 * sigma
    np.testing.assert_allclose(fit.standard_errors[name], sigma, rtol=1e-6)
    assert fit.standard_errors[other] < 1.02 * free.standard_errors[other]  # at another value, though


@pytest.mark.parametrize("method", METHODS)
def test_a_prior_is_a_measurement(robot, noisy, method):
    """Of a translation, in which the problem is linear: weighted means, exactly."""
    free = ctr.CalibrationProblem(robot, noisy, ["base.translation"], compiled=True).solve(method=method)
    value, error = free.values["base.translation"], free.standard_errors["base.translation"]
    np.testing.assert_allclose(error, NOISE["position"] / np.sqrt(12.0), rtol=1e-9)  # six experiments, two points
    sigma = np.array([1e-4, 2e-4, 5e-4])
    mean = value + sigma * [1.0, -1.0, 0.5]
    prior = ctr.Parameter("base.translation", prior=(mean, sigma))
    fit = ctr.CalibrationProblem(robot, noisy, [prior], compiled=True).solve(method=method)
    weights = np.array([error**-2, sigma**-2])
    expected = (weights * [value, mean]).sum(axis=0) / weights.sum(axis=0)
    np.testing.assert_allclose(fit.values["base.translation"], expected, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(fit.standard_errors["base.translation"], weights.sum(axis=0) ** -0.5, rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_bounds_are_kept_and_fits_go_on_from_there(robot, noisy, method):
    """To the last digit, as what is done next starts there."""
    name, other = STIFFNESSES
    most = 0.7 * robot.tubes[0].bending_stiffness
    bounded = ctr.Parameter(name, bounds=(None, most), initial=0.5 * most)
    fit = ctr.CalibrationProblem(robot, noisy, [bounded, other], compiled=True).solve(method=method)
    assert 0.0 <= most - fit.values[name] < 1e-7 * most
    assert fit.without(0).values[name] <= most
    values, excess = fit.profile(name, count=3)
    assert values.max() <= most
    assert (excess > -1e-5).all()


def test_some_numbers_of_an_array_may_be_bounded(robot, noisy):
    bounds = ([-np.inf, None, 0.0], [np.inf, None, 1.0])
    fit = ctr.CalibrationProblem(
        robot, noisy, [ctr.Parameter("base.translation", bounds=bounds)], compiled=True
    ).solve()
    free = ctr.CalibrationProblem(robot, noisy, ["base.translation"], compiled=True).solve()
    assert fit.values["base.translation"][2] >= 0.0
    np.testing.assert_allclose(fit.values["base.translation"][:2], free.values["base.translation"][:2], atol=1e-9)


@COMPILED
@pytest.mark.parametrize("method", METHODS)
def test_no_base_comes_in_front_of_the_entry(robot, method, compiled):
    """A tube held at the entry that is 4 mm longer than it should be: the offset that explains it cannot be."""
    longer = robot_with(robot, {"tubes[1].precurvature[0].length": robot.tubes[1].precurvature[0].length + 4e-3})
    held = [ctr.Actuation([0.0, 0.3 * k], [-0.06 + 0.01 * k, 0.0]) for k in range(3)]
    data = [ctr.Experiment(each, [], points(ctr.ForwardProblem(longer).solve(each))) for each in held]
    problem = ctr.CalibrationProblem(robot, data, ["tubes[1].translation_offset"], compiled=compiled)
    fit = problem.solve(method=method)
    assert -1e-7 < fit.values["tubes[1].translation_offset"] <= 0.0
    assert fit.chi_squared > 100.0
    drawn = [ctr.Actuation(each.rotations, each.translations - [0.0, 0.01]) for each in held]
    data = [ctr.Experiment(each, [], points(ctr.ForwardProblem(longer).solve(each))) for each in drawn]
    problem = ctr.CalibrationProblem(robot, data, ["tubes[1].translation_offset"], compiled=compiled)
    np.testing.assert_allclose(problem.solve(method=method).values["tubes[1].translation_offset"], 4e-3, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_what_progress_raises_ends_the_solve(robot, noisy, method, capfd):
    class Enough(Exception):
        pass

    def progress(what, done, of):
        if what == "steps":
            raise Enough

    with pytest.raises(Enough):
        ctr.CalibrationProblem(robot, noisy, STIFFNESSES, compiled=True).solve(method=method, progress=progress)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("method", METHODS)
def test_distances_are_the_median(method):
    """Of one coordinate, translation of the base: the smoothed sum of distances is least at the points' median."""
    robot = small_robot(1)
    data = experiments(robot, 5, 2, noise=False, loaded=False)
    shifts = NOISE["position"] * norm.ppf([0.05, 0.4, 0.5, 0.7, 0.99])
    data = with_points(data, lambda position, k: position + np.array([shifts[k], 0.0, 0.0]))
    fit = ctr.CalibrationProblem(robot, data, ["base.translation"], loss="distance", compiled=True).solve(method=method)
    # the smoothing, 1e-2 of the noise, takes part of the difference of its neighbours' pulls, which is zero here
    np.testing.assert_allclose(fit.values["base.translation"], [shifts[2], 0.0, 0.0], rtol=0.0, atol=1e-8)
