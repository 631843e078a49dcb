"""What a fit says of its own errors, against repetitions; what data do not determine; influence and profiles."""

import re

import attrs
import numpy as np
import pytest
from scipy.stats import chi2

import ctr_opt as ctr
from ctr_opt.calibration import refits
from ctr_opt.calibration.estimation import Estimation
from ctr_opt.robot.names import robot_with
from tests.support.estimated import NOISE, experiments, flat, off_by, points, small_robot, solve, with_points
from tests.support.slow import some_slow

pytestmark = pytest.mark.usefixtures("compiling")

SIGMA = NOISE["position"]
STIFFNESSES = ["tubes[0].bending_stiffness", "tubes[1].bending_stiffness"]
NAMES = [*STIFFNESSES, "tubes[0].rotation_offset"]
REPETITIONS = 60


def within(value, freedom):
    """Whether chi-square is so large with a probability of 1 - 1e-3; the seeds are fixed, so that it stays so."""
    return chi2.ppf(5e-4, freedom) < value < chi2.isf(5e-4, freedom)


@pytest.fixture(scope="module")
def robot():
    return small_robot(2)


@pytest.fixture(scope="module")
def exact(robot):
    return experiments(robot, 6, 1, noise=False, size=1.0)


def noisy(data, seed, sigma=SIGMA, outliers=0.0):
    rng = np.random.default_rng(seed)

    def change(position, k):
        error = SIGMA * rng.normal(size=position.shape)
        return position + error * np.where(rng.random((len(position), 1)) < outliers, 8.0, 1.0)

    return with_points(data, change, sigma)


def fitted(robot, data, names=NAMES, loss="squared", method="reduced"):
    return ctr.CalibrationProblem(robot, data, names, loss=loss, compiled=True).solve(method=method)


def truth_of(robot):
    return np.array([*(tube.bending_stiffness for tube in robot.tubes), 0.0])


# -- errors -----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_standard_errors_are_the_scatter(robot, exact):
    """Each number's, all together by the covariance, and chi-square; noise is rejected once in 1000."""
    truth, fits = truth_of(robot), [fitted(robot, noisy(exact, seed)) for seed in range(REPETITIONS)]
    off = np.array([flat(fit.values) for fit in fits]) - truth
    errors = np.array([flat(fit.standard_errors) for fit in fits])
    for number in (off / errors).T:
        assert within(number @ number, REPETITIONS)
    together = sum(d @ np.linalg.solve(fit.covariance, d) for d, fit in zip(off, fits, strict=True))
    assert within(together, 3 * REPETITIONS)
    assert fits[0].degrees_of_freedom == 6 * 6 - 3
    assert within(sum(fit.chi_squared for fit in fits), REPETITIONS * 33)
    assert all(fit.noise_accepted for fit in fits)


def test_a_noise_level_that_is_too_small_is_rejected(robot, exact):
    """By a third: errors are then those of the residuals' own level; that of no noise level at all is the same fit."""
    given, third, none = (fitted(robot, noisy(exact, 3, sigma)) for sigma in (SIGMA, SIGMA / 3.0, None))
    assert given.noise_accepted
    assert not third.noise_accepted
    assert third.p_value < 1e-9
    np.testing.assert_allclose(third.noise, 3.0 * given.noise, rtol=1e-6)
    np.testing.assert_array_equal(third.covariance, third.covariance_estimated)
    np.testing.assert_allclose(flat(third.values), flat(given.values), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(flat(none.values), flat(given.values), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(none.covariance, third.covariance, rtol=1e-5)
    np.testing.assert_allclose(none.noise * 1e-3, given.noise * SIGMA, rtol=1e-6)  # in mm
    assert np.isnan(none.p_value)
    assert "rejected; errors are for" in third.report()
    assert "from the residuals" in none.report()


@pytest.mark.parametrize("loss", some_slow(["huber", "cauchy", "distance"], ["cauchy"]))
def test_the_sandwich_is_the_scatter(robot, exact, loss):
    """A tenth of the points is off by eight times the noise; within 25 %, as sandwiches of 12 points are no better."""
    truth = truth_of(robot)
    fits = [fitted(robot, noisy(exact, seed, outliers=0.1), loss=loss) for seed in range(30)]
    off = np.array([flat(fit.values) for fit in fits]) - truth
    reported = np.array([flat(fit.standard_errors) for fit in fits])
    scatter = np.sqrt((off**2).mean(axis=0))
    ratio = np.sqrt((reported**2).mean(axis=0)) / scatter
    assert (ratio > 0.6).all()
    assert (ratio < 1.4).all()
    squares = [fitted(robot, noisy(exact, seed, outliers=0.1)) for seed in range(15)]
    worse = np.array([flat(fit.values) for fit in squares]) - truth
    assert np.sqrt((worse**2).mean(axis=0) / (off[:15] ** 2).mean(axis=0)).mean() > 1.2


def test_priors_are_counted_as_measurements(robot, exact):
    """Three numbers known as well by priors as by the six measured: chi-square stays what it should be, on average."""
    total, freedom = 0.0, 0
    for seed in range(REPETITIONS):
        rng = np.random.default_rng([9, seed])
        mean = 1e-4 * rng.normal(size=3)
        prior = ctr.Parameter("base.translation", prior=(mean, 1e-4))
        fit = fitted(robot, noisy(exact[:1], seed), [prior])
        total, freedom = total + fit.chi_squared, freedom + fit.degrees_of_freedom
        assert fit.noise_accepted
    assert freedom == 6 * REPETITIONS
    assert within(total, freedom)


# -- what data do not determine ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["simultaneous", "reduced"])
def test_unloaded_shapes_tell_ratios_of_stiffnesses(method):
    """Of RJW-S1, all four of them; the ratios to three times their errors of some percent."""
    plan = ctr.load_plan("problems/rjw_s1/plan.toml")
    names = [f"tubes[{i}].{kind}_stiffness" for kind in ("bending", "torsional") for i in (0, 1)]
    true = off_by(plan.robot, dict(zip(names, (1.1, 0.92, 0.95, 1.1), strict=True)))
    rng, data = np.random.default_rng(0), []
    for each in [problem for problem in plan.problems if not problem.loads][::2]:
        shape = solve(true, each.actuation)
        places = [ctr.Distal(1), None]
        ends = [true.tubes[1].length + each.actuation.translations[1], shape.length]
        seen = shape.position(ends) + 0.05e-3 * rng.normal(size=(2, 3))
        data.append(ctr.Experiment(each.actuation, [], [ctr.PositionMeasurement(places, seen, sigma=0.05e-3)]))
    fit = fitted(plan.robot, data, names, method=method)
    assert fit.method == method
    assert fit.iterations < 30  # it stops where the objective stands still, and does not go along the open direction
    assert [str(each) for each in fit.undetermined] == ["EI_0 : EI_1 : GJ_0 : GJ_1 may be scaled together"]
    assert np.isnan(flat(fit.values)).all()
    assert np.isinf(flat(fit.standard_errors)).all()
    assert not np.isfinite(fit.condition) or fit.condition > 1e8
    stiffness = {"EI": "bending_stiffness", "GJ": "torsional_stiffness"}
    assert sorted(fit.ratios) == ["EI_1 / EI_0", "GJ_0 / EI_0", "GJ_1 / EI_0"]
    for name, (ratio, error) in fit.ratios.items():
        over, under = (getattr(true.tubes[int(n[3])], stiffness[n[:2]]) for n in name.split(" / "))
        assert abs(ratio - over / under) < 3.0 * error < 0.5 * ratio
    with pytest.raises(ctr.EstimationError, match="the data do not determine the robot: EI_0 : EI_1 : GJ_0 : GJ_1"):
        _ = fit.robot
    report = fit.report()
    for text in ("not determined", "may be scaled together", "What they do determine:", "GJ_1 / EI_0 ="):
        assert text in report
    with pytest.raises(ctr.EstimationError, match="has no profile: the data do not determine it"):
        fit.profile(names[0])
    assert fitted(plan.robot, data, names[1:], method=method).undetermined == []


def test_a_roll_of_the_base_and_of_all_tubes(robot):
    """About the entry's z: one direction of four numbers; the others are determined."""
    data = noisy(experiments(robot, 6, 1, noise=False, loaded=False), 1)
    fit = fitted(robot, data, ["base.rotation", "tubes[0].rotation_offset", "tubes[1].rotation_offset"])
    (direction,) = fit.undetermined
    assert direction.standard_deviation > 1.0
    assert set(direction.parts) == {"base.rotation.z", "tubes[0].rotation_offset", "tubes[1].rotation_offset"}
    turn = np.array(list(direction.parts.values()))
    np.testing.assert_allclose(turn / turn[0], [1.0, -1.0, -1.0], rtol=0.0, atol=1e-2)  # the base is turned a little
    assert "may change together" in str(direction)
    assert np.isfinite(fit.values["base.rotation"]).tolist() == [True, True, False]
    assert fit.standard_errors["base.rotation"][:2].max() < 0.1
    assert np.isinf(fit.standard_errors["tubes[1].rotation_offset"])


def test_parameters_that_do_not_act(robot):
    """Of a straight rod without loads: its stiffnesses, each for itself; what acts is determined beside them."""
    rod = small_robot(1)
    straight = ctr.Robot([attrs.evolve(rod.tubes[0], precurvature=[ctr.Straight(0.24)])], rod.base_pose)
    held = experiments(straight, 3, 2, loaded=False)
    fit = fitted(straight, held, ["base.translation", "tubes[0].torsional_stiffness", "tubes[0].bending_stiffness"])
    assert sorted(str(each) for each in fit.undetermined) == ["EI_0 is not determined", "GJ_0 is not determined"]
    assert np.isfinite(fit.values["base.translation"]).all()
    assert np.isnan(fit.values["tubes[0].torsional_stiffness"])
    assert fit.ratios == {}


def test_vague_is_not_undetermined(robot, exact):
    """Twelve points measured to 1 m and to 3 m place a base of 0.24 m to 1.2 and to 3.6 times its size."""
    fit = fitted(robot, noisy(exact, 2, 1.0), ["base.translation"])
    scale, errors = fit.estimation.unknowns.scale, fit.deviations
    assert (errors / scale > 1.0).all()
    assert (errors / scale < 3.0).all()
    assert fit.undetermined == []
    assert fit.vague == fit.labels
    assert np.isfinite(fit.estimates).all()
    assert "Known only vaguely, with errors above their size: base.translation.x, base.translation.y" in fit.report()
    worse = fitted(robot, noisy(exact, 2, 3.0), ["base.translation"])
    assert len(worse.undetermined) == 3
    assert worse.vague == []
    assert np.isnan(worse.estimates).all()
    assert "vaguely" not in worse.report()


def test_what_is_open_of_experiments_is_no_obstacle_to_a_robot(robot, exact):
    """A force at the entry bends nothing; of the robot everything is known. Not so where its own parts take part."""
    held = attrs.evolve(exact[1], loads=[*exact[1].loads, ctr.PointWrench([0.1, 0.0, 0.0], arc_length=0.0)])
    names = ["base.translation", "experiments[1].loads[1].force"]
    fit = fitted(robot, noisy([exact[0], held, *exact[2:]], 1), names)
    assert len(fit.undetermined) == 3
    np.testing.assert_allclose(fit.robot.base_pose[:3, 3] - robot.base_pose[:3, 3], fit.values["base.translation"])
    rolled = ["base.rotation", "tubes[0].rotation_offset", "tubes[1].rotation_offset", names[1]]
    open_base = fitted(robot, [exact[0], held, *exact[2:]], rolled)
    with pytest.raises(ctr.EstimationError, match=r"the data do not determine the robot: .*base\.rotation\.z") as error:
        _ = open_base.robot
    assert "loads" not in str(error.value)


def test_nothing_left_over_is_no_noise_level(robot, exact):
    """Three numbers from three: no chi-square; with a noise level given the errors are the measurement's own."""
    tip = ctr.PositionMeasurement(None, solve(robot, exact[0].actuation).tip_position + 1e-3, sigma=SIGMA)
    fit = fitted(robot, [attrs.evolve(exact[0], measurements=[tip])], ["base.translation"])
    assert fit.degrees_of_freedom == 0
    assert np.isnan(fit.noise)
    np.testing.assert_allclose(fit.standard_errors["base.translation"], SIGMA, rtol=1e-9)
    np.testing.assert_allclose(fit.values["base.translation"], 1e-3, rtol=1e-6)
    assert fit.report()


# -- influence --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def spoilt(robot, exact):
    """Twelve experiments, of which the actuation of one was mistyped."""
    data = noisy(experiments(robot, 12, 8, noise=False, size=1.0), 5)
    wrong = ctr.Actuation(data[7].actuation.rotations + np.array([0.0, 1.0]), data[7].actuation.translations)
    data[7] = attrs.evolve(data[7], actuation=wrong, name="mistyped")
    return data


@pytest.mark.parametrize("loss", ["squared", "huber", "cauchy"])
def test_an_outlier_is_found(robot, spoilt, loss):
    fit = fitted(robot, spoilt, loss=loss)
    assert fit.outliers == [7]
    assert "mistyped" in fit.report()
    assert fit.without(7).outliers == []
    if loss == "squared":
        assert int(np.argmax(fit.influence)) == 7
        assert fit.influence[7] > 1.0 / 3.0
        assert not fit.noise_accepted
        assert fit.without(7).noise_accepted


@pytest.mark.parametrize("sigma", [SIGMA, None])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_computed_data_have_no_outliers(robot, seed, sigma):
    """Only rounding errors and the solves' tolerance are left of them; a micrometre is an outlier among them."""
    data = with_points(experiments(robot, 6, seed, noise=False, size=1.0), sigma=sigma)
    for tolerance in (1e-6, 1e-9):
        assert ctr.CalibrationProblem(robot, data, NAMES, tolerance=tolerance, compiled=True).solve().outliers == []
    off = with_points(data, lambda position, k: position + (1e-6 if k == 2 else 0.0), sigma)
    assert fitted(robot, off).outliers == [2]


def test_without_is_a_fit_to_the_others(robot, spoilt):
    """From another start and by the other method; 1e-5 of the errors."""
    fit, left = fitted(robot, spoilt), [k for k in range(12) if k not in (2, 7)]
    fresh = fitted(off_by(robot, {STIFFNESSES[0]: 1.2}), [spoilt[k] for k in left], method="simultaneous")
    without = fit.without([2, 7])
    errors = flat(fresh.standard_errors)
    np.testing.assert_allclose(flat(without.values) / errors, flat(fresh.values) / errors, rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(without.covariance, fresh.covariance, rtol=1e-4, atol=1e-12)


def test_influence_is_what_leaving_out_does(robot, exact):
    """One Newton step against the fit itself: within 30 % of Cook's distance, as the problem is nearly linear."""
    fit = fitted(robot, noisy(exact, 2))
    inverse = np.linalg.inv(fit.covariance)
    for k in range(6):
        change = flat(fit.without(k).values) - flat(fit.values)
        np.testing.assert_allclose(fit.influence[k], change @ inverse @ change / 3.0, rtol=0.35, atol=2e-3)


def test_hold_outs(robot, spoilt):
    """What a fit to the others predicts; of the mistyped experiment the errors are larger than in its own fit."""
    fit = fitted(robot, spoilt)
    reported = fit.errors_without([2, 7])
    other = fit.without([2, 7])
    assert [each.experiment for each in reported] == [2, 2, 7, 7]
    shape = solve(other.robot, *other.estimation.unknowns.experiment_at(flat(other.values), 0))
    assert shape.converged
    actuation = ctr.Actuation(
        spoilt[2].actuation.rotations + np.array([other.values["tubes[0].rotation_offset"], 0.0]),
        spoilt[2].actuation.translations,
    )
    held = solve(other.robot, actuation, spoilt[2].loads)
    ends = [t.length + b for t, b in zip(robot.tubes, actuation.translations, strict=True)]
    expected = held.position(ends) - spoilt[2].measurements[0].position
    np.testing.assert_allclose([each.value for each in reported[:2]], expected, rtol=0.0, atol=1e-8)
    own = [each.size for each in fit.residuals if each.experiment == 7]
    assert max(each.size for each in reported[2:]) > max(own)
    np.testing.assert_array_equal(fit.errors_without(2)[0].value, fit.errors_without([2])[0].value)


def test_profiles_are_parabolas(robot, exact):
    """Half the squared distance in standard errors: to 5 % a tenth of an error away, as curvature of
    the residuals, which the covariance leaves out, is some percent."""
    fit = fitted(robot, noisy(exact, 2))
    for label, error in zip(fit.labels, flat(fit.standard_errors), strict=True):
        values, excess = fit.profile(label, count=5, width=0.1)
        np.testing.assert_allclose(np.diff(values), 0.05 * error, rtol=1e-9)
        np.testing.assert_allclose(excess, 0.5 * np.linspace(-0.1, 0.1, 5) ** 2, rtol=0.05, atol=1e-8)
    values, excess = fitted(robot, noisy(exact, 2), NAMES[:1]).profile(NAMES[0], count=3)
    assert excess[1] == pytest.approx(0.0, abs=1e-8)
    assert (excess[[0, 2]] > 2.0).all()


@pytest.mark.slow
def test_bootstrap_spreads_like_the_errors(robot):
    """Of twelve experiments, few of which tell of the inner tube: a third to twice; the same for the same seed."""
    fit = fitted(robot, noisy(experiments(robot, 12, 8, noise=False, size=1.0), 5))
    drawn = fit.bootstrap(40, seed=1)
    assert drawn.shape == (40, 3)
    ratio = drawn.std(axis=0) / flat(fit.standard_errors)
    assert (ratio > 0.33).all()
    assert (ratio < 2.0).all()
    np.testing.assert_array_equal(fit.bootstrap(2, seed=1), drawn[:2])


def rods(loaded, count=6):
    """Experiments on one rod, whose free shapes tell nothing of its stiffness; the first are loaded."""
    rod = small_robot(1)
    data = experiments(rod, count, 4, noise=False, loaded=False)
    for k in range(loaded):
        loads = [ctr.PointWrench([0.3, -0.2, 0.1])]
        shape = solve(rod, data[k].actuation, loads)
        data[k] = attrs.evolve(data[k], loads=loads, measurements=points(shape))
    return rod, noisy(data, 3)


def test_bootstraps_tell_which_repetitions_they_leave_out():
    """Of six experiments three are loaded: a draw has none with a probability of 1/64, two in three with one of six."""
    name = STIFFNESSES[0]
    fit = fitted(*rods(loaded=3), [name])
    with pytest.warns(ctr.EstimationWarning, match=r"bootstrap: \d of 60 repetitions failed; the first: "
                      rf"repetition \d+ does not determine {re.escape(name)}. They are left out"):  # fmt: skip
        drawn = fit.bootstrap(60, seed=2)
    assert 57 <= len(drawn) < 60
    assert np.isfinite(drawn).all()
    with pytest.raises(ctr.EstimationError, match=r"of 20 repetitions failed; .*biased sample: add"):
        fitted(*rods(loaded=1), [name]).bootstrap(20, seed=2)


def test_bootstraps_of_what_is_not_determined():
    """Stays not a number, and is no reason to leave a repetition out."""
    drawn = fitted(*rods(loaded=0), [STIFFNESSES[0], "base.translation"]).bootstrap(3)
    assert np.isnan(drawn[:, 0]).all()
    assert np.isfinite(drawn[:, 1:]).all()


def test_refits_without_an_answer_are_errors(robot, exact, monkeypatch):
    """Where no equilibrium is found any more, the repetition or the experiments are named, and what to do."""

    def fails(*_, **__):
        raise ctr.SolveError("experiment 4: lost")

    fit = fitted(robot, noisy(exact, 1))
    error = float(fit.deviations[0])
    assert len(fit.equilibria) == 6
    with monkeypatch.context() as patched:
        patched.setattr(Estimation, "equilibria", fails)
        for call in (fit.without, fit.errors_without):
            with pytest.raises(
                ctr.EstimationError, match="the fit without experiments 1, 2 did not converge"
            ) as caught:
                call([1, 2])
            assert "no equilibrium in experiment 4: lost. Try priors or bounds" in str(caught.value)
        with pytest.raises(ctr.EstimationError, match=r"bootstrap: 3 of 3 .* the first: repetition 0 did not converge"):
            fit.bootstrap(3)
        start = fit.outcome.x[0] - 3.0 * error
        with pytest.raises(ctr.EstimationError, match=rf"the profile at {re.escape(NAMES[0])} = {start:g} did not"):
            fit.profile(NAMES[0])
        patched.setattr(refits, "without", lambda fit, experiments: fit)
        with pytest.raises(ctr.EstimationError, match="the estimates without experiment 2 have no equilibrium in exp"):
            fit.errors_without(2)


def test_refits_of_what_does_not_act_are_errors():
    """The one experiment under gravity left out, a density means nothing."""
    rod = ctr.Robot([attrs.evolve(small_robot(1).tubes[0], density=8e3)])
    held = ctr.Actuation([0.0], [-0.1])
    data = [ctr.Experiment(held, k, points(solve(rod, held, k))) for k in ([ctr.Gravity([0.0, -9.81, 0.0])], [])]
    fit = fitted(rod, data, ["tubes[0].density"])
    with pytest.raises(
        ctr.EstimationError, match=r"the fit without experiment 0 is not possible: .* there is no Gravity"
    ):
        fit.without(0)


def test_refits_that_do_not_converge_are_errors(robot, exact, monkeypatch):
    fit = fitted(robot, noisy(exact, 1))
    ended = attrs.evolve(fit.outcome, converged=False, message="no more steps", iterations=200)
    monkeypatch.setattr(refits, "solve_reduced", lambda *_, **__: ended)
    with pytest.raises(
        ctr.EstimationError, match="the fit without experiment 1 did not converge after 200 iterations: no"
    ):
        fit.without(1)


def test_experiments_with_parameters_of_their_own_stay(robot, exact):
    fit = fitted(robot, noisy(exact, 1), ["experiments[1].loads[0].force"])
    with pytest.raises(ctr.EstimationError, match="belongs to one experiment"):
        fit.without(0)


def test_the_robot_of_a_fit(robot, exact):
    """Its base moved, offsets are not its own; the experiments' equilibria are those of the fit."""
    moved = robot_with(robot, {"base.translation": [1e-3, 2e-3, 3e-3]})
    fit = fitted(robot, [attrs.evolve(e, measurements=points(solve(moved, e.actuation, e.loads))) for e in exact],
                 ["base.translation"])  # fmt: skip
    np.testing.assert_allclose(fit.robot.base_pose[:3, 3], robot.base_pose[:3, 3] + [1e-3, 2e-3, 3e-3], atol=1e-9)
    for shape, experiment in zip(fit.equilibria, exact, strict=True):
        position = solve(moved, experiment.actuation, experiment.loads).tip_position
        np.testing.assert_allclose(shape.tip_position, position, atol=1e-7)
