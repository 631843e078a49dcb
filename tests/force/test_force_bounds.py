"""Bounds of forces and places, and priors of places: kept exactly, against SciPy and Bayes, with bars that hold."""

import numpy as np
import pytest
from scipy.optimize import least_squares

import ctr_opt as ctr
from ctr_opt.layout.ends import Ends

SIGMA = 2e-4  # m
FORCE = np.array([0.1, -0.2, 0.05])

pytestmark = pytest.mark.usefixtures("compiling")


@pytest.fixture(scope="module")
def given():
    problem = ctr.load_problem("problems/three_tubes/b1.toml")
    return problem.robot, problem.actuation, ctr.ForwardProblem(problem.robot, tolerance=1e-9)


def seen(given, force=FORCE, arc_length=None, rng=None):
    _, actuation, forward = given
    shape = forward.solve(actuation, [ctr.PointWrench(force, arc_length=arc_length)])
    s = np.linspace(0.1, 1.0, 20) * shape.length
    noise = 0.0 if rng is None else SIGMA * rng.normal(size=(20, 3))
    return ctr.PositionMeasurement(s, shape.position(s) + noise, SIGMA)


def test_bounds_give_what_scipy_finds_over_forward_solves(given):
    """Its trust-region method with the same bounds: to 1e-3 of a free standard error."""
    robot, actuation, forward = given
    measured = seen(given, rng=np.random.default_rng(2))
    low, high = [-1.0, -0.15, -5.0], [0.05, 5.0, 5.0]
    problem = ctr.ForceEstimationProblem(robot, ctr.TipForce(bounds=(low, high)))
    found = problem.solve(actuation, measured)

    def misfit(force):
        shape = forward.solve(actuation, [ctr.PointWrench(force)])
        return (shape.position(np.array(measured.arc_length)) - measured.position).ravel() / SIGMA

    expected = least_squares(misfit, [0.0, 0.0, 0.0], bounds=(low, high), x_scale=[0.01, 0.01, 0.1], xtol=1e-12)
    free = ctr.ForceEstimationProblem(robot, ctr.TipForce()).solve(actuation, measured)
    assert found.force[0] == 0.05
    assert found.force[1] == -0.15
    np.testing.assert_allclose(found.force, expected.x, atol=1e-3 * free.deviations.max())
    assert found.consistent is False
    assert found.degrees_of_freedom == 60 - 1


def test_bounds_that_are_far_change_nothing(given):
    robot, actuation, _ = given
    measured = seen(given)
    free, wide = (
        ctr.ForceEstimationProblem(robot, ctr.TipForce(bounds=bounds)).solve(actuation, measured)
        for bounds in (None, (-3.0, 3.0))
    )
    np.testing.assert_allclose(wide.force, free.force, atol=1e-9)
    np.testing.assert_allclose(wide.covariance, free.covariance, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("kind", ["wrench", "density", "push"])
def test_every_kind_is_kept_within(given, kind):
    robot, actuation, _ = given
    measured = seen(given)
    unknown = {
        "wrench": ctr.TipWrench(prior=(0.0, [1.0] * 3 + [0.01] * 3), bounds=([-1.0] * 6, [0.05] * 3 + [1e-4] * 3)),
        "density": ctr.DistributedForce(6, prior=(0.0, 5.0), bounds=(-1.0, 1.0)),
        "push": ctr.PointForce(0.163, normal=[0.4, -0.9, 0.0], bounds=(None, 0.1)),
    }[kind]
    found = ctr.ForceEstimationProblem(robot, unknown).solve(actuation, measured)
    low, high = unknown.placed(Ends.at([0.163] * 3)).limits
    assert (found.estimates >= low).all()
    assert (found.estimates <= high).all()
    assert (np.isclose(found.estimates, low) | np.isclose(found.estimates, high)).any()
    assert np.isfinite(found.covariance).all()


def test_a_contact_is_looked_for_where_it_can_be(given):
    """Where the truth is, as without; where it is not, at the edge, and reported as inconsistent."""
    robot, actuation, _ = given
    measured = seen(given, np.array([0.2, -0.3, 0.0]), 0.12)
    free, around, off = (
        ctr.ForceEstimationProblem(robot, ctr.PointForce(prior=(0.0, 1.0), between=between)).solve(actuation, measured)
        for between in (None, (0.11, 0.14), (0.02, 0.022))
    )
    assert around.arc_length == pytest.approx(free.arc_length, abs=1e-6)
    assert 0.02 <= off.arc_length <= 0.022
    assert off.consistent is False
    (interval,) = around.arc_length_set
    assert interval[0] >= 0.11
    assert interval[1] <= 0.14


def test_a_prior_of_a_place_adds_its_information(given):
    """At the truth, so that the answer stays where it is: inverse covariances add, to 1e-4."""
    robot, actuation, _ = given
    measured = seen(given, np.array([0.2, -0.3, 0.0]), 0.12)
    free = ctr.ForceEstimationProblem(robot, ctr.PointForce()).solve(actuation, measured)
    known = ctr.ForceEstimationProblem(robot, ctr.PointForce(place_prior=(0.12, 1e-3))).solve(actuation, measured)
    added = np.linalg.inv(known.covariance) - np.linalg.inv(free.covariance)
    assert added[3, 3] == pytest.approx(1e6, rel=1e-2)
    assert known.arc_length_error < free.arc_length_error
    pulled = ctr.ForceEstimationProblem(robot, ctr.PointForce(place_prior=(0.125, 1e-5))).solve(actuation, measured)
    assert pulled.arc_length == pytest.approx(0.125, abs=1e-4)


def test_bars_hold_between_bounds(given):
    """``e' C^-1 e`` over 150 trials with forces drawn evenly between bounds as narrow as the bars: 3, at most 4.2."""
    robot, actuation, _ = given
    rng, found = np.random.default_rng(3), []
    half = np.array([0.01, 0.03, 0.1])
    problem = ctr.ForceEstimationProblem(robot, ctr.TipForce(bounds=(FORCE - half, FORCE + half)))
    for _ in range(150):
        force = FORCE + half * rng.uniform(-1.0, 1.0, 3)
        off = problem.solve(actuation, seen(given, force, rng=rng))
        gap = off.force - force
        found.append(gap @ np.linalg.solve(off.covariance, gap))
    assert 1.5 < np.mean(found) < 4.2


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ctr.TipForce(bounds=3.0), "bounds = 3.0 must be a pair"),
        (lambda: ctr.TipForce(bounds=(1.0, -1.0)), "the least must be below the most"),
        (lambda: ctr.TipWrench(bounds=(None, [1.0, 2.0])), "bounds: the most has shape"),
        (lambda: ctr.PointForce(0.1, between=(0.0, 0.1)), "between = .* is only for an unknown place"),
        (lambda: ctr.PointForce(0.1, place_prior=(0.0, 0.1)), "place_prior = .* is only for an unknown place"),
        (lambda: ctr.PointForce(between=(-0.1, 0.1)), "the least at least 0"),
        (lambda: ctr.PointForce(normal=[1, 0, 0], bounds=(-1.0, 1.0)), "the least at least 0"),
        (
            lambda: ctr.PointForce(0.1, normal=[1, 0, 0], friction=0.3, bounds=(0.0, 1.0)),
            "cannot be given with friction",
        ),
        (lambda: ctr.Contacts(between=(0.2, 0.1)), "the least must be below the most"),
    ],
)
def test_wrong_bounds(make, message):
    with pytest.raises(ctr.DefinitionError, match=message):
        make()


def test_bounds_off_the_tube_and_in_streams(given):
    robot, actuation, _ = given
    with pytest.raises(ctr.DefinitionError, match=r"between = \(0.2, 0.3\) is not on tube 0, which ends at 0.163 m"):
        ctr.ForceEstimationProblem(robot, ctr.PointForce(between=(0.2, 0.3))).solve(actuation, seen(given))
    with pytest.raises(ctr.DefinitionError, match=r"unknown\[0\].bounds = \(0.0, 1.0\) is not supported in a stream"):
        ctr.ForceEstimator(robot, ctr.TipForce(bounds=(0.0, 1.0)), rate=100.0, drift=1.0)
