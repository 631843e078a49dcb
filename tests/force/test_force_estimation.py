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


@pytest.mark.slow
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


def fibre(shape, s):
    """Curvature of the innermost tube in its own frame, ``(2,)``, 1/m."""
    (x, y, _), angle = shape.curvature(s), shape.tube_angle(0, s)
    return [np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x]


def mixes(shape):
    """Exact measurements of several kinds."""
    places = np.linspace(0.1, 0.9, 8) * shape.length
    wrenches = [shape.actuator_wrench(i) for i in range(3)]
    tip = ctr.PositionMeasurement(None, shape.tip_position, SIGMA)
    return {
        "curvatures": [ctr.CurvatureMeasurement(places, [fibre(shape, s) for s in places], 0.05)],
        "pose": [ctr.PoseMeasurement(None, shape.tip_pose, [SIGMA] * 3 + [5e-3] * 3)],
        "torques": [tip, *(ctr.TorqueMeasurement(i, torque, 1e-5) for i, (_, torque) in enumerate(wrenches))],
        "forces": [tip, *(ctr.ForceMeasurement(i, force, 0.02) for i, (force, _) in enumerate(wrenches))],
        "points anywhere": [ctr.BackboneMeasurement(shape.position(places[::-1]), SIGMA)],
    }


@pytest.mark.parametrize("kind", ["curvatures", "pose", "torques", "forces", "points anywhere"])
def test_any_measurement_gives_the_force(pushed, kind):
    """Exact data, to 1e-4 of the standard errors: what 1e-9 of the length leaves."""
    robot, actuation, force, shape = pushed
    problem = ctr.ForceEstimationProblem(robot, [ctr.TipForce()], tolerance=1e-9)
    found = problem.solve(actuation, mixes(shape)[kind])
    assert (np.abs(found.force - force) < 1e-4 * found.deviations).all()
    assert found.chi_squared < 1e-6


def test_forces_of_the_actuators_tell_what_the_shape_does_not(pushed):
    """The force along the tip, which hardly moves it, pushes on what holds the tubes."""
    robot, actuation, _, shape = pushed
    problem = ctr.ForceEstimationProblem(robot, [ctr.TipForce()])
    tip = problem.solve(actuation, mixes(shape)["forces"][:1])
    held = problem.solve(actuation, mixes(shape)["forces"])
    assert held.axes[2].standard_deviation < 0.1 * tip.axes[2].standard_deviation


def test_outliers_are_counted_less(pushed):
    """Two of twelve points 20 mm off: squares are misled by many standard errors, Cauchy's loss by less than four."""
    robot, actuation, force, shape = pushed
    good = seen(shape, seed=4)
    points = good.position.copy()
    points[[3, 8]] += [[0.02, 0.0, 0.0], [0.0, -0.02, 0.01]]
    bad = ctr.PositionMeasurement(good.arc_length, points, SIGMA)
    by_squares, robust = (
        ctr.ForceEstimationProblem(robot, [ctr.TipForce()], loss=loss, compiled=True).solve(actuation, bad)
        for loss in ("squared", "cauchy")
    )
    assert not by_squares.consistent
    off = [(each.force - force) @ np.linalg.solve(each.covariance, each.force - force) for each in (by_squares, robust)]
    assert off[0] > 1000.0
    assert off[1] < 16.3  # chi-square of three numbers, 99.9 %


@pytest.mark.parametrize("share", [0.6, 0.75, 0.9])
def test_a_contact_is_found_where_it_is(pushed, share):
    """Exact points: place and force to 1e-3 standard errors."""
    robot, actuation, force, free = pushed
    place = share * free.length
    shape = ctr.ForwardProblem(robot, tolerance=1e-10).solve(actuation, [ctr.PointWrench(force, arc_length=place)])
    problem = ctr.ForceEstimationProblem(robot, [ctr.PointForce()], compiled=True, tolerance=1e-9)
    found = problem.solve(actuation, seen(shape, count=20, noise=0.0))
    assert abs(found.arc_length - place) < 1e-3 * found.arc_length_error
    assert (np.abs(found.force - force) < 1e-3 * found.deviations[:3]).all()
    assert found.labels == ("force.x", "force.y", "force.z", "arc_length")


def test_an_estimate_stays_what_it_was_when_its_problem_goes_on(pushed):
    """What is told of it only later is of its own actuation, though the next one uses the same model."""
    robot, actuation, force, free = pushed
    problem = ctr.ForceEstimationProblem(robot, [ctr.PointForce()], compiled=True)
    found = []
    for turn in (0.0, 0.4):
        pose = ctr.Actuation(actuation.rotations + turn, actuation.translations - 0.01 * turn)
        load = ctr.PointWrench(force, arc_length=0.7 * free.length)
        shape = ctr.ForwardProblem(robot).solve(pose, [load])
        s = np.linspace(0.02, 0.15, 15)
        found.append((pose, ctr.PositionMeasurement(s, shape.position(s), SIGMA)))
    first, _ = (problem.solve(*each) for each in found)
    alone = ctr.ForceEstimationProblem(robot, [ctr.PointForce()], compiled=True).solve(*found[0])
    np.testing.assert_allclose(first.arc_length_set, alone.arc_length_set, rtol=1e-6)
    np.testing.assert_allclose(first.shape.tip_position, alone.shape.tip_position, atol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ctr.TipForce(prior=(0.0, -1.0)), "standard deviation -1.0 must be positive"),
        (lambda: ctr.TipForce(prior=0.3), "must be a pair"),
        (lambda: ctr.PointForce(arc_length=-0.1), "arc_length = -0.1 m must be"),
        (lambda: ctr.TipWrench(prior=(0.0, [1.0, 1.0])), "standard deviation has shape"),
    ],
)
def test_wrong_unknown_loads(make, message):
    with pytest.raises(ctr.DefinitionError, match=message):
        make()


@pytest.mark.parametrize(
    ("arguments", "call", "message"),
    [
        ({"unknown": []}, {}, "must name at least one load"),
        ({"unknown": ["force"]}, {}, "unknown.0. = 'force' must be one of"),
        ({"loss": "l1"}, {}, "loss = 'l1' must be"),
        ({"unknown": [ctr.PointForce(tube=7)]}, {}, "unknown.0..tube = 7"),
        ({"rotation_sigma": 0.0}, {}, "rotation_sigma = 0.0 must be positive"),
        ({"translation_sigma": [1e-4] * 5}, {}, "one for each of 3 tubes"),
        ({}, {"measurements": []}, "at least one measurement"),
        ({}, {"measurements": [ctr.PositionMeasurement(None, [0, 0, 0.1])]}, "sigma is required"),
        ({}, {"measurements": [ctr.PositionMeasurement(0.5, [0, 0, 0.1], 1e-3)]}, "is at s = 0.5 m"),
        ({}, {"actuation": ctr.Actuation([0.0], [0.0])}, "actuation is for 1 tubes"),
        ({}, {"fit": "a fit"}, "fit = 'a fit' must be a Fit"),
        ({}, {"initial": 3}, "initial = 3 must be a ForceEstimate"),
    ],
)
def test_wrong_calls(pushed, arguments, call, message):
    robot, actuation, _, shape = pushed

    def solve():
        problem = ctr.ForceEstimationProblem(robot, **{"unknown": [ctr.TipForce()], **arguments})
        return problem.solve(**{"actuation": actuation, "measurements": seen(shape), **call})

    with pytest.raises(ctr.DefinitionError, match=message):
        solve()


def rod_with_scans():
    """A rod under a tip force: its curvatures in two and in three components, and points along it, unplaced."""
    rod = ctr.Robot([ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.12, 8.0), youngs_modulus=60e9, poisson_ratio=0.3)])
    held = ctr.Actuation([0.3], [-0.05])
    shape = ctr.ForwardProblem(rod).solve(held, [ctr.PointWrench([0.1, 0.0, 0.0])])
    s = np.array([0.01, 0.02, 0.03, 0.05])
    turned, angle = shape.curvature(s), shape.tube_angle(0, s)
    along, across = turned[:, 0], turned[:, 1]
    bent = (np.cos(angle) * along + np.sin(angle) * across, np.cos(angle) * across - np.sin(angle) * along)
    curvatures = np.column_stack((*bent, shape.torsion(0, s)))
    rng = np.random.default_rng(3)
    points = shape.position(np.array([0.02, 0.03, 0.031, 0.05, 0.051, 0.068])) + 2e-3 * rng.normal(size=(6, 3))
    return rod, held, s, curvatures, points


def scan(points, ordered=True):
    return ctr.BackboneMeasurement(points, 2e-3, ordered=ordered)


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "virtual machine"])
@pytest.mark.parametrize("kind", ["components", "order", "parts"])
def test_a_kept_model_serves_the_same_measurements_only(kind, compiled):
    """Otherwise blocks and orders of the experiment before would weigh and sort the next one's."""
    rod, held, s, curvatures, points = rod_with_scans()
    before, after = {
        "components": [[ctr.CurvatureMeasurement(s, u, sigma=1e-3)] for u in (curvatures[:, :2], curvatures)],
        "order": [[scan(points, ordered=False)], [scan(points)]],
        "parts": [[scan(points[:2]), scan(points[2:])], [scan(points[:4]), scan(points[4:])]],
    }[kind]
    problem = ctr.ForceEstimationProblem(rod, [ctr.TipForce()], compiled=compiled)
    problem.solve(held, before)
    fresh = ctr.ForceEstimationProblem(rod, [ctr.TipForce()], compiled=compiled).solve(held, after)
    estimate = problem.solve(held, after)
    np.testing.assert_allclose(estimate.force, fresh.force, rtol=1e-9)
    np.testing.assert_allclose(estimate.chi_squared, fresh.chi_squared, rtol=1e-9)
