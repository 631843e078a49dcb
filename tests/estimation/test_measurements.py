"""What measurements predict, against solved shapes; residuals at large angles; noise levels of every form."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ctr_opt as ctr
from ctr_opt.layout.observables import Observed
from tests.support.estimated import actuations, estimation, experiments, fibre, points, small_robot, solve

COMPILED = pytest.mark.parametrize("compiled", [False, True], ids=["virtual machine", "compiled"])


def misfits(robot, data, compiled=False):
    """Whitened, in equilibrium, of experiments whose base moments are solved to 1e-11."""
    made, equilibria = estimation(robot, data, ["base.translation"], tolerance=1e-11, compiled=compiled)
    moments = [each.unknowns for each in equilibria]
    return [each.misfit + each.misfit_z @ each.step for each in made.linearize(made.unknowns.initial, moments)]


@COMPILED
@pytest.mark.parametrize("tubes", [1, 2, 3])
def test_positions_and_poses_are_those_of_shapes(tubes, compiled):
    """At the entry, inside, at tubes' ends, at the tip; two discretizations, 2e-9 m and rad apart."""
    robot, rng = small_robot(tubes), np.random.default_rng(tubes)
    data = []
    for actuation in actuations(rng, robot, 2):
        shape = solve(robot, actuation, [ctr.PointWrench(0.3 * rng.normal(size=3))], 1e-11)
        ends = np.array([tube.length for tube in robot.tubes]) + actuation.translations
        places = [0.0, 0.023, *(ctr.Distal(i) for i in range(tubes)), None]
        s = [0.0, 0.023, *ends, shape.length]
        last = tubes - 1
        measurements = [
            ctr.PositionMeasurement(places, shape.position(s), sigma=1.0),
            ctr.PoseMeasurement(0.0, shape.pose(0.0, last), sigma=1.0, tube=last),
            ctr.PoseMeasurement(0.023, shape.pose(0.023), sigma=1.0),
            ctr.PoseMeasurement(ctr.Distal(last), shape.pose(ends[last], last), sigma=1.0),
            ctr.PoseMeasurement(None, shape.tip_pose, sigma=1.0),
            ctr.TangentMeasurement(0.023, shape.pose(0.023)[:3, 2], sigma=1.0),
            ctr.TorqueMeasurement(last, shape.actuator_wrench(last)[1], sigma=1e-2),
        ]
        data.append(ctr.Experiment(actuation, shape.loads, measurements))
    for misfit in misfits(robot, data, compiled):
        np.testing.assert_allclose(misfit, 0.0, atol=5e-9)


@pytest.mark.parametrize("tubes", [1, 2, 3])
def test_curvatures_are_those_of_shapes(tubes):
    """In every tube's own frame: at the entry, on both sides of where others end, at its end; 1e-7 of 10/m."""
    robot, rng = small_robot(tubes), np.random.default_rng(tubes)
    (actuation,) = actuations(rng, robot, 1)
    loads = [ctr.PointWrench(0.3 * rng.normal(size=3), [2e-3, -1e-3, 1e-3])]
    shape = solve(robot, actuation, loads, 1e-11)
    ends = np.array([tube.length for tube in robot.tubes]) + actuation.translations
    measurements = []
    for tube, end in enumerate(ends):
        s = [0.0, 0.01, *(e - 1e-3 for e in ends[tube:]), *(e + 1e-3 for e in ends[tube + 1 :])]
        reported = [fibre(shape, tube, each) for each in s]
        measurements.append(ctr.CurvatureMeasurement(s, reported, sigma=1.0, tube=tube))
        measurements.append(ctr.CurvatureMeasurement(s[1], reported[1][:2], sigma=1.0, tube=tube))
        at_end = fibre(shape, tube, end)
        measurements.append(ctr.CurvatureMeasurement([ctr.Distal(tube), end], [at_end] * 2, sigma=1.0, tube=tube))
    measurements.append(ctr.CurvatureMeasurement(None, fibre(shape, 0, shape.length), sigma=1.0))
    for misfit in misfits(robot, [ctr.Experiment(actuation, shape.loads, measurements)]):
        np.testing.assert_allclose(misfit, 0.0, atol=1e-6)


@COMPILED
def test_the_innermost_tube_of_each_experiment(compiled):
    """Where another tube ends last, the pose is that of another: experiments of one kind are not of one model."""
    robot, data = small_robot(2), []
    for actuation in (ctr.Actuation([0.4, -0.5], [-0.16, -0.1]), ctr.Actuation([0.4, -0.5], [-0.19, -0.09])):
        shape = solve(robot, actuation, tolerance=1e-11)
        measured = [ctr.PoseMeasurement(s, shape.pose(shape.length if s is None else s), 1.0) for s in (None, 0.055)]
        data.append(ctr.Experiment(actuation, [], measured))
    for misfit in misfits(robot, data, compiled):
        np.testing.assert_allclose(misfit, 0.0, atol=5e-9)


def predicted(frame=None, position=(0.0, 0.0, 0.0), slopes=None):
    value = np.hstack((np.eye(3) if frame is None else frame, np.reshape(position, (3, 1))))
    return Observed(value[None], np.eye(6)[None] if slopes is None else slopes[None])


def compared(measurement, found):
    """Of one experiment."""
    values, slopes = measurement.compare([measurement], [found])
    return values[0], slopes[0]


@pytest.mark.parametrize("angle", [1e-9, 1e-5, 3e-4, 0.5, 2.0, 3.1])
def test_rotation_vectors_and_their_slopes(angle):
    """``log(predicted measured^T)``, in the world's axes; slopes against turns of 1e-5: 1e-10, and rounding."""
    axis = np.array([0.6, -0.48, 0.64])
    measured = Rotation.from_rotvec([0.3, 0.2, -1.0]).as_matrix()
    frame = Rotation.from_rotvec(angle * axis).as_matrix() @ measured
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = measured, [0.1, 0.2, 0.3]
    measurement = ctr.PoseMeasurement(None, pose, sigma=1.0)
    value, slopes = compared(measurement, predicted(frame, [0.1, 0.2, 0.4]))
    np.testing.assert_allclose(value[0], [0.0, 0.0, 0.1, *(angle * axis)], rtol=0.0, atol=1e-14)
    for k, turn in enumerate(1e-5 * np.eye(3)):
        after, before = (
            compared(measurement, predicted(Rotation.from_rotvec(sign * turn).as_matrix() @ frame))[0][0, 3:]
            for sign in (1, -1)
        )
        np.testing.assert_allclose(slopes[0][3:, 3 + k], (after - before) / 2e-5, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("angle", [0.0, 1e-8, 1e-5, 0.5, 2.0, 3.1])
def test_tangents_and_their_slopes(angle):
    """The residual's norm is the angle at any angle; slopes as above, and their norm along the angle is one."""
    measured = np.array([0.48, 0.6, 0.64])
    across = np.cross(measured, [1.0, 0.0, 0.0])
    axis = across / np.linalg.norm(across)
    aligned = Rotation.align_vectors(measured[None], [[0.0, 0.0, 1.0]])[0]
    frame = (Rotation.from_rotvec(angle * axis) * aligned).as_matrix()
    measurement = ctr.TangentMeasurement(None, 3.0 * measured, sigma=0.1)
    value, slopes = compared(measurement, predicted(frame))
    np.testing.assert_allclose(np.linalg.norm(value), angle, rtol=1e-9, atol=1e-15)
    for k, turn in enumerate(1e-5 * np.eye(3)):
        after, before = (
            compared(measurement, predicted(Rotation.from_rotvec(sign * turn).as_matrix() @ frame))[0][0]
            for sign in (1, -1)
        )
        np.testing.assert_allclose(slopes[0][:, 3 + k], (after - before) / 2e-5, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(slopes[0][:, 3:] @ axis), 1.0, rtol=1e-9)
    np.testing.assert_array_equal(slopes[0][:, :3], 0.0)


def test_the_opposite_tangent_is_half_a_turn_away():
    value, slopes = compared(ctr.TangentMeasurement(None, [0.0, 0.0, -1.0], sigma=0.1), predicted())
    np.testing.assert_allclose(np.linalg.norm(value), np.pi, rtol=1e-12)
    assert np.isfinite(slopes).all()


A = np.array([[1.0, 0.2, 0.0], [0.0, 0.8, 0.1], [0.3, 0.0, 0.5]])
TURN = Rotation.from_rotvec([0.7, -0.3, 1.1]).as_matrix()


@pytest.mark.parametrize(
    ("sigma", "covariances"),
    [
        (0.5, np.tile(0.25 * np.eye(3), (2, 1, 1))),
        ([0.5, 1.0, 2.0], np.tile(np.diag([0.25, 1.0, 4.0]), (2, 1, 1))),
        (A @ A.T, np.tile(A @ A.T, (2, 1, 1))),
        ([A @ A.T, np.eye(3)], np.array([A @ A.T, np.eye(3)])),
        (TURN @ (1e-8 * np.eye(3)) @ TURN.T, np.tile(1e-8 * np.eye(3), (2, 1, 1))),  # not symmetric to the last digit
    ],
    ids=["number", "axes", "covariance", "covariances", "turned"],
)
def test_whitening(sigma, covariances):
    """``W C W^T`` is one."""
    whitener = ctr.PositionMeasurement([0.01, None], np.zeros((2, 3)), sigma).whitener
    one = whitener @ covariances @ np.swapaxes(whitener, 1, 2)
    np.testing.assert_allclose(one, np.tile(np.eye(3), (2, 1, 1)), rtol=0.0, atol=1e-12)


def test_whitened_misfits_of_an_estimation():
    """A known error of every measurement, over its noise level."""
    robot = small_robot(2)
    (data,) = experiments(robot, 1, 3, points, noise=False)
    shape = solve(robot, data.actuation, data.loads, 1e-11)
    error = np.array([1e-3, -2e-3, 3e-3])
    covariance = 1e-6 * A @ A.T
    measurements = [
        ctr.PositionMeasurement(None, shape.tip_position - error, covariance),
        ctr.TorqueMeasurement(1, shape.actuator_wrench(1)[1] - 2e-4, 1e-4),
        ctr.CurvatureMeasurement(0.02, fibre(shape, 0, 0.02) - [0.1, 0.2, 0.3], [0.1, 0.2, 0.1]),
    ]
    (misfit,) = misfits(robot, [ctr.Experiment(data.actuation, data.loads, measurements)])
    np.testing.assert_allclose(misfit[:3] @ misfit[:3], error @ np.linalg.solve(covariance, error), rtol=1e-6)
    np.testing.assert_allclose(misfit[3:], [2.0, 1.0, 1.0, 3.0], rtol=1e-5)
