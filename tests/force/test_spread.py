"""Normal distributions inside half lines and cones, against samples and closed forms; and the bars that follow."""

import numpy as np
import pytest
from scipy.stats import chi2, halfnorm

import ctr_opt as ctr
from ctr_opt.force.spread import Spread, between, within_cone
from tests.support.slow import some_slow

SAMPLES = 400_000


@pytest.mark.parametrize("seed", range(1, 7))
def test_moments_in_a_cone_are_those_of_samples(seed):
    """Of a free normal distribution those that fall inside: within five standard errors of their moments."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    shape = rng.normal(size=(3, 3))
    covariance, friction = 0.05 * shape @ shape.T, rng.uniform(0.1, 1.0)
    center = rng.uniform(-0.1, 1.0) * normal + 0.2 * rng.normal(size=3)
    at = 0.1 * rng.normal(size=3)
    found = within_cone(Spread(center - at, covariance), at, normal, friction)
    drawn = center + rng.normal(size=(SAMPLES, 3)) @ np.linalg.cholesky(covariance).T
    push = drawn @ normal
    inside = drawn[np.linalg.norm(drawn - push[:, None] * normal, axis=1) <= friction * push]
    assert len(inside) > 1_000
    spread = np.cov(inside.T)
    errors = np.sqrt(np.diag(spread) / len(inside))
    assert (np.abs(found.mean + at - inside.mean(axis=0)) < 5.0 * errors).all()
    assert np.abs(found.covariance - spread).max() < 5.0 * np.sqrt(2.0 / len(inside)) * np.trace(spread)


def test_a_slot_along_the_axis_leaves_half_a_normal_distribution():
    """Where the slide is known and fits at any push, the push is half-normal, or normal: to 1e-6."""
    slot = Spread(np.zeros(3), np.diag([1e-18, 1e-18, 1.0]))
    found = within_cone(slot, np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.5)
    assert found.mean[2] == pytest.approx(halfnorm.mean(), rel=1e-6)
    assert found.covariance[2, 2] == pytest.approx(halfnorm.var(), rel=1e-6)
    assert between(Spread(np.zeros(1), np.eye(1)), 0.0, np.inf).mean[0] == pytest.approx(halfnorm.mean(), rel=1e-12)


@pytest.mark.parametrize("width", [1e-5, 1.0, 1e3])
def test_far_inside_nothing_changes(width):
    """Whatever the proportions: to 1e-5 of the numbers' own sizes."""
    covariance = np.diag([1e-6, 1e-4, 1e-2]) * width**2
    center = np.array([0.0, 0.1, 2.0]) * width
    found = within_cone(Spread(np.zeros(3), covariance), center, np.array([0.0, 0.0, 1.0]), 0.5)
    sizes = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(found.mean / sizes, 0.0, atol=1e-5)
    np.testing.assert_allclose(found.covariance / np.outer(sizes, sizes), np.eye(3), atol=1e-5)


def test_a_cone_without_width_weighs_pushes_by_their_squares():
    """As its volume does: against a sum over pushes, to 1e-6."""
    covariance = np.array([[0.04, 0.01, 0.02], [0.01, 0.09, 0.0], [0.02, 0.0, 0.16]])
    center, normal = np.array([0.1, -0.2, 0.3]), np.array([0.0, 0.0, 1.0])
    found = within_cone(Spread(np.zeros(3), covariance), center, normal, 0.0)
    information = np.linalg.inv(covariance)
    mean, variance = information[2] @ center / information[2, 2], 1.0 / information[2, 2]
    push = np.linspace(0.0, 4.0, 200_001)
    weights = push**2 * np.exp(-0.5 * (push - mean) ** 2 / variance)
    assert found.mean[2] + center[2] == pytest.approx(weights @ push / weights.sum(), rel=1e-6)


@pytest.fixture(scope="module")
def wall(compiling):
    given = ctr.load_problem("problems/three_tubes/b1.toml")
    return given.robot, given.actuation, np.array([-0.6, 0.8, 0.0])


@pytest.mark.parametrize("friction", some_slow([None, 0.3], [None]))
def test_bars_hold_at_the_edge_of_what_is_possible(wall, friction):
    """``e' C^-1 e`` over 90 trials with pushes near the edge, in the mean as in free estimates: at most 40 % above.

    Forces are drawn where the surface allows them, as often near its edge as elsewhere; with the bars of the edge alone
    the mean was above 100.
    """
    robot, actuation, normal = wall
    rng, s, sigma = np.random.default_rng(8), 0.12, 2e-4
    forward = ctr.ForwardProblem(robot)
    problem = ctr.ForceEstimationProblem(robot, ctr.PointForce(s, normal=normal, friction=friction))
    across = np.linalg.svd(normal[None])[2][1:]
    found, size = [], 1 if friction is None else 3
    for _ in range(90):
        push = rng.uniform(0.0, 0.02 if friction is None else 0.4)
        slide = np.zeros(2)
        if friction is not None:
            slide = friction * push * np.sqrt(rng.uniform()) * unit(rng.uniform(0.0, 2.0 * np.pi))
        force = push * normal + slide @ across
        shape = forward.solve(actuation, [ctr.PointWrench(force, arc_length=s)])
        places = np.linspace(0.1, 1.0, 20) * shape.length
        seen = shape.position(places) + sigma * rng.normal(size=(20, 3))
        estimate = problem.solve(actuation, ctr.PositionMeasurement(places, seen, sigma))
        off = (estimate.force - force) @ (normal[:, None] if friction is None else np.eye(3))
        found.append(off @ np.linalg.solve(estimate.covariance, off))
    assert np.mean(found) < 1.4 * size
    assert np.mean(np.array(found) < chi2.ppf(0.95, size)) > 0.9


def unit(angle):
    return np.array([np.cos(angle), np.sin(angle)])
