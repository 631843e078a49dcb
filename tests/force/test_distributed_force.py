"""Distributed forces: splines as pieces, smoothness by evidence, and what is found of a known load."""

import re
from pathlib import Path

import numpy as np
import pytest

import ctr_opt as ctr

SIGMA = 2e-4  # m
COUNT = 20


@pytest.fixture(scope="module")
def pushed():
    """Robot B under a smooth density, its total, and its shape by a solver that knows nothing of splines."""
    given = ctr.load_problem(Path("problems/three_tubes") / "b1.toml")
    length = ctr.ForwardProblem(given.robot).solve(given.actuation).length
    unit = given.robot.tubes[0].bending_stiffness / length**3
    s = np.linspace(0.0, length, 81)
    values = unit * np.column_stack((2.0 * np.sin(np.pi * s / length) ** 2, 1.5 * np.cos(12.0 * s), 0.3 + 0.0 * s))
    load = ctr.DistributedLoad((s, values))
    shape = ctr.ForwardProblem(given.robot, tolerance=1e-9).solve(given.actuation, [load])
    return given.robot, given.actuation, load, shape, unit


def seen(shape, sigma=SIGMA, seed=0):
    s = np.linspace(0.05, 1.0, COUNT) * shape.length
    points = shape.position(s) + sigma * np.random.default_rng(seed).normal(size=(COUNT, 3))
    return ctr.PositionMeasurement(s, points, sigma)


@pytest.fixture(scope="module")
def estimate(pushed):
    robot, actuation, _, shape, unit = pushed
    force = ctr.DistributedForce(prior=(0.0, 10.0 * unit))
    return ctr.ForceEstimationProblem(robot, force, compiled=True).solve(actuation, seen(shape))


def test_pieces_are_the_means_of_the_spline():
    """And their sum is its integral, all to rounding."""
    force = ctr.DistributedForce(coefficients=7, start=0.01, end=0.1)
    coefficients = np.random.default_rng(0).normal(size=(7, 3))
    pieces = (force.mixing @ coefficients.ravel()).reshape(-1, 3)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    loads = force.loads()
    for piece, load in zip(pieces, loads, strict=True):
        s = load.start + 0.5 * (load.end - load.start) * (1.0 + nodes)
        mean = 0.5 * weights @ (force.spline(s) @ coefficients)
        np.testing.assert_allclose(piece, mean, rtol=1e-12)
    lengths = np.array([load.end - load.start for load in loads])
    np.testing.assert_allclose(force.resultant @ coefficients.ravel(), lengths @ pieces, rtol=1e-12)


def test_roughness_is_the_integral_of_the_second_derivative():
    """Of f = s^2 in x it is 4 times the length, and of a linear f nothing, to rounding."""
    force = ctr.DistributedForce(coefficients=8, end=0.1)
    s = np.linspace(0.0, 0.1, 50)
    for power, expected in ((2, 4.0 * 0.1), (1, 0.0)):
        fitted = np.linalg.lstsq(force.spline(s), s**power, rcond=None)[0]
        x = np.column_stack((fitted, 0.0 * fitted, 0.0 * fitted)).ravel()
        rounding = 100.0 * np.finfo(float).eps * np.abs(x) @ np.abs(force.roughness) @ np.abs(x)  # of terms that cancel
        assert rounding < 1e-8 * 0.4
        assert x @ force.roughness @ x == pytest.approx(expected, rel=1e-9, abs=rounding)


def test_pieces_move_the_robot_far_less_than_noise(pushed):
    """Below a twentieth of a point's standard deviation: the spline's pieces instead of the density itself."""
    robot, actuation, load, shape, _ = pushed
    force = ctr.DistributedForce(end=shape.length)
    s, values = load.force.arc_length, load.force.values
    coefficients = np.linalg.lstsq(force.spline(s), values, rcond=None)[0]
    pieces = (force.mixing @ coefficients.ravel()).reshape(-1, 3)
    loads = [
        ctr.DistributedLoad(piece, start=each.start, end=each.end)
        for piece, each in zip(pieces, force.loads(), strict=True)
    ]
    other = ctr.ForwardProblem(robot, tolerance=1e-9, compiled=True).solve(actuation, loads)
    places = np.linspace(0.05, 1.0, COUNT) * shape.length
    assert np.abs(other.position(places) - shape.position(places)).max() < SIGMA / 20.0


def test_the_density_is_found_within_its_errors(pushed, estimate):
    """In the mean of places and axes: splines' errors hang together, so no more than twice what is told."""
    _, _, load, _, _ = pushed
    s, values = load.force.arc_length, load.force.values
    found, deviations = estimate.density(s)
    assert found.shape == deviations.shape == (81, 3)
    assert np.sqrt((((found - values) / deviations) ** 2).mean()) < 2.0
    total = np.trapezoid(values, s, axis=0)
    assert (np.abs(estimate.force - total) < 3.0 * np.sqrt(np.diag(estimate.force_covariance))).all()
    np.testing.assert_allclose(sum((load.end - load.start) * load.force for load in estimate.loads), estimate.force)
    assert estimate.consistent


@pytest.fixture(scope="module")
def precise(pushed):
    """With points of a micrometre."""
    robot, actuation, _, shape, unit = pushed
    force = ctr.DistributedForce(prior=(0.0, 10.0 * unit))
    return ctr.ForceEstimationProblem(robot, force, compiled=True).solve(actuation, seen(shape, sigma=1e-6))


def test_precise_points_tell_the_density(pushed, precise):
    """The total across to a tenth of the characteristic force, and densities within twice their errors in the mean."""
    _, _, load, shape, unit = pushed
    total = np.trapezoid(load.force.values, load.force.arc_length, axis=0)
    assert np.abs(precise.force - total)[:2].max() < 0.1 * unit * shape.length
    values, deviations = precise.density(load.force.arc_length)
    assert np.sqrt((((values - load.force.values) / deviations) ** 2).mean()) < 2.0


def test_the_smoothness_is_the_least_that_is_not_much_less_likely(precise):
    """Against determinants of the linearized problem over a grid of weights, to its steps of a tenth of a decade."""
    (unknown,), state = precise.case.numbered.unknown, precise.state
    rough, before = unknown.roughness, unknown.known_before.information
    weight = (precise.case.search.unknowns.prior_information - before)[0, 0] / rough[0, 0]
    slopes = state.slopes * np.sqrt(state.weights)[:, None]
    data = slopes.T @ slopes + before
    pull = slopes.T @ (slopes @ state.x - np.sqrt(state.weights) * state.misfit)
    rank = np.linalg.matrix_rank(rough)

    def evidence(w):
        matrix = data + w * rough
        return 0.5 * (pull @ np.linalg.solve(matrix, pull) - np.linalg.slogdet(matrix)[1] + rank * np.log(w))

    powers = np.arange(-20, 41) / 10.0
    every = np.array([evidence(weight * 10.0**power) for power in powers])
    assert every.max() - evidence(weight) == pytest.approx(2.0, abs=0.3)  # weights agree to 5 %, the grid to a quarter
    assert (every[powers < -0.05] < evidence(weight)).all()


def test_a_given_smoothness_is_kept(pushed):
    """A large one leaves a straight line: second differences of the density vanish beside its size."""
    robot, actuation, _, shape, unit = pushed
    force = ctr.DistributedForce(coefficients=6, smoothness=1e6, prior=(0.0, 10.0 * unit))
    found = ctr.ForceEstimationProblem(robot, force, compiled=True).solve(actuation, seen(shape))
    values = found.density(np.linspace(0.0, shape.length, 9))[0]
    assert np.abs(np.diff(values, n=2, axis=0)).max() < 1e-3 * np.abs(values).max()


@pytest.mark.parametrize(
    ("field", "message"),
    [
        ({"coefficients": 3}, "above the degree"),
        ({"coefficients": 4.5}, "whole number"),
        ({"degree": 1}, "degree = 1 must be"),
        ({"smoothness": 0.0}, "smoothness = 0"),
        ({"start": 0.1, "end": 0.05}, "must be above start"),
    ],
)
def test_impossible_splines_are_refused(field, message):
    with pytest.raises(ctr.DefinitionError, match=message):
        ctr.DistributedForce(**field)


def test_a_smoothness_of_which_rounding_is_left_is_refused(pushed):
    """The most that is allowed gives a straight line, and the same loss as a hundredth of it to 1e-4."""
    robot, actuation, _, shape, _ = pushed
    with pytest.raises(
        ctr.DefinitionError, match=r"unknown\[0\].smoothness = 1e\+12 m\^5/N\^2 must be at most"
    ) as caught:
        ctr.ForceEstimationProblem(robot, ctr.DistributedForce(smoothness=1e12), compiled=True).solve(
            actuation, seen(shape)
        )
    most = float(re.search(r"at most (\S+):", str(caught.value))[1])
    found = [
        ctr.ForceEstimationProblem(robot, ctr.DistributedForce(smoothness=weight), compiled=True).solve(
            actuation, seen(shape)
        )
        for weight in (0.9 * most, 0.009 * most)
    ]
    assert found[0].state.cost == pytest.approx(found[1].state.cost, rel=1e-4)
    s = np.array([0.25, 0.5, 0.75]) * shape.length
    ends = found[0].density([0.0, shape.length])[0]
    line = ends[0] + np.outer(s / shape.length, ends[1] - ends[0])
    np.testing.assert_allclose(found[0].density(s)[0], line, atol=1e-5 * np.abs(ends).max())


def test_a_force_beyond_its_tube_is_refused(pushed):
    robot, actuation, _, shape, _ = pushed
    problem = ctr.ForceEstimationProblem(robot, ctr.DistributedForce(end=2.0), compiled=True)
    with pytest.raises(ctr.DefinitionError, match="ends at"):
        problem.solve(actuation, seen(shape))


def test_a_force_may_end_where_its_tube_does_but_for_rounding():
    """0.12 m less 0.05 m is less than 0.07 m: other loads accept it, too."""
    rod = ctr.Robot([ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.12, 8.0), youngs_modulus=60e9, poisson_ratio=0.3)])
    held = ctr.Actuation([0.3], [-0.05])
    shape = ctr.ForwardProblem(rod).solve(held, [ctr.PointWrench([0.05, 0.0, 0.0])])
    points = ctr.PositionMeasurement([0.03, 0.05, 0.06], shape.position([0.03, 0.05, 0.06]), sigma=1e-4)
    problems = [
        ctr.ForceEstimationProblem(rod, [ctr.DistributedForce(4, end=end, prior=(0.0, 1.0))]) for end in (0.07, None)
    ]
    there, whole = (problem.solve(held, points) for problem in problems)
    np.testing.assert_allclose(there.force, whole.force, rtol=1e-9)
    with pytest.raises(ctr.DefinitionError, match=r"from 0 to 0\.0701 m is not on tube 0"):
        ctr.ForceEstimationProblem(rod, [ctr.DistributedForce(end=0.0701)]).solve(held, points)
