"""Points somewhere on the backbone: against arc lengths that are known, and fits and information found another way."""

from itertools import combinations_with_replacement

import attrs
import numpy as np
import pytest
from scipy.optimize import approx_fprime, least_squares, minimize

import ctr_opt as ctr
from ctr_opt.estimation.losses import Loss
from ctr_opt.estimation.places import _in_order, free, moved
from ctr_opt.robot.names import robot_with
from tests.support.estimated import actuations, experiments, flat, off_by, small_robot, solve
from tests.support.slow import some_slow

SIGMA = 5e-4
NAMES = ["tubes[0].bending_stiffness", "tubes[0].rotation_offset"]
EACH = [("simultaneous", True), ("reduced", True), ("simultaneous", False), ("reduced", False)]
NAMES_OF_WAYS = {True: "compiled", False: "virtual machine"}
WAYS = pytest.mark.parametrize(("method", "compiled"), EACH, ids=lambda way: NAMES_OF_WAYS.get(way, way))


def scanned(robot, count, points, seed, *, noise=SIGMA, ordered=False, least=0.05, most=0.97):
    """Experiments with points at seeded arc lengths, in order, which are recorded too."""
    rng = np.random.default_rng(seed)
    found, places = [], []
    for each in experiments(robot, count, seed, noise=False, size=0.5):
        shape = solve(robot, each.actuation, each.loads, 1e-11)
        s = np.sort(rng.uniform(least, most, points)) * shape.length
        at = shape.position(s) + noise * rng.normal(size=(points, 3))
        found.append(attrs.evolve(each, measurements=[ctr.BackboneMeasurement(at, SIGMA, ordered)]))
        places.append(s)
    return found, np.concatenate(places)


def fitted(robot, data, names=NAMES, method="simultaneous", compiled=True, loss="squared"):
    start = off_by(robot, {NAMES[0]: 1.15})
    return ctr.CalibrationProblem(start, data, names, loss=loss, tolerance=1e-9, compiled=compiled).solve(method=method)


def reported(fit):
    return np.array([each.arc_length for each in fit.residuals])


def truth(robot):
    return np.array([robot.tubes[0].bending_stiffness, 0.0])


# -- answers found another way ----------------------------------------------------------------------------------------


@WAYS
def test_exact_points_tell_where_they_are(method, compiled):
    """And the parameters, to the tolerance of the solves; in and out of order."""
    robot = small_robot(2)
    data, places = scanned(robot, 2, 7, 1, noise=0.0, ordered=True)
    mixed = np.random.default_rng(2).permutation(7)
    (measured,) = data[1].measurements
    data[1] = attrs.evolve(
        data[1], measurements=[attrs.evolve(measured, position=measured.position[mixed], ordered=False)]
    )
    places[7:] = places[7:][mixed]
    fit = fitted(robot, data, method=method, compiled=compiled)
    np.testing.assert_allclose(flat(fit.values), truth(robot), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(reported(fit), places, rtol=0.0, atol=1e-6 * 0.1)


class Independent:
    """Whitened residuals over parameters and arc lengths by forward solves, and their least squares."""

    def __init__(self, robot, data):
        self.robot, self.data = robot, data
        self.scale = np.array([robot.tubes[0].bending_stiffness, 1.0])
        self.shapes = [solve(robot, each.actuation, each.loads, 1e-11) for each in data]

    def residuals(self, numbers):
        values, s = self.scale * numbers[:2], np.split(numbers[2:], len(self.data))
        problem = ctr.ForwardProblem(robot_with(self.robot, {NAMES[0]: values[0]}), tolerance=1e-11)
        parts = []
        for each, own, start in zip(self.data, s, self.shapes, strict=True):
            turned = attrs.evolve(each.actuation, rotations=each.actuation.rotations + values[1] * np.eye(2)[0])
            at = problem.solve(turned, each.loads, initial=start).position(own)
            parts.append((at - each.measurements[0].position).ravel() / SIGMA)
        return np.concatenate(parts)

    def fit(self, places):
        start = np.concatenate(([1.0, 0.0], places))
        return least_squares(self.residuals, start, "3-point", x_scale=np.r_[0.1, 0.1, 1e-3 + 0.0 * places], ftol=1e-15)


@pytest.fixture(scope="module")
def noisy():
    robot = small_robot(2)
    data, places = scanned(robot, 2, 5, 3)
    independent = Independent(robot, data)
    return robot, data, independent, independent.fit(places)


@pytest.mark.parametrize(("method", "compiled"), some_slow(EACH, EACH[2:]), ids=lambda way: NAMES_OF_WAYS.get(way, way))
def test_noisy_points_are_fitted_as_by_least_squares_over_all(noisy, method, compiled):
    """Both stop where their gradients are 1e-6 of a standard error or less from zero; so does what they say of errors.

    The marginal of the whole information, of differences, is within 1e-5 of theirs.
    """
    robot, data, independent, wanted = noisy
    fit = fitted(robot, data, method=method, compiled=compiled)
    values = flat(fit.values) / independent.scale
    errors = np.sqrt(np.diag(np.linalg.inv(wanted.jac.T @ wanted.jac)))
    assert np.abs((values - wanted.x[:2]) / errors[:2]).max() < 1e-5
    np.testing.assert_allclose(reported(fit), wanted.x[2:], rtol=0.0, atol=1e-5 * errors[2:].max())
    np.testing.assert_allclose(fit.chi_squared, 2.0 * wanted.cost, rtol=1e-8)
    marginal = np.linalg.inv(wanted.jac.T @ wanted.jac)[:2, :2]
    np.testing.assert_allclose(fit.covariance, marginal * np.outer(independent.scale, independent.scale), rtol=1e-4)
    assert fit.degrees_of_freedom == 2 * 5 * 3 - 2 * 5 - 2
    assert fit.labels == NAMES
    assert list(fit.values) == list(fit.standard_errors) == fit.names == NAMES


# -- order, ends ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("loss", some_slow(["squared", "huber"], ["squared"]))
def test_order_is_kept_where_noise_breaks_it(loss):
    """Fourteen points, 6 mm apart: arc lengths are the best ones in order on the shape found, by SLSQP to 1e-7."""
    robot = small_robot(2)
    data, _ = scanned(robot, 1, 14, 5, noise=3.0 * SIGMA, ordered=True)
    (measured,) = data[0].measurements
    loose = attrs.evolve(data[0], measurements=[attrs.evolve(measured, ordered=False)])
    fit, other = (fitted(robot, [each], NAMES[:1], loss=loss) for each in (data[0], loose))
    assert (np.diff(reported(other)) < 0.0).any()
    assert (np.diff(reported(fit)) >= 0.0).all()
    assert fit.objective > other.objective
    pooled = int((np.diff(reported(fit)) == 0.0).sum())
    assert pooled
    assert fit.degrees_of_freedom == other.degrees_of_freedom + pooled
    (shape,) = fit.equilibria
    threshold = min(Loss(fit.estimation.loss, 3).threshold, 1e3)  # that of squares is infinite

    def cost(s):
        squared = ((shape.position(np.clip(s, 0.0, 1.0) * shape.length) - measured.position) ** 2).sum(1) / SIGMA**2
        far = squared > threshold**2
        return np.where(far, threshold * np.sqrt(squared) - 0.5 * threshold**2, 0.5 * squared).sum()

    steps = {"type": "ineq", "fun": np.diff, "jac": lambda _: np.diff(np.eye(14), axis=0)}
    start = reported(fit) / shape.length + 2e-3 * np.arange(-7, 7)
    best = minimize(cost, start, method="SLSQP", constraints=steps, options={"ftol": 1e-13, "maxiter": 200})
    np.testing.assert_allclose(fit.objective, best.fun, rtol=1e-7)


def test_points_beyond_the_tip_are_measured_at_the_tip():
    """5 mm ahead of it along its tangent, and behind the entry point: not estimated, so not counted."""
    robot = small_robot(2)
    data, _ = scanned(robot, 2, 5, 6, noise=0.0)
    for k, each in enumerate(data):
        shape = solve(robot, each.actuation, each.loads, 1e-11)
        beyond = shape.tip_pose @ [0.0, 0.0, 5e-3, 1.0], shape.pose(0.0) @ [0.0, 0.0, -5e-3, 1.0]
        position = np.vstack((each.measurements[0].position, [point[:3] for point in beyond]))
        data[k] = attrs.evolve(each, measurements=[ctr.BackboneMeasurement(position, SIGMA)])
    for method in ("simultaneous", "reduced"):
        fit = fitted(robot, data, method=method)
        for equilibrium, own in zip(fit.equilibria, np.split(reported(fit), 2), strict=True):
            np.testing.assert_array_equal(own[5:], [equilibrium.length, 0.0])
        assert fit.degrees_of_freedom == 2 * 7 * 3 - 2 * 5 - 2
        np.testing.assert_allclose([fit.residuals[k].size for k in (5, 6)], 5e-3, rtol=0.0, atol=5e-4)


@pytest.mark.parametrize("method", ["simultaneous", "reduced"])
@pytest.mark.parametrize("name", ["tubes[0].precurvature[1].length", "tubes[0].translation_offset"])
def test_the_tip_may_move(name, method):
    """With a tube's length or its base: found from exact points, of which one is the tip, from 4 mm off."""
    robot, rng = small_robot(2), np.random.default_rng(7)
    data, places = [], []
    for actuation in actuations(rng, robot, 2):
        shape = solve(robot, actuation, [ctr.PointWrench([0.2, -0.1, 0.1])], 1e-11)
        places.append(np.array([0.2, 0.45, 0.7, 1.0]) * shape.length)
        on = ctr.BackboneMeasurement(shape.position(places[-1]), SIGMA, ordered=True)
        data.append(ctr.Experiment(actuation, shape.loads, [on]))
    wanted = robot.tubes[0].precurvature[1].length if "length" in name else 0.0
    unknown = ctr.Parameter(name, initial=wanted - 4e-3, scale=0.01)
    fit = ctr.CalibrationProblem(robot, data, [unknown], tolerance=1e-9, compiled=True).solve(method=method)
    np.testing.assert_allclose(fit.values[name], wanted, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(reported(fit), np.concatenate(places), rtol=0.0, atol=1e-7)


def test_the_tip_may_pass_from_tube_to_tube():
    """Two ends together, one of which moves by an offset to a point 1 mm ahead: all ways agree, errors to 1e-6."""
    robot = small_robot(2)
    held = ctr.Actuation([0.4, -0.3], 0.07 - np.array([tube.length for tube in robot.tubes]))
    shape = solve(robot, held, [ctr.PointWrench([0.2, -0.1, 0.1])], 1e-11)
    ahead = shape.tip_pose @ [0.0, 0.0, 1e-3, 1.0]
    on = ctr.BackboneMeasurement(np.vstack((shape.position([0.03, 0.05, 0.07]), ahead[:3])), SIGMA)
    data = [ctr.Experiment(held, shape.loads, [on])]
    unknown = ctr.Parameter("tubes[1].translation_offset", scale=0.01)
    fits = [
        ctr.CalibrationProblem(robot, data, [unknown], tolerance=1e-9, compiled=compiled).solve(method=method)
        for compiled in (True, False)
        for method in ("simultaneous", "reduced")
    ]
    for fit in fits:
        np.testing.assert_allclose(flat(fit.values), flat(fits[0].values), rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(fit.deviations, fits[0].deviations, rtol=1e-6)
        assert reported(fit)[3] == pytest.approx(0.07 + flat(fit.values)[0], abs=1e-12)
    np.testing.assert_allclose(fits[0].deviations, SIGMA, rtol=0.2)  # as of the one point at the tip


# -- everything else a fit does ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def many():
    robot = small_robot(2)
    data, _ = scanned(robot, 5, 6, 11)
    return robot, data, fitted(robot, data, method="reduced")


def test_slopes_are_differences(many):
    """Of misfits by parameters, base moments and places, one experiment's robot longer by an offset: 1e-6 of a size."""
    robot, data, _ = many
    names = [*NAMES, "tubes[0].translation_offset"]
    for compiled in (True, False):
        fit = ctr.CalibrationProblem(robot, data[:2], names, tolerance=1e-9, compiled=compiled).nominal()
        made, x, states = fit.estimation, fit.estimation.unknowns.initial, fit.outcome.states
        (here, _) = made.linearize(x, states)
        scale = made.unknowns.scale[made.layouts[0].acting]
        both = np.hstack((here.misfit_x * scale, here.misfit_z * made.units[0], here.misfit_s))
        size = np.concatenate((scale, made.units[0], np.ones(6)))

        def misfit(v, made=made, x=x, states=states, size=size):
            step = v * size
            return made.linearize(x + step[: len(x)], [states[0] + step[len(x) :], states[1]])[0].misfit

        ahead, back = (approx_fprime(np.zeros(len(size)), misfit, sign * 1e-5) for sign in (1.0, -1.0))
        np.testing.assert_allclose(both, 0.5 * (ahead + back), rtol=0.0, atol=1e-6 * np.abs(both).max())


def test_leaving_out_and_holding_out(many):
    """Points go with their experiment; influence is the change of the estimates, from one step of Newton's: 30 %."""
    robot, data, fit = many
    assert fit.noise_accepted
    other = fit.without(1)
    np.testing.assert_allclose(
        flat(other.values), flat(fitted(robot, data[:1] + data[2:]).values), rtol=1e-5, atol=1e-6
    )
    change = flat(other.values) - flat(fit.values)
    np.testing.assert_allclose(fit.influence[1], change @ np.linalg.solve(fit.covariance, change) / 2.0, rtol=0.3)
    held = fit.errors_without(1)
    assert [each.experiment for each in held] == [1] * 6
    shape = solve(other.robot, *fit.estimation.unknowns.experiment_at(other.outcome.x, 1), 1e-11)
    for each, point in zip(held, data[1].measurements[0].position, strict=True):
        s = np.linspace(-1e-5, 1e-5, 3) + each.arc_length  # a foot of the perpendicular
        near = np.linalg.norm(shape.position(s) - point, axis=1)
        np.testing.assert_allclose(each.size, near[1], rtol=1e-6)
        assert near[1] <= near.min() + 1e-12


def test_profiles_and_bootstrap(many):
    """Half the squared distance in standard errors, to 10 % within one of them; spread within a factor of two."""
    _, _, fit = many
    values, costs = fit.profile(NAMES[0], count=3, width=1.0)
    wanted = 0.5 * ((values - fit.values[NAMES[0]]) / fit.standard_errors[NAMES[0]]) ** 2
    np.testing.assert_allclose(costs, wanted, rtol=0.1, atol=1e-6)
    drawn = fit.bootstrap(15, seed=1)
    assert drawn.shape == (15, 2)
    ratio = drawn.std(axis=0) / fit.deviations
    assert ((ratio > 0.5) & (ratio < 2.0)).all()


@pytest.mark.parametrize("loss", ["huber", "cauchy", "distance"])
def test_outlying_points(many, loss):
    """A tenth of the points 10 mm off: within three standard errors with losses for that, which both ways find."""
    robot, data, _ = many
    rng, spoiled = np.random.default_rng(1), []
    for each in data:
        position = np.array(each.measurements[0].position)
        position[3] += 0.01 * np.array([0.6, -0.64, 0.48]) * rng.choice([-1.0, 1.0])
        spoiled.append(attrs.evolve(each, measurements=[ctr.BackboneMeasurement(position, SIGMA)]))
    fits = [fitted(robot, spoiled, method=method, loss=loss) for method in ("simultaneous", "reduced")]
    np.testing.assert_allclose(*(flat(fit.values) / fits[0].deviations for fit in fits), rtol=0.0, atol=1e-3)
    off = flat(fits[0].values) - truth(robot)
    assert (np.abs(off) < 3.0 * fits[0].deviations).all()


def test_beside_other_measurements_and_parameters(many):
    """Two scans, one of them ordered, a tip and a torque; an experiment's own load is estimated and reported."""
    robot, data, _ = many
    each = data[1]
    shape = solve(robot, each.actuation, each.loads, 1e-11)
    s = np.linspace(0.2, 0.9, 5) * shape.length
    fine = 0.1 * SIGMA
    measured = [
        ctr.BackboneMeasurement(shape.position(s[::-1]), fine),
        ctr.PositionMeasurement(None, shape.tip_position, fine),
        ctr.BackboneMeasurement(shape.position(s), fine, ordered=True),
        ctr.TorqueMeasurement(1, shape.actuator_wrench(1)[1], 1e-4),
    ]
    pushed = ctr.PointWrench(np.array(each.loads[0].force) + 0.05)
    one = ctr.Experiment(each.actuation, [pushed], measured)
    fit = ctr.CalibrationProblem(robot, [one], ["experiments[0].loads[0].force"], tolerance=1e-9, compiled=True).solve()
    np.testing.assert_allclose(flat(fit.values), each.loads[0].force, rtol=1e-6)
    np.testing.assert_allclose(reported(fit)[:11], [*s[::-1], shape.length, *s], rtol=0.0, atol=1e-7)
    assert "arc lengths           10 of points on the backbone" in fit.report()
    assert "somewhere along it    mean 0.000" in fit.report()
    assert "measurements" not in "".join(fit.labels)


# -- places -----------------------------------------------------------------------------------------------------------


def test_first_places_in_order_are_the_best():
    """Of all sequences of four columns of five that do not fall."""
    costs = np.random.default_rng(0).uniform(size=(4, 5))
    found = _in_order(costs)
    sums = {those: costs[np.arange(4), those].sum() for those in combinations_with_replacement(range(5), 4)}
    assert tuple(found) == min(sums, key=sums.get)


def test_steps_and_free_ways_of_places():
    """The second and third change places and are pooled by their weights; the last is held at the tip."""
    found = moved(
        np.array([0.1, 0.5, 0.6, 0.9]),
        np.array([0.0, -2.0, 0.2, -1.0]),
        np.array([1.0, 10.0, 1.0, 2.0]),
        ((0, 4, True),),
    )
    np.testing.assert_allclose(found, [0.1, 7.4 / 11.0, 7.4 / 11.0, 1.0], rtol=1e-14)
    wanted = np.zeros((4, 4))
    wanted[0, 0] = wanted[1, 1] = wanted[2, 1] = 1.0
    np.testing.assert_array_equal(free(found, ((0, 4, True),)), wanted)
    np.testing.assert_array_equal(free(found, ((0, 4, False),)), np.diag([1.0, 1.0, 1.0, 0.0]))


# -- wrong input ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.0, 0.0, 0.1],), "position"),
        ((np.zeros((0, 3)),), "must hold at least one point"),
        (([[0.0, 0.0]],), "position"),
        (([[0.0, 0.0, np.nan]],), "position"),
        (([[0.0, 0.0, 0.1]], -1.0), "sigma = -1 must be"),
        (([[0.0, 0.0, 0.1]], 1e-3, 1), "ordered = 1 must be True or False"),
    ],
)
def test_wrong_points_are_reported(arguments, message):
    with pytest.raises(ctr.DefinitionError, match=message):
        ctr.BackboneMeasurement(*arguments)
