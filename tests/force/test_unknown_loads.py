"""Measured forces of actuators: predictions against ``actuator_wrench``, slopes against differences, an estimate."""

import attrs
import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.robot.names import parameters
from tests.support.estimated import actuations, arc_length, estimation, experiments, flat, off_by, small_robot, solve
from tests.support.perturbed import central, changed
from tests.support.slow import some_slow

TIGHT = 1e-11


def forces(shape, rng=None):
    """Of every tube, off by errors of 20 mN if there is a generator."""
    found = [shape.actuator_wrench(i)[0] for i in range(len(shape.robot.tubes))]
    errors = np.zeros(len(found)) if rng is None else 0.02 * rng.normal(size=len(found))
    return [
        ctr.ForceMeasurement(i, force + off, 0.02) for i, (force, off) in enumerate(zip(found, errors, strict=True))
    ]


def predicted(robot, actuation, loads, wanted):
    """The predicted forces of all tubes in equilibrium, and their slopes, the robot staying in it."""
    none = [ctr.ForceMeasurement(i, 0.0, sigma=1.0) for i in range(len(robot.tubes))]
    made, shapes = estimation(robot, [ctr.Experiment(actuation, loads, none)], wanted, tolerance=TIGHT, compiled=None)
    (each,) = made.linearize(made.unknowns.initial, [shape.unknowns for shape in shapes])
    return each.settled, each.reduced


def pulled(tubes):
    """Loads of several kinds: at a point, along a tube's rest, riding on its end, and of a potential."""
    return [
        ctr.PointWrench([0.2, -0.1, 0.15], [2e-3, -1e-3, 1e-3], 0.03),
        ctr.DistributedLoad([0.5, 0.2, -0.4], start=0.01, tube=tubes - 1),
        ctr.PointWrench([0.05, 0.1, -0.1], tube=tubes - 1, frame="body"),
        ctr.PotentialLoad(lambda p: 30.0 * p[1] ** 2, arc_length=0.02),
    ]


def test_predictions_are_those_of_shapes():
    """Of three tubes, free and loaded: sums of Hamiltonians on two meshes, 1e-8 of the largest force apart."""
    robot, rng = small_robot(3), np.random.default_rng(3)
    for actuation, loads in zip(actuations(rng, robot, 2), ([], pulled(3)), strict=True):
        shape = solve(robot, actuation, loads, TIGHT)
        wanted = [shape.actuator_wrench(i)[0] for i in range(3)]
        found, _ = predicted(robot, actuation, loads, ["base.translation"])
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-8 * np.abs(wanted).max())


def test_break_points_behind_the_entry_point():
    """An arc held straight stores ``EI kappa^2 / 2`` per length, wherever its pieces begin."""
    pieces = [ctr.Arc(0.03, 4.0), ctr.Arc(0.03, 7.0), ctr.Arc(0.06, 9.0)]
    rod = ctr.Tube("rod", 1e-3, 0.0, pieces, youngs_modulus=60e9, poisson_ratio=0.3)
    for drawn, bent in ((-0.01, 4.0), (-0.04, 7.0), (-0.07, 9.0)):
        found, _ = predicted(ctr.Robot([rod]), ctr.Actuation([0.3], [drawn]), [], ["base.translation"])
        np.testing.assert_allclose(found, -0.5 * rod.bending_stiffness * bent**2, rtol=1e-8)


@pytest.mark.parametrize(
    "name",
    [
        *("tubes[0].bending_stiffness", "tubes[1].torsional_stiffness"),
        *("tubes[0].precurvature[1].length", "loads[0].arc_length"),
    ],
)
def test_slopes_are_differences_of_equilibria(name):
    """Solved anew on four sides of each number, 1e-3 of its size away: their error and rounding leave 1e-6."""
    robot, loads = small_robot(2), pulled(2)[:2]
    (actuation,) = actuations(np.random.default_rng(4), robot, 1)
    own = f"experiments[0].{name}" if name.startswith("loads") else name
    _, slopes = predicted(robot, actuation, loads, [own])
    value = parameters(robot, actuation, loads)[name].value
    size = 1e-3 * (np.abs(value).max() or 1.0)
    start = solve(robot, actuation, loads, TIGHT)

    def reported(number):
        made, held, pushed = changed(robot, actuation, loads, name, value + number.reshape(value.shape))
        shape = ctr.ForwardProblem(made, tolerance=TIGHT).solve(held, pushed, initial=start)
        return np.array([shape.actuator_wrench(i)[0] for i in range(2)])

    for k in range(value.size):
        one = np.eye(value.size)[k]
        wanted = central(lambda h, one=one: reported(h * one), size)
        np.testing.assert_allclose(slopes[:, k], wanted, rtol=0.0, atol=1e-6 * np.abs(slopes).max())


def test_offsets_move_break_points():
    """The slope by a tube's translation, as above; steps of 20 um."""
    robot = small_robot(2)
    (actuation,) = actuations(np.random.default_rng(4), robot, 1)
    _, slopes = predicted(robot, actuation, pulled(2)[:1], ["tubes[1].translation_offset"])

    def reported(h):
        other = attrs.evolve(actuation, translations=actuation.translations + h * np.eye(2)[1])
        shape = solve(robot, other, pulled(2)[:1], TIGHT)
        return np.array([shape.actuator_wrench(i)[0] for i in range(2)])

    np.testing.assert_allclose(slopes[:, 0], central(reported, 2e-5), rtol=1e-6)


@pytest.mark.parametrize("method", some_slow(["simultaneous", "reduced"], ["simultaneous"]))
def test_forces_tell_stiffnesses(method):
    """Shapes of free tubes tell ratios alone; exact forces tell both to the solves' accuracy."""
    robot = small_robot(2)
    names = ["tubes[0].bending_stiffness", "tubes[1].bending_stiffness"]
    data = experiments(robot, 3, 2, forces, loaded=False, noise=False)
    start = off_by(robot, {names[0]: 1.2, names[1]: 0.85})
    fit = ctr.CalibrationProblem(start, data, names, tolerance=1e-9).solve(method=method)
    np.testing.assert_allclose(flat(fit.values), [tube.bending_stiffness for tube in robot.tubes], rtol=1e-6)
    noisy = experiments(robot, 3, 2, forces, loaded=False)
    fit = ctr.CalibrationProblem(start, noisy, names, tolerance=1e-9).solve(method=method)
    off = flat(fit.values) - [tube.bending_stiffness for tube in robot.tubes]
    assert off @ np.linalg.solve(fit.covariance, off) < 13.8  # chi-square of two is less but once in 1000
    assert fit.noise_accepted


def test_forces_beside_points():
    """Forces of tubes of varying precurvature take the virtual machine, others of the same fit compiled code."""
    robot = small_robot(2)
    with_force, without = experiments(robot, 2, 6, lambda shape, rng: _both(shape), noise=False)
    without = attrs.evolve(without, measurements=without.measurements[:1])
    start = off_by(robot, {"tubes[0].bending_stiffness": 1.2})
    fit = ctr.CalibrationProblem(start, [with_force, without], ["tubes[0].bending_stiffness"]).solve()
    assert fit.estimation.models[0].compiled is None
    np.testing.assert_allclose(flat(fit.values), robot.tubes[0].bending_stiffness, rtol=1e-6)


def _both(shape):
    end = shape.position(arc_length(shape, ctr.Distal(1)))
    return [ctr.PositionMeasurement(ctr.Distal(1), end, sigma=5e-4), *forces(shape)]


def test_wrong_forces_are_reported():
    with pytest.raises(ctr.DefinitionError, match="force = 'much' must be a finite number in N"):
        ctr.ForceMeasurement(0, "much")
    with pytest.raises(ctr.DefinitionError, match="sigma = 0 must be"):
        ctr.ForceMeasurement(0, 1.0, sigma=0)
    experiment = ctr.Experiment(ctr.Actuation([0.0], [-0.17]), [], [ctr.ForceMeasurement(1, 0.0, sigma=1.0)])
    with pytest.raises(ctr.DefinitionError, match="tube = 1 must be"):
        ctr.CalibrationProblem(small_robot(1), experiment, ["base.translation"])


def test_loads_for_which_no_force_is_defined():
    """As of shapes: a load that is a function of s has no work in what is added when its tube grows."""
    load = ctr.DistributedLoad(lambda s: np.array([0.1, 0.0, s]), start=0.01)
    experiment = ctr.Experiment(ctr.Actuation([0.0], [-0.17]), [load], [ctr.ForceMeasurement(0, 0.0, sigma=1.0)])
    with pytest.raises(ctr.DefinitionError, match=r"a load is given as a function of s, .* give the load as a table"):
        ctr.CalibrationProblem(small_robot(1), experiment, ["base.translation"]).solve()
