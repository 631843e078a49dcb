"""Curvatures along fibres by compiled code: against the symbolic model, solved shapes and the estimates that follow."""

import attrs
import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.force.model import loaded_model
from ctr_opt.layout.observables import Distal
from ctr_opt.native.compile import compiler
from ctr_opt.robot.names import parameters
from tests.support.both_models import NUMBERS, predicted_by_both, pushed, same
from tests.support.estimated import actuations, arc_length, estimation, fibre, flat, off_by, small_robot, solve
from tests.support.perturbed import TIGHT, central, changed
from tests.support.slow import some_slow

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")

STEPS = {"translations": 2e-5, "arc_length": 2e-5}


def numbers_of(tubes):
    """Of robots, by what compiled code takes derivatives."""
    own = ["youngs_modulus", "shear_modulus", "outer_diameter", "inner_diameter"]
    shapes = ["tubes[0].precurvature[1].coefficients", *(f"tubes[{i}].precurvature[1].curvature" for i in (1, 2))]
    return [
        "rotations",
        "base.rotation",
        "base.translation",
        *(f"tubes[{tubes - 1}].{x}" for x in own),
        *shapes[:tubes],
    ]


def predicted(robot, actuation, loads, wanted, places, z):
    """Curvatures ``(2, places, 3)`` and their slopes by both models, at places of tubes."""
    measured = [ctr.CurvatureMeasurement(s, [[0.0] * 3], 1.0, tube) for s, tube in places]
    return predicted_by_both(robot, actuation, loads, wanted, measured, z)


@pytest.mark.parametrize(("tubes", "body"), some_slow([(1, False), (3, False), (2, True)], [(1, False)]))
def test_both_models_tell_the_same(tubes, body):
    """At the entry, at loads and where they begin and end, at break points, ends and the tip; away from equilibrium."""
    robot, rng = small_robot(tubes), np.random.default_rng(tubes)
    (actuation,) = actuations(rng, robot, 1)
    loads = pushed(tubes)[: 4 + body]
    ends = actuation.translations + [tube.length for tube in robot.tubes]
    z = 2e-3 * rng.normal(size=2 + tubes + 3 * body)
    if body:
        z[2 + tubes :] *= 10.0
    inside = [0.0, 0.0151, 0.03, 0.035, 0.036]
    bends = [s for i in range(tubes) for s in (robot.tubes[i].shape.breaks[1:] + actuation.translations[i]) if s > 0.0]
    places = [(s, tube) for tube in range(tubes) for s in (*inside, *bends) if s <= ends[tube]]
    places += [(None, 0), *((Distal(tube), tube) for tube in range(tubes))]
    if tubes < 3:  # of more the virtual machine takes long
        same(*predicted(robot, actuation, loads, (NUMBERS, numbers_of(tubes)), places, z))
    alone = [(s, tube) for s, tube in places if isinstance(s, Distal) or s is None or s in (0.0151, 0.036)]
    same(*predicted(robot, actuation, loads, (["loads[1].arc_length"], ["translations"]), alone, z))


@pytest.mark.parametrize("tubes", [1, 2, 3])
def test_slopes_are_differences_of_equilibria(tubes):
    """Each number moved on its own, the robot in equilibrium again: solves to 1e-11 leave 1e-6 of the largest."""
    robot, rng = small_robot(tubes), np.random.default_rng(10 + tubes)
    (actuation,) = actuations(rng, robot, 1)
    loads = pushed(tubes)[:3]
    problem = ctr.ForwardProblem(robot, tolerance=TIGHT)
    start = problem.solve(actuation, loads)
    places = [(0.0, 0), (0.011, tubes - 1), (0.03, tubes - 1), (0.038, 0), (None, 0)]
    measured = [ctr.CurvatureMeasurement(s, [[0.0] * 3], 1.0, tube) for s, tube in places]
    observables = [one for each in measured for one in each.observables]
    names = ["loads[0].force", "loads[1].moment", "loads[2].force", "rotations", "translations"]
    names += [f"tubes[{tubes - 1}].outer_diameter", f"tubes[{tubes - 1}].shear_modulus"]
    known, n = parameters(robot, actuation, loads), len(start.unknowns)
    model = loaded_model(robot, actuation, loads, (), names, observables, True, lambda: 1)
    at = model.at(start.unknowns, np.zeros(0), np.zeros(0))
    rates = np.array([each.slopes[0] for each in at.predictions])
    slopes = rates[..., n:] - rates[..., :n] @ np.linalg.solve(at.slopes[:, :n], at.slopes[:, n:])
    first = 0
    for name in names:
        value = known[name].value
        direction = rng.uniform(-1.0, 1.0, value.shape)
        h = STEPS.get(name, 1e-3 * max(np.abs(value).max(), 1e-3))

        def reported(x, name=name, value=value, direction=direction):
            made, held, pushing = changed(robot, actuation, loads, name, value + x * direction)
            shape = ctr.ForwardProblem(made, tolerance=TIGHT).solve(held, pushing, initial=start)
            return np.array([fibre(shape, tube, arc_length(shape, s) if s is None else s) for s, tube in places])

        wanted = central(reported, h)
        found = slopes[..., first : first + value.size] @ np.ravel(direction)
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-6 * np.abs(wanted).max(), err_msg=name)
        first += value.size


def test_values_have_the_side_of_shapes():
    """Behind what acts at a place, as shapes have it; at the tube's end from within, where the tip's moment acts."""
    robot, loads = small_robot(2), pushed(2)[:4]
    (actuation,) = actuations(np.random.default_rng(5), robot, 1)
    shape = solve(robot, actuation, loads, TIGHT)
    ends = actuation.translations + [tube.length for tube in robot.tubes]
    places = [(0.0, 1), (0.03, 1), (0.03, 0), (float(ends[1]), 1), (float(ends[1]), 0), (None, 0)]
    reported, _ = predicted(robot, actuation, loads, ((), ()), places, shape.unknowns)
    s = [min(shape.length if place is None else place, ends[tube] - 1e-11) for place, tube in places]
    wanted = [fibre(shape, tube, each) for each, (_, tube) in zip(s, places, strict=True)]
    np.testing.assert_allclose(reported[0], wanted, rtol=0.0, atol=1e-7)  # 1e-11 m in front of an end


def along(shape, rng=None, tube=0, count=20, noise=0.05):
    """A fibre in a tube, from its entry to near its end."""
    s = np.linspace(0.02, 0.98, count) * arc_length(shape, Distal(tube))
    reported = np.array([fibre(shape, tube, each)[:2] for each in s])
    return ctr.CurvatureMeasurement(
        s, reported + (0.0 if rng is None else noise * rng.normal(size=reported.shape)), noise, tube
    )


def test_a_force_at_the_tip():
    """From curvatures alone: exact ones give it to the solves' tolerance; of noisy ones both models say the same."""
    robot, rng, force = small_robot(3), np.random.default_rng(7), np.array([0.1, -0.08, 0.05])
    (actuation,) = actuations(rng, robot, 1)
    shape = solve(robot, actuation, [ctr.PointWrench(force)], TIGHT)
    both = [ctr.ForceEstimationProblem(robot, ctr.TipForce(), compiled=each, tolerance=1e-9) for each in (True, False)]
    np.testing.assert_allclose(both[0].solve(actuation, along(shape)).force, force, atol=1e-6)
    found = [problem.solve(actuation, along(shape, np.random.default_rng(8))) for problem in both]
    deviation = found[0].deviations.min()
    np.testing.assert_allclose(found[0].force, found[1].force, rtol=0.0, atol=1e-4 * deviation)
    np.testing.assert_allclose(found[0].covariance, found[1].covariance, rtol=1e-4, atol=1e-6 * deviation**2)
    off = found[0].force - force
    assert off @ np.linalg.solve(found[0].covariance, off) < 16.3  # chi-square of three is less but once in 1000
    assert found[0].consistent


def test_a_contact_somewhere():
    """Its force and its place, a direction of the tip and a torque beside the fibre."""
    robot = small_robot(2)
    (actuation,) = actuations(np.random.default_rng(9), robot, 1)
    push = ctr.PointWrench([0.3, -0.2, 0.0], arc_length=0.04)
    shape = solve(robot, actuation, [push], TIGHT)
    measured = [
        along(shape),
        ctr.TangentMeasurement(None, shape.tip_pose[:3, 2], 0.01),
        ctr.TorqueMeasurement(1, shape.actuator_wrench(1)[1], 1e-4),
    ]
    problem = ctr.ForceEstimationProblem(robot, ctr.PointForce(), compiled=True, tolerance=1e-9)
    found = problem.solve(actuation, measured)
    assert found.arc_length == pytest.approx(0.04, abs=1e-6)
    np.testing.assert_allclose(found.force[:2], push.force[:2], atol=1e-4)


@pytest.mark.parametrize("compiled", some_slow([True, False], [True]), ids=["compiled", "virtual machine"])
def test_a_calibration(compiled):
    """Of stiffness, precurvature, homes and base by fibres and tips, exact: 1e-6 of the values."""
    robot, rng, data = small_robot(2), np.random.default_rng(3), []
    for actuation in actuations(rng, robot, 6):
        loads = [ctr.PointWrench(0.3 * rng.normal(size=3))]
        shape = solve(robot, actuation, loads, TIGHT)
        tip = ctr.PoseMeasurement(None, shape.tip_pose, [5e-4] * 3 + [5e-3] * 3)
        data.append(ctr.Experiment(actuation, loads, [along(shape, count=6), tip, along(shape, tube=1, count=4)]))
    names = ["tubes[0].bending_stiffness", "tubes[1].precurvature[1].curvature", "tubes[1].torsional_stiffness"]
    start = off_by(robot, dict(zip(names, (1.1, 0.95, 0.9), strict=True)))
    homes = ["tubes[0].rotation_offset", "base.rotation"]
    fit = ctr.CalibrationProblem(start, data, [*names, *homes], tolerance=1e-10, compiled=compiled).solve()
    assert (fit.estimation.models[0].compiled is not None) is compiled
    known = parameters(robot, data[0].actuation, [])
    wanted = np.concatenate([*(np.ravel(known[name].value) for name in names), np.zeros(4)])
    np.testing.assert_allclose(flat(fit.values), wanted, rtol=1e-6, atol=1e-7)


def test_slopes_of_a_calibration():
    """Those of the two models, by all unknowns, offsets of the joints and angles of the base that is turned."""
    robot, data = small_robot(2), []
    for actuation in actuations(np.random.default_rng(6), robot, 2):
        shape = solve(robot, actuation, pushed(2)[:2])
        data.append(ctr.Experiment(actuation, shape.loads, [along(shape, count=5), along(shape, tube=1, count=3)]))
    names = ["base.rotation", "tubes[0].translation_offset", "tubes[1].rotation_offset", "tubes[1].inner_diameter"]
    each = []
    for compiled in (True, False):
        made, equilibria = estimation(robot, data, names, compiled=compiled)
        x = made.unknowns.initial + 0.01 * np.cos(np.arange(made.unknowns.size)) * made.unknowns.scale
        each.append(made.linearize(x, [shape.unknowns for shape in equilibria]))
    for a, b in zip(*each, strict=True):
        for field in ("misfit", "misfit_z", "misfit_x", "residual_x"):
            p, q = getattr(a, field), getattr(b, field)
            np.testing.assert_allclose(p, q, rtol=0.0, atol=1e-7 * np.abs(q).max(), err_msg=field)


@pytest.mark.parametrize("method", ["simultaneous", "reduced"])
def test_a_place_at_an_end_that_moves(method):
    """On the way to the truth, a home offset of -2 mm, the tube is too short for it: its end counts then."""
    robot, data = small_robot(2), []
    for actuation in actuations(np.random.default_rng(3), robot, 6):
        shape = solve(robot, attrs.evolve(actuation, translations=actuation.translations - [2e-3, 0.0]))
        s = [0.02, shape.length - 1e-9]
        seen = ctr.CurvatureMeasurement(s, [fibre(shape, 0, each) for each in s], 0.05)
        data.append(ctr.Experiment(actuation, [], [seen]))
    fit = ctr.CalibrationProblem(robot, data, ["tubes[0].translation_offset"], compiled=True).solve(method=method)
    np.testing.assert_allclose(fit.values["tubes[0].translation_offset"], -2e-3, rtol=0.0, atol=1e-8)


def test_a_fibre_at_the_end_of_another_tube():
    """Both models tell it behind the end, where the fibre's own tube goes on, and move with the other tube."""
    robot = small_robot(2)
    (actuation,) = actuations(np.random.default_rng(5), robot, 1)
    z = 5e-4 * np.random.default_rng(6).normal(size=4)
    wanted = (["loads[0].force"], ["translations", "tubes[0].youngs_modulus"])
    same(*predicted(robot, actuation, pushed(2)[:1], wanted, [(Distal(1), 0)], z))
    shape = solve(robot, actuation)
    seen = ctr.CurvatureMeasurement(Distal(1), fibre(shape, 0, arc_length(shape, Distal(1))), 1e-3, 0)
    made, equilibria = estimation(robot, [ctr.Experiment(actuation, [], [seen])], ["base.translation"], compiled=True)
    (one,) = made.linearize(made.unknowns.initial, [equilibria[0].unknowns])
    np.testing.assert_allclose(one.settled, 0.0, atol=1e-2)  # 1e-5 of 1/m, as solves are to 1e-9
