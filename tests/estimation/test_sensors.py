"""Sensors on tubes in unknown poses: what they show, slopes, recovery by both methods and models, what stays open."""

import attrs
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ctr_opt as ctr
from tests.support.estimated import NOISE, actuations, arc_length, estimation, flat, small_robot, solve

pytestmark = pytest.mark.usefixtures("compiling")

COMPILED = pytest.mark.parametrize("compiled", [False, True], ids=["virtual machine", "compiled"])
COIL = {"sensors.coil.translation": np.array([1e-3, -2e-3, 4e-3]), "sensors.coil.rotation": np.array([0.2, -0.3, 0.4])}
RING = {"sensors.ring.translation": np.array([3e-3, 0.0, -1e-3]), "sensors.ring.rotation": np.array([-0.1, 0.5, 1.0])}
HOMES = {"tubes[0].rotation_offset": 0.1, "tubes[1].rotation_offset": -0.05, "tubes[0].translation_offset": -2e-3}
COIL_TURN = ctr.Parameter("sensors.coil.rotation", prior=(COIL["sensors.coil.rotation"], 0.5))  # about its own axis too
SIGMA = [NOISE["position"]] * 3 + [NOISE["angle"]] * 3


def mounted(shape, place, values):
    """Pose (4, 4) of a sensor on the material frame of the tube that is there."""
    tube = place.tube if isinstance(place, ctr.Distal) else None
    translation, angles = values.values()
    mount = np.eye(4)
    mount[:3, :3], mount[:3, 3] = Rotation.from_euler("XYZ", angles).as_matrix(), translation
    return shape.pose(arc_length(shape, place), tube) @ mount


def both(shape):
    """A coil at the tip by position and direction, a ring at the outer tube's end by its pose, and a bare torque."""
    coil, ring = mounted(shape, None, COIL), mounted(shape, ctr.Distal(1), RING)
    return [
        ctr.PositionMeasurement(None, coil[:3, 3], NOISE["position"], sensor="coil"),
        ctr.PoseMeasurement(ctr.Distal(1), ring, SIGMA, sensor="ring"),
        ctr.TorqueMeasurement(1, shape.actuator_wrench(1)[1], NOISE["torque"]),
        ctr.TangentMeasurement(None, coil[:3, 2], NOISE["angle"], sensor="coil"),
    ]


def tips(shape):
    """The coil alone."""
    return [each for each in both(shape) if getattr(each, "sensor", None) == "coil"]


def made(robot, measured, count=8, homes=HOMES, reported=None):
    """Experiments without noise, their joints recorded without the home offsets."""
    moved = [[homes.get(f"tubes[{i}].{kind}_offset", 0.0) for i in (0, 1)] for kind in ("rotation", "translation")]
    found = []
    for each in reported or actuations(np.random.default_rng(3), robot, count):
        real = ctr.Actuation(each.rotations + moved[0], each.translations + moved[1])
        found.append(ctr.Experiment(each, [], measured(solve(robot, real, tolerance=1e-11))))
    return found


def at(values):
    """Parameters that start there."""
    return [ctr.Parameter(name, initial=value) for name, value in values.items()]


@pytest.fixture(scope="module")
def robot():
    return small_robot(2)


@COMPILED
def test_what_sensors_show(robot, compiled):
    """Their poses on shapes found by themselves: nothing is left over; two discretizations, 5e-9 m apart, per 5e-4."""
    start, equilibria = estimation(
        robot, made(robot, both, 3), at(COIL | RING | HOMES), tolerance=1e-11, compiled=compiled
    )
    for each in start.linearize(start.unknowns.initial, [shape.unknowns for shape in equilibria]):
        np.testing.assert_allclose(each.misfit + each.misfit_z @ each.step, 0.0, atol=5e-5)


@COMPILED
def test_slopes_are_differences(robot, compiled):
    """By all numbers of both sensors, away from the answer: 1e-7 of the largest, as differences of 1e-5 leave."""
    names = ["base.rotation", *COIL, "tubes[1].bending_stiffness", *RING]
    start, equilibria = estimation(robot, made(robot, both, 2), names, compiled=compiled)
    moments = [shape.unknowns for shape in equilibria]
    x = start.unknowns.initial + 0.1 * np.sin(1.0 + np.arange(start.unknowns.size)) * start.unknowns.scale
    here = start.linearize(x, moments)
    for k, label in enumerate(start.unknowns.labels):
        h = 1e-5 * start.unknowns.scale[k] * (np.arange(len(x)) == k)
        after, before = start.linearize(x + h, moments), start.linearize(x - h, moments)
        for layout, one, a, b in zip(start.layouts, here, after, before, strict=True):
            found = one.misfit_x * start.unknowns.scale[layout.acting]
            expected = start.unknowns.scale[k] * (a.misfit - b.misfit) / (2.0 * h[k])
            np.testing.assert_allclose(found[:, k], expected, rtol=0.0, atol=1e-7 * np.abs(found).max(), err_msg=label)


@pytest.mark.parametrize("method", ["simultaneous", "reduced"])
def test_exact_data_give_the_truth(robot, method):
    """Two sensors and the homes to 1e-6 m and rad, and a stiffness that was right stays."""
    names = ["sensors.coil.translation", COIL_TURN, *HOMES, *RING, "tubes[1].bending_stiffness"]
    fit = ctr.CalibrationProblem(robot, made(robot, both), names, tolerance=1e-10).solve(method=method)
    for name, value in (COIL | RING | HOMES).items():
        np.testing.assert_allclose(fit.values[name], value, rtol=0.0, atol=1e-6, err_msg=name)
    np.testing.assert_allclose(fit.robot.tubes[1].bending_stiffness, robot.tubes[1].bending_stiffness, rtol=1e-5)


def test_methods_and_models_agree_on_noisy_data(robot):
    """To 1e-4 standard errors; the models' meshes differ by some 1e-9 of the length. The truth is within four."""
    rng, data = np.random.default_rng(11), []
    homes = {name: value for name, value in HOMES.items() if "rotation" in name}
    for each in made(robot, tips, homes=homes):
        point, axis = each.measurements
        shaken = [
            attrs.evolve(point, position=point.position[0] + NOISE["position"] * rng.normal(size=3)),
            attrs.evolve(axis, direction=axis.direction + NOISE["angle"] * rng.normal(size=3)),
        ]
        data.append(attrs.evolve(each, measurements=shaken))
    names = ["sensors.coil.translation", COIL_TURN, *homes]
    fits = [
        ctr.CalibrationProblem(robot, data, names, tolerance=1e-9, compiled=compiled).solve(method=method)
        for method, compiled in (("simultaneous", True), ("reduced", True), ("simultaneous", False))
    ]
    values, errors = flat(fits[0].values), flat(fits[0].standard_errors)
    for fit in fits[1:]:
        np.testing.assert_allclose(flat(fit.values) / errors, values / errors, rtol=0.0, atol=1e-4)
        np.testing.assert_allclose(flat(fit.standard_errors), errors, rtol=1e-4)
    assert np.abs((values - flat(COIL | homes)) / errors).max() < 4.0


# -- what data do not determine ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["simultaneous", "reduced"])
def test_a_turn_about_a_measured_axis(robot, method):
    """Of a sensor that shows its axis alone; the rest is determined, and the robot, of which it is no part."""
    names = [*COIL, "tubes[0].translation_offset", "tubes[1].bending_stiffness"]
    homes = {"tubes[0].translation_offset": HOMES["tubes[0].translation_offset"]}
    fit = ctr.CalibrationProblem(robot, made(robot, tips, homes=homes), names).solve(method=method)
    assert [str(each) for each in fit.undetermined] == ["sensors.coil.rotation.z is not determined"]
    assert np.isnan(fit.values["sensors.coil.rotation"]).tolist() == [False, False, True]
    np.testing.assert_allclose(fit.robot.tubes[1].bending_stiffness, robot.tubes[1].bending_stiffness, rtol=1e-4)
    assert np.isfinite(fit.values["sensors.coil.translation"]).all()


def test_homes_and_the_roll_of_the_base(robot):
    """Turned together they are the same robot, whatever sensors show: one direction, and none without the base."""
    homes = [f"tubes[{i}].rotation_offset" for i in (0, 1)]
    data = made(robot, both, 6, homes={})
    fit = ctr.CalibrationProblem(robot, data, ["base.rotation", *homes, *RING]).solve()
    (direction,) = fit.undetermined
    moves = np.array([direction.parts[name] for name in ("base.rotation.z", *homes)])
    np.testing.assert_allclose(moves / moves[0], [1.0, -1.0, -1.0], rtol=0.0, atol=1e-3)
    with pytest.raises(ctr.EstimationError, match="the data do not determine the robot"):
        _ = fit.robot
    assert ctr.CalibrationProblem(robot, data, [*homes, *RING]).solve().undetermined == []


def test_arcs_that_begin_at_the_entry(robot):
    """Slopes by translations have two sides there, where the fit starts: one is taken, and it ends at the truth."""
    rotations = np.random.default_rng(4).uniform(-1.5, 1.5, (8, 2))
    reported = [ctr.Actuation(each, [-0.16, -0.09]) for each in rotations]
    offset = "tubes[0].translation_offset"
    data = made(robot, tips, homes={offset: -2e-3}, reported=reported)
    fit = ctr.CalibrationProblem(robot, data, ["sensors.coil.translation", COIL_TURN, offset], compiled=True).solve()
    np.testing.assert_allclose(fit.values[offset], -2e-3, rtol=0.0, atol=1e-6)
