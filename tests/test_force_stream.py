"""Loads followed through streams: against Kalman filter and batch, what is missing, late or wild, laws of error."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

import ctr_opt as ctr

RATE = 100.0  # Hz
SIGMA = 2e-4  # m


class Scene:
    """Robot B under a tip force, seen in 12 points."""

    def __init__(self):
        given = ctr.load_problem(Path("problems/three_tubes/b1.toml"))
        self.robot, self.actuation = given.robot, given.actuation
        self.problem = ctr.ForwardProblem(given.robot, compiled=True, tolerance=1e-9)
        self.shape = self.problem.solve(self.actuation)
        self.size = given.robot.tubes[0].bending_stiffness / self.shape.length**2  # N: of a force that counts
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


def test_a_linear_stream_gives_what_the_kalman_filter_does(scene):
    """Noise of a nanometre, so that forces are 1e-5 of those that bend: to 1e-4 of a standard deviation."""
    sigma, drift, wide = 1e-9, 2e-5 * scene.size, 1e-3 * scene.size
    rng = np.random.default_rng(2)
    problem = ctr.ForceEstimationProblem(scene.robot, [ctr.TipForce()], compiled=True)
    first = ctr.PositionMeasurement(scene.places, scene.shape.position(scene.places), sigma)
    at = problem.solve(scene.actuation, first)
    free = at.case.search.at(at.state.z, np.zeros(3), at.state.places, at.state.e)
    points, slopes = first.position + sigma * free.misfit.reshape(-1, 3), sigma * free.slopes
    stream = scene.estimator(drift=drift, prior=(0.0, wide), horizon=4)
    mean, spread, force = np.zeros(3), wide**2 * np.eye(3), np.zeros(3)
    for k in range(12):
        if k:
            spread = spread + drift**2 / RATE * np.eye(3)
            force = force + drift / np.sqrt(RATE) * rng.normal(size=3)
        if k in (5, 6):
            found = stream.update(scene.actuation)
        else:
            noisy = points + (slopes @ force).reshape(-1, 3) + sigma * rng.normal(size=(12, 3))
            found = stream.update(scene.actuation, ctr.PositionMeasurement(scene.places, noisy, sigma))
            innovation = (noisy - points).ravel() - slopes @ mean
            cover = slopes @ spread @ slopes.T + sigma**2 * np.eye(36)
            gain = np.linalg.solve(cover, slopes @ spread).T
            mean, spread = mean + gain @ innovation, spread - gain @ slopes @ spread
            assert found.chi_squared == pytest.approx(innovation @ np.linalg.solve(cover, innovation), rel=1e-4)
        deviations = np.sqrt(np.diag(spread))
        np.testing.assert_allclose(found.force / deviations, mean / deviations, atol=1e-4)
        np.testing.assert_allclose(found.covariance, spread, rtol=1e-4)
        assert found.time == pytest.approx(k / RATE)


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


@pytest.fixture(scope="module")
def long(scene):
    """500 samples at 100 Hz, some dropped, some late, and the normalized squared errors of the estimates."""
    rng, estimator = np.random.default_rng(6), scene.estimator()
    walk = 2.0 / np.sqrt(RATE) * np.cumsum(rng.normal(size=(500, 3)), axis=0)
    forces, squares, held = scene.size * (np.array([0.3, -0.2, 0.1]) + walk), [], None
    stream = scene.stream([scene.moved(k) for k in range(500)], forces, rng)
    for k, (actuation, seen) in enumerate(stream):
        if k == 400:
            tracemalloc.start()
        if k % 50 == 20:
            held = actuation, seen, k / RATE
            continue
        found = estimator.update(actuation, None if k % 31 == 30 else seen, k / RATE)
        if k % 50 == 22:
            found = estimator.update(*held)
        error = found.force - forces[k]
        squares.append(error @ np.linalg.solve(found.covariance, error))
    grown = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    return estimator.counts, np.array(squares), grown


def test_a_stream_of_500_samples_has_no_failure(long):
    counts = long[0]
    assert counts["left out"] == counts["too late"] == 0
    assert (counts["late"], counts["dropped"], counts.total()) == (10, 16, 500)


def test_errors_are_as_large_as_the_covariance_says(long):
    """Three on average; errors of neighbours hang together, so that the band is five of 490 independent ones' sigma."""
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
        ({"drift": {"moment": 1.0}}, "must tell that of force"),
        ({"drift": -1.0}, "must be positive"),
        ({"horizon": 2.5}, "horizon = 2.5 must be a whole number"),
        ({"horizon": 0}, "horizon = 0 must be a finite number, at least 1"),
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
    with pytest.raises(ctr.DefinitionError, match="actuation is of 1 tubes"):
        estimator.update(ctr.Actuation([0.0], [0.0]), stream[1][1])
    with pytest.raises(ctr.DefinitionError, match="sigma is needed"):
        estimator.update(scene.actuation, ctr.PositionMeasurement(None, [0.0, 0.0, 0.1]))
    assert estimator.update(*stream[1]).time == pytest.approx(1.0 / RATE)
    assert estimator.counts == {"used": 2}
