"""Forces from shapes: against SciPy over forward solves, compliances, laws of error, and both kinds of model."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

import ctr_opt as ctr

ROBOTS = Path("problems/three_tubes")
SIGMA = 2e-4  # m


@pytest.fixture(scope="module")
def pushed():
    """Robot B, a force at its tip, and its shape."""
    given = ctr.load_problem(ROBOTS / "b1.toml")
    shape = ctr.ForwardProblem(given.robot).solve(given.actuation)
    force = given.robot.tubes[0].bending_stiffness / shape.length**2 * np.array([0.9, -1.1, 0.6])
    loaded = ctr.ForwardProblem(given.robot, tolerance=1e-10).solve(given.actuation, [ctr.PointWrench(force)])
    return given.robot, given.actuation, force, loaded


def seen(shape, count=12, seed=0, noise=SIGMA):
    """Points along a shape, with noise."""
    s = np.linspace(0.15, 1.0, count) * shape.length
    points = shape.position(s) + noise * np.random.default_rng(seed).normal(size=(count, 3))
    return ctr.PositionMeasurement(s, points, SIGMA)


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "virtual machine"])
def test_exact_points_give_the_force(pushed, compiled):
    """To what the tolerances of both solvers, 1e-7 of the length, move the force."""
    robot, actuation, force, shape = pushed
    problem = ctr.ForceEstimationProblem(robot, [ctr.TipForce()], compiled=compiled, tolerance=1e-9)
    estimate = problem.solve(actuation, seen(shape, noise=0.0))
    np.testing.assert_allclose(estimate.force, force, atol=1e-6 * np.linalg.norm(force))
    np.testing.assert_allclose(estimate.shape.tip_position, shape.tip_position, atol=1e-9)
    assert estimate.shape.residual_norm < 1e-9
    assert estimate.consistent


@pytest.fixture(scope="module")
def estimate(pushed):
    robot, actuation, _, shape = pushed
    return ctr.ForceEstimationProblem(robot, [ctr.TipForce()], compiled=True).solve(actuation, seen(shape))


def test_noisy_points_give_what_scipy_finds_over_forward_solves(pushed, estimate):
    """Within 1e-4 standard errors: what remains of 1e-9 of the length is 1e-6 of a standard deviation of a point."""
    robot, actuation, force, shape = pushed
    problem, measured = ctr.ForwardProblem(robot, tolerance=1e-10), seen(shape)

    def residuals(f):
        predicted = problem.solve(actuation, [ctr.PointWrench(f)], initial=shape).position(measured.arc_length)
        return ((predicted - measured.position) / SIGMA).ravel()

    found = least_squares(residuals, force, x_scale=force.max(), xtol=1e-10, ftol=1e-14, gtol=1e-12)
    np.testing.assert_allclose(estimate.force, found.x, atol=1e-4 * estimate.deviations.min())
    assert estimate.chi_squared == pytest.approx(2.0 * found.cost, rel=1e-6)
    assert estimate.degrees_of_freedom == 33


def test_the_covariance_is_that_of_compliances(estimate):
    """``(sum C^T C / sigma^2)^-1`` with compliances of the points by a force at the tip, to 1e-5 of their size."""
    shape = estimate.shape
    places = estimate.case.experiment.measurements[0].arc_length
    rows = np.vstack([shape.compliance(s)[:3, :3] for s in places]) / SIGMA
    np.testing.assert_allclose(estimate.covariance, np.linalg.inv(rows.T @ rows), rtol=1e-4)
    worst = estimate.axes[2]
    assert worst.standard_deviation**2 == pytest.approx(np.linalg.eigvalsh(estimate.covariance)[2])


def test_a_prior_pulls_as_bayes_has_it(pushed, estimate):
    """In the linearized problem; the force moves by a few standard errors, so to a tenth of one."""
    robot, actuation, _, shape = pushed
    mean, sigma = np.array([0.01, 0.0, 0.02]), 0.5 * estimate.deviations.max()
    problem = ctr.ForceEstimationProblem(robot, [ctr.TipForce()], prior=(mean, sigma), compiled=True)
    found = problem.solve(actuation, seen(shape))
    data = np.linalg.inv(estimate.covariance)
    both = np.linalg.inv(data + np.eye(3) / sigma**2)
    np.testing.assert_allclose(found.covariance, both, rtol=0.1, atol=0.02 * both.max())
    expected = both @ (data @ estimate.force + mean / sigma**2)
    assert np.abs(found.force - expected).max() < 0.1 * estimate.deviations.max()


def test_errors_of_the_actuation_are_counted(pushed, estimate):
    """Covariance with the points' enlarged by the Jacobian's, which are those of the tip's shape: a part in 1e3."""
    robot, actuation, _, shape = pushed
    turned, drawn = 0.01, 2e-4
    problem = ctr.ForceEstimationProblem(
        robot, [ctr.TipForce()], rotation_sigma=turned, translation_sigma=drawn, compiled=True
    )
    found = problem.solve(actuation, seen(shape))
    places, tubes = found.case.experiment.measurements[0].arc_length, len(robot.tubes)
    by_force = np.vstack([found.shape.compliance(s)[:3, :3] for s in places])
    by_joints = np.vstack([found.shape.jacobian(s)[:3] for s in places]) * ([turned] * tubes + [drawn] * tubes)
    noise = SIGMA**2 * np.eye(len(by_force)) + by_joints @ by_joints.T
    expected = np.linalg.inv(by_force.T @ np.linalg.solve(noise, by_force))
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-3)
    assert found.deviations.min() > 1.2 * estimate.deviations.min()


def test_errors_of_the_calibration_are_counted(pushed):
    """The same with a fit's covariance, whose parameters the robot then has."""
    robot, actuation, _, shape = pushed
    names = ["tubes[0].bending_stiffness", "base.translation"]
    experiments = []
    for turn in (0.0, 1.0, 2.0):
        pose = ctr.Actuation(actuation.rotations + turn, actuation.translations)
        load = ctr.PointWrench([0.02, 0.01, 0.0])
        free = ctr.ForwardProblem(robot).solve(pose, [load])
        experiments.append(ctr.Experiment(pose, [load], [ctr.PositionMeasurement(None, free.tip_position, 1e-3)]))
    fit = ctr.CalibrationProblem(robot, experiments, names, compiled=True).solve()
    problem = ctr.ForceEstimationProblem(fit.robot, [ctr.TipForce()], compiled=True)
    found, plain = problem.solve(actuation, seen(shape), fit=fit), problem.solve(actuation, seen(shape))
    places = found.case.experiment.measurements[0].arc_length
    by_force = np.vstack([found.shape.compliance(s)[:3, :3] for s in places])
    by_fit = np.vstack([found.shape.sensitivity(("position", s), names) for s in places])
    noise = SIGMA**2 * np.eye(len(by_force)) + by_fit @ fit.covariance @ by_fit.T
    expected = np.linalg.inv(by_force.T @ np.linalg.solve(noise, by_force))
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-3)
    assert found.deviations.max() > 1.1 * plain.deviations.max()
