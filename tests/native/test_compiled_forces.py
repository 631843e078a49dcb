"""Forces of actuators by compiled code: against the symbolic model, solved shapes and the estimates that follow."""

import attrs
import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.force.model import loaded_model
from ctr_opt.layout.observables import Observable
from ctr_opt.native.compile import compiler
from ctr_opt.native.predictions import Predictions
from ctr_opt.robot.names import parameters
from tests.support.both_models import NUMBERS, predicted_by_both, pushed, same
from tests.support.estimated import actuations, experiments, flat, off_by, small_robot, solve
from tests.support.perturbed import TIGHT, central, changed
from tests.support.slow import some_slow

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")

FORCE = Observable("actuator_force", None, 0)


def of_arcs(tubes):
    """Tubes of constant precurvatures, the first of two that differ."""
    made = small_robot(tubes)
    pieces = [ctr.Straight(0.16), ctr.Arc(0.07, [2.0, 9.0, 0.2]), ctr.Arc(0.02, [-5.0, 4.0, 0.4])]
    return attrs.evolve(made, tubes=[attrs.evolve(made.tubes[0], precurvature=pieces), *made.tubes[1:]])


def forces(tubes):
    """One for each tube."""
    return [ctr.ForceMeasurement(i, 0.0, sigma=0.02) for i in range(tubes)]


def riding(tubes):
    """Along the rest of the last tube, dead and in its frame."""
    density = [0.5, 0.2, -0.4], [0.01, 0.03, -0.02]
    return [ctr.DistributedLoad(*density, 0.01, tube=tubes - 1, frame=frame) for frame in ("world", "body")]


@pytest.mark.parametrize(
    ("tubes", "body"), some_slow([(1, False), (2, False), (3, False), (2, True)], [(1, False), (2, True)])
)
def test_both_models_tell_the_same(tubes, body):
    """Away from equilibrium, by numbers of loads, robot and actuation, and the base's place where a potential falls."""
    robot, rng = of_arcs(tubes), np.random.default_rng(tubes)
    (actuation,) = actuations(rng, robot, 1)
    loads = [*pushed(tubes)[: 4 + body], *riding(tubes)[: 1 + body]]
    z = 2e-3 * rng.normal(size=2 + tubes + 3 * body)
    names = [*NUMBERS, f"loads[{4 + body}].force", f"loads[{4 + body}].moment", "loads[1].arc_length"]
    others = ["rotations", "translations", "base.rotation", "base.translation", "tubes[0].precurvature[2].curvature"]
    others += [f"tubes[{tubes - 1}].{field}" for field in ("outer_diameter", "youngs_modulus", "shear_modulus")]
    others += [f"tubes[{i}].precurvature[1].curvature" for i in range(tubes)]
    same(*predicted_by_both(robot, actuation, loads, (names, others), forces(tubes), z))


def test_break_points_that_coincide():
    """Two tubes flush at the tip, and loads where the third ends: in the order of the symbolic model.

    That has no slack: 1e-14 m make the inner one end first there.
    """
    robot = of_arcs(3)
    (actuation,) = actuations(np.random.default_rng(2), robot, 1)
    ends = actuation.translations + [tube.length for tube in robot.tubes]
    flush = ctr.Actuation(actuation.rotations, actuation.translations + np.array([0.0, ends[0] - ends[1] + 1e-14, 0.0]))
    there = [
        ctr.PointWrench([0.1, 0.2, -0.1], [1e-3, 0.0, 2e-3], float(ends[2]), 2),
        ctr.DistributedLoad([1.0, 2.0, 3.0], [0.01, 0.02, 0.0], 0.02, float(ends[2])),
    ]
    loads = [*pushed(3)[:4], *riding(3)[:1], *there]
    z = 2e-3 * np.random.default_rng(3).normal(size=5)
    names = [*NUMBERS, "loads[4].force", "loads[5].force", "loads[5].moment", "loads[6].force"]
    same(*predicted_by_both(robot, flush, loads, (names, ["rotations", "tubes[2].outer_diameter"]), forces(3), z))


@pytest.mark.slow
def test_slopes_are_differences_of_equilibria():
    """Each number moved on its own, the robot in equilibrium again: solves to 1e-11 leave 1e-6 of the largest."""
    robot, rng = of_arcs(2), np.random.default_rng(5)
    (actuation,) = actuations(rng, robot, 1)
    loads = [*pushed(2)[:3], *riding(2)[:1]]
    start = ctr.ForwardProblem(robot, tolerance=TIGHT).solve(actuation, loads)
    names = ["loads[0].force", "loads[1].arc_length", "loads[3].force", "rotations", "translations"]
    names += ["tubes[1].inner_diameter", "tubes[0].precurvature[2].curvature", "base.translation"]
    known, n = parameters(robot, actuation, loads), len(start.unknowns)
    observables = [one for each in forces(2) for one in each.observables]
    at = loaded_model(robot, actuation, loads, (), names, observables, True, lambda: 1).at(
        start.unknowns, np.zeros(0), np.zeros(0)
    )
    assert [each.value[0, 0] for each in at.predictions] == pytest.approx(
        [start.actuator_wrench(i)[0] for i in range(2)], rel=1e-8
    )
    rates = np.array([each.slopes[0, 0] for each in at.predictions])
    slopes = rates[:, n:] - rates[:, :n] @ np.linalg.solve(at.slopes[:, :n], at.slopes[:, n:])
    first = 0
    for name in names:
        value = known[name].value
        direction = rng.uniform(-1.0, 1.0, value.shape)
        h = 2e-5 if name in ("translations", "loads[1].arc_length") else 1e-3 * max(np.abs(value).max(), 1e-3)

        def reported(x, name=name, value=value, direction=direction):
            made, held, pushing = changed(robot, actuation, loads, name, value + x * direction)
            shape = ctr.ForwardProblem(made, tolerance=TIGHT).solve(held, pushing, initial=start)
            return np.array([shape.actuator_wrench(i)[0] for i in range(2)])

        wanted = central(reported, h)
        found = slopes[:, first : first + value.size] @ np.ravel(direction)
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-6 * np.abs(wanted).max(), err_msg=name)
        first += value.size


def test_a_piece_that_begins_at_the_entry():
    """There the force has two sides: it is that against drawing back."""
    pieces = [ctr.Arc(0.03, 4.0), ctr.Arc(0.06, 9.0)]
    robot = ctr.Robot([ctr.Tube("rod", 1e-3, 0.0, pieces, youngs_modulus=60e9, poisson_ratio=0.3)])
    actuation, loads = ctr.Actuation([0.3], [-0.03]), [ctr.PointWrench([0.1, 0.2, -0.1], [2e-3, 1e-3, 1e-3])]
    shape = solve(robot, actuation, loads, TIGHT)
    reported = Predictions(robot, [], [(actuation, loads)], [FORCE]).at(shape.unknowns[None])
    assert reported.observed[0].value[0, 0] == pytest.approx(shape.actuator_wrench(0, side=-1)[0], abs=1e-8)


def test_a_force_at_the_tip():
    """By the actuators and points: both models say the same, to 1e-4 standard errors."""
    robot, rng = of_arcs(2), np.random.default_rng(7)
    (actuation,) = actuations(rng, robot, 1)
    shape = solve(robot, actuation, [ctr.PointWrench([0.1, -0.08, 0.3])], TIGHT)
    s = np.linspace(0.2, 1.0, 6) * shape.length
    measured = [ctr.PositionMeasurement(s, shape.position(s) + 2e-4 * rng.normal(size=(6, 3)), 2e-4)]
    measured += [ctr.ForceMeasurement(i, shape.actuator_wrench(i)[0] + 0.02 * rng.normal(), 0.02) for i in range(2)]
    measured.append(ctr.TorqueMeasurement(0, shape.actuator_wrench(0)[1], 1e-4))
    both = [ctr.ForceEstimationProblem(robot, ctr.TipForce(), compiled=each, tolerance=1e-9) for each in (True, False)]
    found = [problem.solve(actuation, measured) for problem in both]
    deviation = found[0].deviations.min()
    np.testing.assert_allclose(found[0].force, found[1].force, rtol=0.0, atol=1e-4 * deviation)
    np.testing.assert_allclose(found[0].covariance, found[1].covariance, rtol=1e-4, atol=1e-6 * deviation**2)


@pytest.mark.parametrize("method", ["simultaneous", "reduced"])
def test_forces_tell_stiffnesses(method):
    """Exact ones of free tubes, which shapes do not, to the solves' accuracy."""
    robot = of_arcs(2)
    names = ["tubes[0].bending_stiffness", "tubes[1].bending_stiffness"]

    def measured(shape, _):
        return [ctr.ForceMeasurement(i, shape.actuator_wrench(i)[0], 0.02) for i in range(2)]

    data = experiments(robot, 3, 2, measured, loaded=False, noise=False)
    start = off_by(robot, {names[0]: 1.2, names[1]: 0.85})
    fit = ctr.CalibrationProblem(start, data, names, tolerance=1e-9, compiled=True).solve(method=method)
    assert fit.estimation.models[0].compiled is not None
    np.testing.assert_allclose(flat(fit.values), [tube.bending_stiffness for tube in robot.tubes], rtol=1e-6)


def test_precurvature_that_varies_is_left_to_the_virtual_machine():
    robot = small_robot(2)
    (actuation,) = actuations(np.random.default_rng(5), robot, 1)
    observables = [one for each in forces(2) for one in each.observables]
    model = loaded_model(robot, actuation, [], (), ["rotations"], observables, True, lambda: 1)
    assert not model.compiled
    with pytest.raises(ctr.DefinitionError, match="cannot predict it for this robot"):
        Predictions(robot, [], [(actuation, [])], [FORCE])
