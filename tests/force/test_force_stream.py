"""Loads followed through streams: against Kalman filter and batch, what is missing, late or wild, laws of error."""

import gc
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import least_squares

import ctr_opt as ctr
from ctr_opt.estimation.experiment import Experiment
from ctr_opt.force.reach import unreachable
from ctr_opt.force.search import Search
from ctr_opt.robot.names import robot_with

RATE = 100.0  # Hz
SIGMA = 2e-4  # m


class Scene:
    """Robot B under a tip force, seen in 12 points."""

    def __init__(self):
        given = ctr.load_problem(Path("problems/three_tubes/b1.toml"))
        self.robot, self.actuation = given.robot, given.actuation
        self.problem = ctr.ForwardProblem(given.robot, compiled=True, tolerance=1e-9)
        self.shape = self.problem.solve(self.actuation)
        self.stiffness = given.robot.tubes[0].bending_stiffness
        self.size = self.stiffness / self.shape.length**2  # N: of a force that counts
        self.places = np.linspace(0.15, 0.95, 12) * self.shape.length

    def moved(self, k):
        """The actuation at tick k."""
        turns = 0.3 * np.sin(0.02 * k + np.arange(3))
        return ctr.Actuation(self.actuation.rotations + turns, self.actuation.translations - 0.003 * np.sin(0.013 * k))

    def stream(self, actuations, forces, rng):
        """Actuations, and points seen under these tip forces, with noise."""
        shapes = self.problem.solve_many(actuations, [[ctr.PointWrench(force)] for force in forces])
        return [(actuation, self.seen(shape, rng)) for actuation, shape in zip(actuations, shapes, strict=True)]

    def seen(self, shape, rng):
        """Points of a shape, with noise."""
        points = shape.position(self.places) + SIGMA * rng.normal(size=(12, 3))
        return ctr.PositionMeasurement(self.places, points, SIGMA)

    def estimator(self, **options):
        """Of the tip force, which drifts by twice its size in a second."""
        options = {"rate": RATE, "drift": 2.0 * self.size, "compiled": True} | options
        return ctr.ForceEstimator(self.robot, [ctr.TipForce()], **options)


@pytest.fixture(scope="module")
def scene():
    return Scene()


@pytest.fixture(scope="module")
def stream(scene):
    """Ten samples with the robot moving."""
    rng = np.random.default_rng(1)
    forces = scene.size * (np.array([0.6, -0.5, 0.3]) + 0.2 * np.cumsum(rng.normal(size=(10, 3)), axis=0))
    return scene.stream([scene.moved(k) for k in range(10)], forces, rng)


class Linear:
    """Noise of a nanometre, so that forces are 1e-5 of those that bend, and points seen under such forces."""

    sigma = 1e-9  # m

    def __init__(self, scene, **options):
        self.scene, self.options, self.errors = scene, options, 3 * len(options)
        self.drift, self.wide = 2e-5 * scene.size, 1e-3 * scene.size
        problem = ctr.ForceEstimationProblem(scene.robot, [ctr.TipForce()], compiled=True, **options)
        first = ctr.PositionMeasurement(scene.places, scene.shape.position(scene.places), self.sigma)
        at = problem.solve(scene.actuation, first)
        free = at.case.search.at(at.state.z, np.zeros(3), at.state.places, np.zeros(self.errors))
        self.points, self.slopes = first.position + self.sigma * free.misfit.reshape(-1, 3), self.sigma * free.slopes

    def estimator(self, **more):
        return self.scene.estimator(drift=self.drift, prior=(0.0, self.wide), **self.options, **more)

    def seen(self, forces, rng):
        """Points under each of these forces, with errors of the model that stay."""
        errors = rng.normal(size=self.errors)
        for force in forces:
            noisy = self.points + (self.slopes @ [*force, *errors]).reshape(-1, 3)
            yield ctr.PositionMeasurement(self.scene.places, noisy + self.sigma * rng.normal(size=(12, 3)), self.sigma)

    def walked(self, count, rng):
        """Forces that drift, from zero."""
        return np.cumsum(self.drift / np.sqrt(RATE) * rng.normal(size=(count, 3)), axis=0)


class Filter:
    """Kalman's, of the force and of errors that do not drift: from what came before, through the samples of a window.

    What a sample that leaves the window says of the errors is forgotten: as if their gain had been zero (Schmidt).
    """

    def __init__(self, linear, horizon):
        self.linear, self.horizon, self.window = linear, horizon, []
        self.before = None, np.zeros(3 + linear.errors), np.diag([linear.wide**2] * 3 + [1.0] * linear.errors)

    def later(self, belief, time):
        """After the walk."""
        since, mean, spread = belief
        if since is not None:
            spread = spread + np.diag([(time - since) * self.linear.drift**2] * 3 + [0.0] * self.linear.errors)
        return time, mean, spread

    def updated(self, belief, seen, learned=True):
        """By a sample, in the form of Joseph; also the innovation's square."""
        (time, mean, spread), slopes, noise = belief, self.linear.slopes, self.linear.sigma**2 * np.eye(36)
        innovation = (seen.position - self.linear.points).ravel() - slopes @ mean
        cover = slopes @ spread @ slopes.T + noise
        gain = np.linalg.solve(cover, slopes @ spread).T
        if not learned:
            gain[3:] = 0.0
        kept = np.eye(len(mean)) - gain @ slopes
        found = time, mean + gain @ innovation, kept @ spread @ kept.T + gain @ noise @ gain.T
        return found, innovation @ np.linalg.solve(cover, innovation)

    def at(self, time):
        """By all samples."""
        belief = self.before
        for when, seen in self.window:
            belief, _ = self.updated(self.later(belief, when), seen)
        return self.later(belief, time)

    def update(self, time, seen):
        """Take another sample, and tell the square of its innovation."""
        _, square = self.updated(self.at(time), seen)
        self.window.append((time, seen))
        if len(self.window) > self.horizon:
            when, oldest = self.window.pop(0)
            self.before, _ = self.updated(self.later(self.before, when), oldest, learned=False)
        return square


JOINTS = {"rotation_sigma": 2e-7, "translation_sigma": 3e-9}  # rad, m: as large as the noise of a nanometre


@pytest.mark.parametrize("options", [{}, JOINTS], ids=["exact", "errors of the actuation"])
def test_a_linear_stream_gives_what_the_kalman_filter_does(scene, options):
    """To 1e-4 of a standard deviation."""
    rng, linear = np.random.default_rng(2), Linear(scene, **options)
    stream, kalman = linear.estimator(horizon=4), Filter(linear, 4)
    for k, seen in enumerate(linear.seen(linear.walked(12, rng), rng)):
        if k in (5, 6):
            found = stream.update(scene.actuation)
        else:
            found = stream.update(scene.actuation, seen)
            assert found.chi_squared == pytest.approx(kalman.update(k / RATE, seen), rel=1e-4)
        time, mean, spread = kalman.at(k / RATE)
        deviations = np.sqrt(np.diag(spread))[:3]
        np.testing.assert_allclose(found.force / deviations, mean[:3] / deviations, atol=1e-4)
        np.testing.assert_allclose(found.covariance, spread[:3, :3], rtol=1e-4, atol=1e-6 * found.covariance.max())
        assert found.time == pytest.approx(time)


def test_errors_that_stay_are_counted_once_and_for_ever(scene):
    """Against all samples together with constant errors, by dense linear algebra.

    In the horizon no worse than the batch, and later never better, as older samples' errors are not told; without
    errors deviations are far below.
    """
    rng, linear = np.random.default_rng(8), Linear(scene, **JOINTS)
    stream, exact = linear.estimator(), Linear(scene).estimator()
    for k, seen in enumerate(linear.seen(linear.walked(60, rng), rng)):
        found, blind = (each.update(scene.actuation, seen) for each in (stream, exact))
        if k in (0, 4, 59):
            ratios = np.sqrt(eigh(found.covariance, _batch(linear, k + 1), eigvals_only=True))
            assert ratios.min() > 0.999
            assert ratios.max() < (1.001 if k < 5 else 2.2)
    assert (found.deviations > 1.2 * blind.deviations).all()


def _batch(linear, count):
    """Covariance of the last force, of so many samples that share the model's errors."""
    size = 3 * count + linear.errors
    information = np.zeros((size, size))
    information[:3, :3] = np.eye(3) / linear.wide**2
    information[3 * count :, 3 * count :] = np.eye(linear.errors)
    for k in range(count):
        rows = np.zeros((36, size))
        rows[:, 3 * k : 3 * k + 3], rows[:, 3 * count :] = linear.slopes[:, :3], linear.slopes[:, 3:]
        information += rows.T @ rows / linear.sigma**2
        if k:
            step = np.zeros((3, size))
            step[:, 3 * k - 3 : 3 * k], step[:, 3 * k : 3 * k + 3] = -np.eye(3), np.eye(3)
            information += step.T @ step / (linear.drift**2 / RATE)
    own = slice(3 * count - 3, 3 * count)
    scale = 1.0 / np.sqrt(np.diag(information))
    return (np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale))[own, own]


@pytest.fixture(scope="module")
def fit(scene):
    """Stiffness and base of the robot, from three tips with an error of 1 mm."""
    rng, experiments = np.random.default_rng(9), []
    for turn in (0.0, 1.0, 2.0):
        pose, load = ctr.Actuation(scene.actuation.rotations + turn, scene.actuation.translations), [0.1, 0.05, 0.0]
        shape = scene.problem.solve(pose, [ctr.PointWrench(load)])
        tip = ctr.PositionMeasurement(None, shape.tip_position + 1e-3 * rng.normal(size=3), 1e-3)
        experiments.append(ctr.Experiment(pose, [ctr.PointWrench(load)], [tip]))
    wanted = [ctr.Parameter("tubes[0].bending_stiffness", prior=(scene.stiffness, 0.03 * scene.stiffness))]
    return ctr.CalibrationProblem(scene.robot, experiments, [*wanted, "base.translation"], compiled=True).solve()


def drawn(scene, fit, kind, rng):
    """A robot, and by what its joints are off, as the errors that the estimator is told of have it."""
    if kind == "actuation":
        return fit.robot, 0.01 * rng.normal(size=3), 2e-4 * rng.normal(size=3)
    stiffness, *shift = rng.multivariate_normal([0.0] * 4, fit.covariance)
    changed = fit.values["tubes[0].bending_stiffness"] + stiffness
    values = {"tubes[0].bending_stiffness": changed, "base.translation": shift}
    return robot_with(fit.robot, values), np.zeros(3), np.zeros(3)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["actuation", "calibration"])
def test_errors_that_stay_are_as_large_as_the_covariance_says(scene, fit, kind):
    """Robots and joints drawn as the estimator is told, 12 streams of 50 samples; without being told it is far off.

    Samples of a stream hang together: a band of four standard deviations of five independent ones in each.
    """
    known = {"fit": fit} if kind == "calibration" else {"rotation_sigma": 0.01, "translation_sigma": 2e-4}
    squares = {"told": [], "blind": []}
    for seed in range(12):
        rng = np.random.default_rng([10, seed])
        robot, turned, moved = drawn(scene, fit, kind, rng)
        poses = [scene.moved(k) for k in range(50)]
        forces = scene.size * (0.5 * rng.normal(size=3) + 0.06 * np.cumsum(rng.normal(size=(50, 3)), axis=0))
        true = [ctr.Actuation(pose.rotations + turned, pose.translations + moved) for pose in poses]
        shapes = ctr.ForwardProblem(robot, compiled=True).solve_many(true, [[ctr.PointWrench(f)] for f in forces])
        seen = [scene.seen(shape, rng) for shape in shapes]
        for name, own in (("told", known), ("blind", {})):
            options = {"rate": RATE, "drift": 0.6 * scene.size, "prior": (0.0, scene.size), "compiled": True}
            estimator = ctr.ForceEstimator(fit.robot, ctr.TipForce(), **options, **own)
            for pose, points, force in zip(poses, seen, forces, strict=True):
                found = estimator.update(pose, points)
                error = found.force - force
                squares[name].append(error @ np.linalg.solve(found.covariance, error))
    assert abs(np.mean(squares["told"]) - 3.0) < 4.0 * np.sqrt(6.0 / 60)
    assert np.mean(squares["blind"]) > 6.0


def test_a_stream_of_one_sample_is_the_estimate_with_its_errors(scene, fit, stream):
    """Of the calibration and the actuation, as ``ForceEstimationProblem`` counts them: to a hundredth."""
    own = {"rotation_sigma": [0.01, 0.02, 0.03], "translation_sigma": 2e-4, "prior": (0.0, scene.size)}
    actuation, seen = stream[0]
    expected = ctr.ForceEstimationProblem(fit.robot, ctr.TipForce(), compiled=True, **own).solve(
        actuation, seen, fit=fit
    )
    found = ctr.ForceEstimator(fit.robot, ctr.TipForce(), rate=RATE, drift=1.0, fit=fit, **own).update(actuation, seen)
    assert np.abs((found.force - expected.force) / expected.deviations).max() < 0.01
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=0.01, atol=1e-3 * found.covariance.max())
    assert found.chi_squared == pytest.approx(expected.chi_squared, rel=1e-3)


def test_errors_keep_their_numbers_where_some_do_not_act():
    """A density acts under gravity alone, which comes and goes."""
    tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3, density=6e3)
    robot, held, falls = ctr.Robot([tube]), ctr.Actuation([0.0], [0.0]), ctr.Gravity([-9.81, 0.0, 0.0])
    places, problem = np.linspace(0.02, 0.1, 9), ctr.ForwardProblem(robot)
    shapes = {False: problem.solve(held), True: problem.solve(held, [falls])}
    experiments = [
        ctr.Experiment(held, [falls], [ctr.PositionMeasurement(places, shapes[True].position(places), 1e-4)])
    ]
    fit = ctr.CalibrationProblem(robot, experiments, ["tubes[0].density", "base.translation"]).solve()
    stream = ctr.ForceEstimator(fit.robot, ctr.TipForce(), rate=RATE, drift=0.1, fit=fit)
    for down in (False, True, False, True):
        seen = ctr.PositionMeasurement(places, shapes[down].position(places), 1e-4)
        found = stream.update(held, seen, loads=[falls] if down else [])
    assert stream.counts == {"used": 4}
    assert np.abs(found.force / found.deviations).max() < 0.1


def test_a_window_that_holds_everything_is_the_batch_solution(scene, stream):
    """SciPy over forward solves, all forces at once: to 0.02 standard deviations, as samples are linearized to 0.01."""
    stream, step = stream[:4], 2.0 * scene.size / np.sqrt(RATE)
    estimator = scene.estimator(prior=(0.0, scene.size), horizon=4)
    for actuation, seen in stream:
        found = estimator.update(actuation, seen)

    def residuals(forces):
        forces = forces.reshape(-1, 3)
        misfits = [
            scene.problem.solve(actuation, [ctr.PointWrench(force)]).position(scene.places) - seen.position
            for (actuation, seen), force in zip(stream, forces, strict=True)
        ]
        walk = np.diff(forces, axis=0) / step
        return np.concatenate((np.ravel(misfits) / SIGMA, walk.ravel(), forces[0] / scene.size))

    batch = least_squares(residuals, found.window_estimates.ravel(), x_scale=scene.size, xtol=1e-8)
    covariance = np.linalg.inv(batch.jac.T @ batch.jac)
    off = (found.window_estimates.ravel() - batch.x) / np.sqrt(np.diag(covariance))
    assert np.abs(off).max() < 0.02
    np.testing.assert_allclose(found.covariance, covariance[-3:, -3:], rtol=0.05, atol=1e-3 * found.covariance.max())


def test_dropped_samples_widen_the_estimate_as_the_walk_does(scene, stream):
    """Exactly: nothing else is known."""
    estimator = scene.estimator()
    before = [estimator.update(*each) for each in stream[:3]][-1]
    found = [estimator.update(scene.moved(k), nothing) for k, nothing in ((3, None), (4, []))][-1]
    np.testing.assert_array_equal(found.force, before.force)
    expected = before.covariance + 2.0 / RATE * (2.0 * scene.size) ** 2 * np.eye(3)
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-10)
    assert (found.status, found.samples, np.isnan(found.p_value)) == ("dropped", 3, True)
    assert estimator.counts == {"used": 3, "dropped": 2}


def test_late_samples_are_sorted_in(scene, stream):
    """The estimate is as if they had come in time, to 0.02 standard deviations."""
    in_time, late = scene.estimator(horizon=10), scene.estimator(horizon=10)
    expected = [in_time.update(*each, time=k / RATE) for k, each in enumerate(stream)][-1]
    found = {k: late.update(*stream[k], time=k / RATE) for k in (0, 1, 3, 4, 2, 6, 7, 8, 9, 5)}
    assert np.abs((found[5].force - expected.force) / expected.deviations).max() < 0.02
    np.testing.assert_allclose(found[5].window_times, expected.window_times)
    assert found[5].time == expected.time
    assert late.counts == {"used": 8, "late": 2}


def test_what_is_older_than_the_horizon_is_kept_out(scene, stream):
    estimator = scene.estimator(horizon=3)
    before = [estimator.update(*each) for each in stream][-1]
    found = estimator.update(*stream[2], time=2.0 / RATE)
    assert (found.status, found.time, found.samples) == ("too late", before.time, 3)
    np.testing.assert_array_equal(found.force, before.force)
    assert estimator.counts["too late"] == 1


@pytest.mark.parametrize("distance", [0.03, 1.0, 1e6], ids=lambda x: f"{x:g} m")
def test_a_wild_sample_is_left_out(scene, stream, distance):
    """The estimate is predicted over it, and the next sample is used."""
    estimator = scene.estimator()
    before = [estimator.update(*each) for each in stream[:5]][-1]
    noise = distance * np.random.default_rng(3).normal(size=(12, 3))
    wild = ctr.PositionMeasurement(scene.places, stream[5][1].position + noise, SIGMA)
    found = estimator.update(stream[5][0], wild)
    assert found.status == "left out"
    np.testing.assert_array_equal(found.force, before.force)
    assert (found.deviations > before.deviations).all()
    assert estimator.update(*stream[6]).status == "used"


@pytest.mark.parametrize("alone", [False, True], ids=["all points", "one point"])
def test_a_burst_of_wild_samples_is_left_out_cheaply(scene, stream, alone, monkeypatch):
    """Ten in a row, each by the look at three states at most: no backbone reaches so far."""
    rng, estimator = np.random.default_rng(11), scene.estimator()
    for each in stream[:3]:
        estimator.update(*each)
    looks, at = [], Search.at
    monkeypatch.setattr(Search, "at", lambda *given: looks.append(given) or at(*given))
    for k in range(10):
        noise = 0.2 * rng.normal(size=(12, 3))
        noise[np.arange(12) != k] *= not alone
        wild = ctr.PositionMeasurement(scene.places, stream[3][1].position + noise, SIGMA)
        assert estimator.update(stream[3][0], wild).status == "left out"
    assert len(looks) <= 30
    assert estimator.update(*stream[4]).status == "used"


def test_what_no_backbone_reaches_is_reported_exactly():
    """Two points 30 mm farther apart than the arc between them, a third in reach; none is far from the entry point."""
    robot = ctr.Robot([ctr.Tube("rod", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)])
    points = [[0.0, 0.0, 0.02], [0.0, 0.05, 0.02], [0.0, 0.0, 0.06]]
    seen = ctr.PositionMeasurement([0.06, 0.08, 0.1], points, [1e-3, 2e-3, 1e-3])
    experiment = Experiment(ctr.Actuation([0.0], [0.0]), [], [seen])
    assert unreachable(robot, experiment, np.array([0.1]), based=True) == pytest.approx(0.03**2 / (2 * 2e-3**2))
    far = Experiment(ctr.Actuation([0.0], [0.0]), [], [ctr.PositionMeasurement(0.1, [0.0, 0.0, 0.15], 1e-3)])
    assert unreachable(robot, far, np.array([0.1]), based=True) == pytest.approx(50.0**2)
    assert unreachable(robot, far, np.array([0.1]), based=False) == 0.0


def test_a_jump_of_the_force_is_not_left_out(scene):
    """By ten characteristic forces, in ten directions."""
    rng = np.random.default_rng(12)
    for direction in rng.normal(size=(10, 3)):
        low = 0.5 * scene.size * rng.normal(size=3)
        high = low + 10.0 * scene.size * direction / np.linalg.norm(direction)
        estimator = scene.estimator()
        for each in scene.stream([scene.actuation] * 6, [low] * 3 + [high] * 3, rng):
            estimator.update(*each)
        assert estimator.counts == {"used": 6}


def test_points_somewhere_are_followed(scene):
    """Others in each sample, as many: places do not start where those of the sample before were."""
    rng, estimator, force = np.random.default_rng(13), scene.estimator(), scene.size * np.array([0.5, -0.4, 0.2])
    for k in range(8):
        shape = scene.problem.solve(scene.moved(k), [ctr.PointWrench(force)])
        points = shape.position(np.sort(rng.uniform(0.1, 1.0, 12)) * shape.length) + SIGMA * rng.normal(size=(12, 3))
        found = estimator.update(scene.moved(k), ctr.BackboneMeasurement(points, SIGMA))
    assert estimator.counts == {"used": 8}
    assert np.abs((found.force - force) / found.deviations).max() < 4.0


def test_a_force_along_a_normal_is_reported_as_a_vector(scene):
    rng = np.random.default_rng(14)
    unknown = ctr.PointForce(0.1, normal=[0.0, 2.0, 0.0])
    estimator = ctr.ForceEstimator(scene.robot, unknown, rate=RATE, drift=scene.size, compiled=True)
    for _ in range(3):
        shape = scene.problem.solve(scene.actuation, [ctr.PointWrench([0.0, scene.size, 0.0], arc_length=0.1)])
        found = estimator.update(scene.actuation, scene.seen(shape, rng))
    assert found.labels == ("normal_force",)
    np.testing.assert_allclose(found.force, [0.0, found.estimates[0], 0.0])
    np.testing.assert_allclose(np.diag(found.force_covariance), [0.0, found.covariance[0, 0], 0.0])
    assert abs(found.force[1] - scene.size) < 4.0 * found.deviations[0]


def test_friction_is_refused(scene):
    cone = ctr.PointForce(0.1, normal=[1.0, 0.0, 0.0], friction=0.3)
    with pytest.raises(ctr.DefinitionError, match=r"unknown\[0\].friction = 0.3 is not supported"):
        ctr.ForceEstimator(scene.robot, cone, rate=RATE, drift=1.0)


def test_a_step_of_the_force_is_found_again(scene):
    """Seven times what it drifts in a period: within four standard deviations after five samples, and it shows."""
    rng, estimator = np.random.default_rng(4), scene.estimator()
    low, high = scene.size * np.array([[0.2, 0.1, 0.0], [1.5, -1.5, -1.0]])
    stream = scene.stream([scene.moved(k) for k in range(10)], [low] * 5 + [high] * 5, rng)
    found = [estimator.update(*each) for each in stream]
    assert found[5].p_value < 1e-6 < 1e-3 < found[4].p_value
    assert np.abs((found[9].force - high) / found[9].deviations).max() < 4.0
    assert estimator.counts == {"used": 10}


def test_a_jump_of_the_actuation_is_survived(scene):
    rng, estimator, force = np.random.default_rng(5), scene.estimator(), scene.size * np.array([0.5, -0.4, 0.2])
    turned = ctr.Actuation(scene.actuation.rotations + np.array([2.5, -1.5, 2.0]), scene.actuation.translations)
    for each in scene.stream([scene.actuation] * 3 + [turned] * 3, [force] * 6, rng):
        found = estimator.update(*each)
    assert np.abs((found.force - force) / found.deviations).max() < 4.0
    assert estimator.counts == {"used": 6}


@pytest.fixture(scope="module", params=[150, pytest.param(500, marks=pytest.mark.slow)])
def long(scene, request):
    """Samples at 100 Hz, some dropped, some late, and the normalized squared errors of the estimates."""
    count = request.param
    rng, estimator = np.random.default_rng(6), scene.estimator()
    walk = 2.0 / np.sqrt(RATE) * np.cumsum(rng.normal(size=(count, 3)), axis=0)
    forces, squares, held = scene.size * (np.array([0.3, -0.2, 0.1]) + walk), [], None
    stream = scene.stream([scene.moved(k) for k in range(count)], forces, rng)
    for k, (actuation, seen) in enumerate(stream):
        if k == count - 100:
            tracemalloc.start()
        if k % 50 == 20:
            held = actuation, seen, k / RATE
            continue
        found = estimator.update(actuation, None if k % 31 == 30 else seen, k / RATE)
        if k % 50 == 22:
            found = estimator.update(*held)
        error = found.force - forces[k]
        squares.append(error @ np.linalg.solve(found.covariance, error))
    gc.collect()  # garbage that waits for its collection is not there any more
    grown = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    return estimator.counts, np.array(squares), grown


def test_a_long_stream_has_no_failure(long):
    counts = long[0]
    assert counts["left out"] == counts["too late"] == 0
    assert (counts["late"], counts["dropped"]) == {150: (3, 4), 500: (10, 16)}[counts.total()]


def test_errors_are_as_large_as_the_covariance_says(long):
    """Three on average; errors of neighbours hang together, so that the band is five sigma of independent ones."""
    assert abs(long[1].mean() - 3.0) < 5.0 * np.sqrt(6.0 / len(long[1]))


def test_memory_does_not_grow(long):
    """What was made in the last 100 samples and is still there is a window of five."""
    assert long[2] < 100_000  # bytes


def test_both_kinds_of_model_agree(scene, stream):
    """To a hundredth of a standard deviation."""
    both = [scene.estimator(compiled=compiled) for compiled in (True, False)]
    found = [[each.update(*sample) for sample in stream[:2]][-1] for each in both]
    assert np.abs((found[0].force - found[1].force) / found[0].deviations).max() < 0.01


def test_a_contact_that_moves_is_followed(scene):
    """Force and place along the robot: within four standard deviations."""
    rng = np.random.default_rng(7)
    estimator = ctr.ForceEstimator(
        scene.robot, ctr.PointForce(), rate=RATE, drift={"force": scene.size, "arc_length": 0.02}, compiled=True
    )
    force = scene.size * np.array([1.5, 1.5, 0.0])
    for k in range(10):
        s = (0.75 + 0.002 * k) * scene.shape.length
        shape = scene.problem.solve(scene.actuation, [ctr.PointWrench(force, arc_length=s)])
        found = estimator.update(scene.actuation, scene.seen(shape, rng))
    assert found.labels == ("force.x", "force.y", "force.z", "arc_length")
    assert np.abs((found.estimates - [*force, s]) / found.deviations).max() < 4.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": 0.0}, "rate = 0 Hz must be a finite number in Hz, above 0"),
        ({"drift": {"moment": 1.0}}, "must be a mapping with the keys force"),
        ({"drift": -1.0}, "must be positive"),
        ({"horizon": 2.5}, "horizon = 2.5 must be a whole number"),
        ({"horizon": 0}, "horizon = 0 must be a whole number, at least 1"),
        ({"outlier": 0.0}, "outlier = 0 must be"),
    ],
)
def test_wrong_options_are_errors(scene, options, message):
    with pytest.raises(ctr.DefinitionError, match=message):
        scene.estimator(**options)


def test_wrong_calls_are_errors_and_leave_the_estimator_alone(scene, stream):
    estimator = scene.estimator()
    estimator.update(*stream[0])
    with pytest.raises(ctr.DefinitionError, match="time = 'now' must be a finite number in s"):
        estimator.update(*stream[1], time="now")
    with pytest.raises(ctr.DefinitionError, match="actuation is for 1 tubes"):
        estimator.update(ctr.Actuation([0.0], [0.0]), stream[1][1])
    with pytest.raises(ctr.DefinitionError, match="sigma is required"):
        estimator.update(scene.actuation, ctr.PositionMeasurement(None, [0.0, 0.0, 0.1]))
    assert estimator.update(*stream[1]).time == pytest.approx(1.0 / RATE)
    assert estimator.counts == {"used": 2}
