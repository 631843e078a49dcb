"""Reports and figures of every kind of unknown load, and the band of the shape that is estimated with them."""

import numpy as np
import pytest
from scipy.stats import chi2

import ctr_opt as ctr
from ctr_opt.force.plot import widened
from tests.support.slow import some_slow

SIGMA = 2e-4  # m
LOOSE = {"rotation_sigma": 0.01, "translation_sigma": 2e-4}  # rad, m
UNKNOWN = {
    "tip force": ctr.TipForce(),
    "tip wrench": ctr.TipWrench(prior=(0.0, [1.0] * 3 + [0.01] * 3)),
    "two forces": [ctr.TipForce(prior=(0.0, 1.0)), ctr.PointForce(0.05)],
    "contact": ctr.PointForce(prior=(0.0, 1.0)),
    "surface": ctr.PointForce(0.163, normal=[1.0, -2.0, 0.0]),
    "friction": ctr.PointForce(0.163, normal=[1.0, -2.0, 0.0], friction=0.2),
    "contacts": ctr.Contacts(most=2, prior=(0.0, 1.0)),
    "distributed": ctr.DistributedForce(6, prior=(0.0, 5.0)),
    "both": [ctr.TipForce(prior=(0.0, 1.0)), ctr.DistributedForce(6, end=0.1, smoothness=1e-4, prior=(0.0, 5.0))],
}

pytestmark = pytest.mark.usefixtures("compiling")


@pytest.fixture(scope="module")
def given():
    problem = ctr.load_problem("problems/three_tubes/b1.toml")
    force = np.array([0.1, -0.2, 0.05])
    return problem.robot, problem.actuation, problem_shape(problem.robot, problem.actuation, force), force


def problem_shape(robot, actuation, force):
    return ctr.ForwardProblem(robot, tolerance=1e-10).solve(actuation, [ctr.PointWrench(force)])


def seen(shape, seed=0, count=20):
    s = np.linspace(0.1, 1.0, count) * shape.length
    noise = SIGMA * np.random.default_rng(seed).normal(size=(count, 3))
    return ctr.PositionMeasurement(s, shape.position(s) + noise, SIGMA)


@pytest.mark.parametrize("kind", UNKNOWN)
def test_every_estimate_tells_and_draws_itself(given, kind, tmp_path):
    robot, actuation, shape, _ = given
    estimate = ctr.ForceEstimationProblem(robot, UNKNOWN[kind]).solve(actuation, seen(shape))
    text = estimate.report()
    assert "consistent with model and noise" in text
    assert "shift of the base" in text
    assert ("force per length" in text) == bool(estimate.distributed)
    assert "force_density" not in text
    assert "nan" not in text
    figure = estimate.plot()
    assert len(figure.axes) == 3 + 3 * (len(estimate.distributed) < len(np.atleast_2d(estimate.force))) + 3 * len(
        estimate.distributed
    )
    figure.savefig(tmp_path / "figure.png")
    assert len(repr(estimate)) < 400
    assert len(estimate.systematic[0].rates) == len(estimate.labels)
    assert estimate.systematic[0].force_rate.shape == estimate.force.shape


def test_errors_of_the_base_add_to_a_distributed_force_what_they_are_said_to(given):
    """The total, against an estimate from points of a robot that stands 20 um beside: to 1 % of first order."""
    robot, actuation, shape, _ = given
    force = ctr.DistributedForce(6, smoothness=1e-3, prior=(0.0, 5.0))
    problem = ctr.ForceEstimationProblem(robot, force, tolerance=1e-9)
    before = seen(shape)
    beside = ctr.PositionMeasurement(before.arc_length, before.position + np.array([2e-5, 0.0, 0.0]), SIGMA)
    estimate, other = (problem.solve(actuation, each) for each in (before, beside))
    (reported,) = (each for each in estimate.systematic if each.description == "shift of the base along x")
    np.testing.assert_allclose(
        (other.force - estimate.force) / 2e-5,
        reported.force_rate,
        rtol=0.01,
        atol=0.01 * np.linalg.norm(reported.force_rate),
    )


def test_the_band_follows_from_compliances(given):
    """``C Q C'`` with the compliance of each place, by differences of solved shapes, and the force's covariance."""
    robot, actuation, shape, _ = given
    estimate = ctr.ForceEstimationProblem(robot, ctr.TipForce(), tolerance=1e-9).solve(actuation, seen(shape))
    s = np.array([0.04, 0.1, shape.length])
    step = 1e-4  # N
    sides = [
        [problem_shape(robot, actuation, estimate.force + sign * step * axis).position(s) for sign in (1.0, -1.0)]
        for axis in np.eye(3)
    ]
    compliance = np.stack([(after - before) / (2.0 * step) for after, before in sides], axis=2)
    expected = compliance @ estimate.covariance @ compliance.transpose(0, 2, 1)
    np.testing.assert_allclose(estimate.position(s)[1], expected, rtol=1e-4, atol=1e-15)
    assert [each.shape for each in estimate.position(0.0)] == [(3,), (3, 3)]


@pytest.mark.parametrize("place", [0.07, 0.163])
def test_errors_of_the_actuation_move_the_band(given, place):
    """From points so exact that nothing but the actuation is off: as Jacobians have it; both kinds of model alike."""
    robot, actuation, shape, _ = given
    measured = seen(shape)
    found = [
        ctr.ForceEstimationProblem(robot, ctr.TipForce(), compiled=compiled, tolerance=1e-9, **LOOSE)
        .solve(actuation, measured)
        .position(place)[1]
        for compiled in (True, False)
    ]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-4, atol=1e-14)
    exact = ctr.ForceEstimationProblem(robot, ctr.TipForce()).solve(actuation, measured).position(place)[1]
    assert np.linalg.eigvalsh(found[0] - exact)[-1] > 0.0


@pytest.mark.parametrize("loose", some_slow([False, True], [True]))
def test_the_truth_is_inside_the_band(given, loose):
    """``d' C^-1 d`` of the position at 120 mm over 60 trials is chi-square of 180, within 99.9 %."""
    robot, actuation, _, force = given
    rng = np.random.default_rng(5)
    problem = ctr.ForceEstimationProblem(robot, ctr.TipForce(), **(LOOSE if loose else {}))
    total, count, s = 0.0, 60, 0.12
    for _ in range(count):
        true = actuation
        if loose:
            true = ctr.Actuation(
                actuation.rotations + LOOSE["rotation_sigma"] * rng.normal(size=3),
                actuation.translations + LOOSE["translation_sigma"] * rng.normal(size=3),
            )
        shape = ctr.ForwardProblem(robot).solve(true, [ctr.PointWrench(force)])
        places = np.linspace(0.1, 0.95, 20) * 0.163
        noise = SIGMA * rng.normal(size=(20, 3))
        estimate = problem.solve(actuation, ctr.PositionMeasurement(places, shape.position(places) + noise, SIGMA))
        position, covariance = estimate.position(s)
        off = position - shape.position(s)
        total += float(off @ np.linalg.solve(covariance, off))
    low, high = chi2.ppf([0.0005, 0.9995], 3 * count)
    assert low < total < high


def test_places_off_the_robot_are_refused(given):
    robot, actuation, shape, _ = given
    estimate = ctr.ForceEstimationProblem(robot, ctr.TipForce()).solve(actuation, seen(shape))
    with pytest.raises(ctr.DefinitionError, match=r"s = 0.2 m is outside the robot: allowed are 0 to 0.163 m"):
        estimate.position([0.1, 0.2])
    with pytest.raises(ctr.DefinitionError, match="no DistributedForce"):
        estimate.density(0.1)


@pytest.mark.parametrize(("width", "wider"), [(0.01, 1), (0.0004, 5), (3e-5, 100), (0.0, 1)])
def test_narrow_bands_are_drawn_wider(width, wider):
    """By 1, 2, 5, 10, ...: the first with which a band is a fiftieth of the robot's length wide, here of 0.1 m."""
    assert widened(width, 0.1) == wider
