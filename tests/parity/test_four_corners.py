"""Where a tube ends at the tip of another, at a measurement or at a sensor: whose frame is taken, and kept.

Two tubes of a straight and a curved part, in whole centimetres. Their ends are one point, as decimal numbers have it,
and what is expected follows from that alone: the tube that ends at a point is still there, and the innermost counts.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ctr_opt as ctr

COMPILED = pytest.mark.parametrize("compiled", [False, True], ids=["virtual machine", "compiled"])
INNER_ENDS = ctr.Actuation([0.0, 1.2], [-0.10, -0.02])  # at 0.05 m, as measurements do; the outer tube goes on


def two(inner, outer):
    """Tubes with straight parts of these lengths, m."""
    material = {"youngs_modulus": 60e9, "poisson_ratio": 0.3}
    return ctr.Robot(
        [
            ctr.Tube("inner", 1.0e-3, 0.6e-3, [ctr.Straight(inner), ctr.Arc(0.05, 8.0)], **material),
            ctr.Tube("outer", 1.6e-3, 1.2e-3, [ctr.Straight(outer), ctr.Arc(0.05, 5.0)], **material),
        ]
    )


def about_z(shape, tube, others):
    """The frame of a tube at its end, by its angle from that of another tube there."""
    s = shape.configuration.ends.of(tube)
    turn = shape.tube_angle(tube, s) - shape.tube_angle(others, s)
    return shape.pose(s, others)[:3, :3] @ Rotation.from_rotvec([0.0, 0.0, turn]).as_matrix()


@COMPILED
def test_tubes_flush_at_the_tip_turn_it_as_the_innermost_does(compiled):
    robot = two(0.0625, 0.0625)
    problem = ctr.ForwardProblem(robot, compiled=compiled)
    held, step = [-0.0625, -0.0625], 1e-5
    shape = problem.solve(ctr.Actuation([0.0, 1.2], held))
    differences = []
    for turn in step * np.eye(2):
        frames = [problem.solve(ctr.Actuation([0.0, 1.2] + sign * turn, held)).pose(0.05, 0) for sign in (1, -1)]
        vector = Rotation.from_matrix(frames[0][:3, :3] @ frames[1][:3, :3].T).as_rotvec()
        differences.append(np.append(frames[0][:3, 3] - frames[1][:3, 3], vector) / (2.0 * step))
    # Differences of second order: step^2 of some 1 / rad^2, and 1e-12 of each solve over the step.
    np.testing.assert_allclose(shape.jacobian()[:, :2], np.transpose(differences), rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(shape.jacobian()[:, :2], shape.sensitivity("tip_pose", "rotations"), atol=1e-12)


@COMPILED
def test_a_tip_is_the_innermost_tubes_though_the_ends_differ_by_rounding(compiled):
    robot = two(0.1, 0.07)
    translations = [0.055 - tube.length for tube in robot.tubes]
    ends = [tube.length + shift for tube, shift in zip(robot.tubes, translations, strict=True)]
    assert 0.0 < ends[1] - ends[0] < 1e-16  # the outer tube's is the larger number
    problem = ctr.ForwardProblem(robot, compiled=compiled)
    shape = problem.solve(ctr.Actuation([0.0, 1.2], translations))
    expected = about_z(shape, 0, 1)
    assert np.abs(expected - shape.pose(shape.length, 1)[:3, :3]).max() > 0.1  # the tubes are turned otherwise
    for pose in (shape.tip_pose, shape.pose(shape.length), shape.pose(0.055, 0)):
        np.testing.assert_allclose(pose[:3, :3], expected, rtol=0.0, atol=1e-12)
    reported = problem.function(shape)(rotations=[0.0, 1.2], translations=translations, initial=shape.unknowns)
    np.testing.assert_allclose(reported["tip_rotation"].full(), expected, rtol=0.0, atol=1e-9)  # of its fixed steps


@COMPILED
def test_a_pose_where_an_inner_tube_ends_is_that_tubes(compiled):
    robot = two(0.10, 0.05)
    push = [ctr.PointWrench([0.1, 0.05, 0.0], tube=1)]
    shape = ctr.ForwardProblem(robot, compiled=compiled).solve(INNER_ENDS, push)
    pose = shape.pose(0.05)
    np.testing.assert_allclose(pose[:3, :3], about_z(shape, 0, 1), rtol=0.0, atol=1e-12)
    seen = [
        ctr.PoseMeasurement(0.05, pose, sigma=[1e-4] * 3 + [1e-3] * 3),
        ctr.PositionMeasurement(None, shape.tip_position, sigma=1e-4),
    ]
    problem = ctr.ForceEstimationProblem(robot, [ctr.PointForce(0.06, tube=1)], compiled=compiled)
    assert problem.solve(INNER_ENDS, seen, [ctr.PointWrench([0.1, 0.05, 0.0], tube=1)]).consistent
    fit = ctr.CalibrationProblem(
        robot,
        [ctr.Experiment(INNER_ENDS, push, seen)],
        ["tubes[0].bending_stiffness"],
        compiled=compiled,
    ).solve()
    assert max(np.abs(each.value).max() for each in fit.residuals) < 1e-6  # of nothing but solves


@COMPILED
def test_a_sensor_where_an_inner_tube_ends_is_on_that_tube(compiled):
    robot, mounted, experiments = two(0.10, 0.05), np.array([1e-3, 0.0, 0.0]), []
    problem = ctr.ForwardProblem(robot)
    for turn in np.linspace(0.0, 3.0, 5):
        actuation = ctr.Actuation([turn, 1.2], INNER_ENDS.translations)
        frame = problem.solve(actuation).pose(0.05, 0)
        seen = ctr.PositionMeasurement(0.05, frame[:3, 3] + frame[:3, :3] @ mounted, sigma=1e-4, sensor="coil")
        experiments.append(ctr.Experiment(actuation, [], [seen]))
    fit = ctr.CalibrationProblem(robot, experiments, ["sensors.coil.translation"], compiled=compiled).solve()
    np.testing.assert_allclose(fit.values["sensors.coil.translation"], mounted, rtol=0.0, atol=1e-8)


@COMPILED
def test_a_model_that_is_kept_follows_the_tube_that_is_there(compiled):
    """Two estimates by one problem, before and after the inner tube has been drawn back behind the sensor."""
    robot, push = two(0.10, 0.05), [ctr.PointWrench([0.1, 0.05, 0.0], tube=1)]
    problem = ctr.ForceEstimationProblem(robot, ctr.PointForce(0.05, tube=1), compiled=compiled)
    for inner in (-0.09, -0.104):
        actuation = ctr.Actuation([0.0, 1.2], [inner, -0.02])
        shape = ctr.ForwardProblem(robot).solve(actuation, push)
        seen = [
            ctr.PoseMeasurement(0.05, shape.pose(0.05), sigma=[1e-4] * 3 + [1e-3] * 3),
            ctr.PositionMeasurement(None, shape.tip_position, sigma=1e-4),
        ]
        found = problem.solve(actuation, seen, push)
        assert found.consistent
        np.testing.assert_allclose(found.estimates, 0.0, atol=1e-6)


@COMPILED
def test_a_force_at_the_tip_acts_there_though_an_outer_tube_ends_last(compiled):
    robot, force = two(0.10, 0.05), np.array([0.02, -0.03, 0.01])
    shape = ctr.ForwardProblem(robot, compiled=compiled).solve(INNER_ENDS, [ctr.PointWrench(force, tube=1)])
    places = np.linspace(0.02, shape.length, 6)
    seen = ctr.PositionMeasurement(places, shape.position(places), sigma=1e-5)
    found = ctr.ForceEstimationProblem(robot, ctr.TipForce(), compiled=compiled).solve(INNER_ENDS, seen)
    np.testing.assert_allclose(found.estimates, force, rtol=0.0, atol=1e-6)
