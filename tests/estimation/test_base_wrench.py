"""Wrenches on the support: the resultant of all loads, differences, closed forms; in files, fits and reports."""

from itertools import pairwise

import attrs
import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.files.calibration import load_calibration
from ctr_opt.files.force import load_force_problem
from ctr_opt.native.compile import compiler
from ctr_opt.robot.names import parameters
from tests.support.both_models import NUMBERS, predicted_by_both, pushed, same
from tests.support.estimated import actuations, estimation, small_robot, solve
from tests.support.perturbed import TIGHT, central, changed
from tests.support.slow import some_slow

compiled_too = pytest.mark.parametrize(
    "compiled",
    [False, pytest.param(True, marks=pytest.mark.skipif(compiler() is None, reason="needs a C compiler"))],
    ids=["virtual machine", "compiled"],
)
EARTH = np.array([0.0, -9.81, 0.0])


def heavy(tubes):
    """With weight."""
    made = small_robot(tubes)
    return attrs.evolve(made, tubes=[attrs.evolve(tube, density=6450.0) for tube in made.tubes], on_overlap="ignore")


def loaded(tubes, body):
    """At the tip, in the middle, along the robot and on its base; weights and masses."""
    known = pushed(tubes)[: 4 + body]
    return [*known, ctr.Gravity(EARTH), ctr.PointMass(0.01, 0.02, tubes - 1), ctr.DistributedMass(0.2, 0.01, 0.03)]


def resultant(shape):
    """Of all loads about the entry point: ``sum f``, ``sum (p - p_0) x f + l``; spans by Gauss quadrature."""
    robot, entry = shape.robot, shape.robot.base_pose[:3, 3]
    ends = shape.actuation.translations + [tube.length for tube in robot.tubes]
    nodes, weights = np.polynomial.legendre.leggauss(20)
    total = np.zeros(6)

    def add(s, force, moment=(0.0, 0.0, 0.0)):
        total[:3] += force
        total[3:] += np.cross(shape.position(s) - entry, force) + moment

    def along(start, end, density, moment=0.0):
        breaks = np.unique(np.clip([start, *shape.configuration.break_points, end], start, end))
        for a, b in pairwise(breaks):
            for x, w in zip(nodes, weights, strict=True):
                half = 0.5 * w * (b - a)
                add(0.5 * (a + b + x * (b - a)), half * density, half * moment)

    for load in shape.loads:
        if isinstance(load, ctr.PointWrench):
            s = ends[load.tube] if load.arc_length is None else load.arc_length
            frame = shape.pose(s, load.tube)[:3, :3] if load.frame == "body" else np.eye(3)
            add(s, frame @ load.force, frame @ load.moment)
        elif isinstance(load, ctr.PointMass):
            add(load.arc_length, load.mass * EARTH)
        elif isinstance(load, ctr.DistributedMass):
            along(load.start, load.end, load.mass_per_length * EARTH)
        elif isinstance(load, ctr.Gravity):
            for tube, end in zip(robot.tubes, ends, strict=True):
                along(0.0, end, tube.mass_per_length * EARTH)
        else:
            along(load.start, load.end, load.force, load.moment)
    return total


@compiled_too
@pytest.mark.parametrize(("tubes", "body"), some_slow([(1, False), (2, True), (3, False)], [(1, False), (3, False)]))
def test_it_is_the_resultant_of_all_loads(tubes, body, compiled):
    """Behind the entry point actuators hold and twist the tubes: of that nothing shows. Solves leave 1e-11 m."""
    robot = heavy(tubes)
    (actuation,) = actuations(np.random.default_rng(tubes), robot, 1)
    problem = ctr.ForwardProblem(robot, tolerance=TIGHT, compiled=compiled)
    shape = problem.solve(actuation, loaded(tubes, body))
    expected = resultant(shape)
    assert abs(shape.actuator_wrench(0)[1]) > 1e-4  # there is something to hide
    np.testing.assert_allclose(shape.base_wrench[:3], expected[:3], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(shape.base_wrench[3:], expected[3:], rtol=0.0, atol=1e-10)


def test_sensitivities_are_differences():
    """Each number moved on its own, the robot in equilibrium again: 1e-6 of the largest, as solves are to 1e-11."""
    robot, rng = heavy(2), np.random.default_rng(4)
    (actuation,) = actuations(rng, robot, 1)
    loads = loaded(2, True)
    problem = ctr.ForwardProblem(robot, tolerance=TIGHT)
    start = problem.solve(actuation, loads)
    names = ["loads[0].force", "loads[1].arc_length", "loads[2].end", "rotations", "translations", "base.rotation"]
    for name in [*names, "base.translation", "tubes[1].bending_stiffness", "tubes[0].density"]:
        slopes = start.sensitivity("base_wrench", name).reshape(6, -1)
        value = parameters(robot, actuation, loads)[name].value
        direction = rng.uniform(-1.0, 1.0, np.shape(value))
        h = 2e-5 if name.endswith(("translations", "arc_length", "end")) else 1e-3 * max(np.abs(value).max(), 1e-3)

        def moved(x, name=name, value=value, direction=direction):
            made, held, pushing = changed(robot, actuation, loads, name, value + x * direction)
            return ctr.ForwardProblem(made, tolerance=TIGHT).solve(held, pushing, initial=start).base_wrench

        wanted = central(moved, h)
        size = max(np.abs(wanted).max(), 1e-6)
        np.testing.assert_allclose(slopes @ np.ravel(direction), wanted, rtol=0.0, atol=1e-6 * size, err_msg=name)


@pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
@pytest.mark.parametrize(("tubes", "body"), [(1, False), (2, True)])
def test_both_models_tell_the_same(tubes, body):
    """Away from equilibrium, by numbers of loads, robot and actuation."""
    robot, rng = small_robot(tubes), np.random.default_rng(tubes)
    (actuation,) = actuations(rng, robot, 1)
    loads = [*pushed(tubes)[: 4 + body], ctr.Gravity(EARTH), ctr.PointMass(0.01, 0.02)]
    z = 2e-3 * rng.normal(size=2 + tubes + 3 * body)
    others = ["rotations", "translations", "base.rotation", "base.translation", "loads[1].arc_length"]
    measured = [ctr.BaseWrenchMeasurement(np.zeros(6), 1.0)]
    same(*predicted_by_both(robot, actuation, loads, (NUMBERS, others), measured, z))


@compiled_too
def test_residuals_are_errors_over_their_noise(compiled):
    robot = small_robot(2)
    (actuation,) = actuations(np.random.default_rng(1), robot, 1)
    shape = solve(robot, actuation, [ctr.PointWrench([0.2, -0.1, 0.3])], 1e-11)
    error = np.array([0.02, -0.01, 0.03, 1e-3, 2e-3, -3e-3])
    measured = ctr.BaseWrenchMeasurement(shape.base_wrench - error, sigma=(0.01, 1e-3))
    data = [ctr.Experiment(actuation, shape.loads, [measured])]
    made, equilibria = estimation(robot, data, ["base.translation"], tolerance=1e-11, compiled=compiled)
    (one,) = made.linearize(made.unknowns.initial, [equilibria[0].unknowns])
    np.testing.assert_allclose(one.settled, [2.0, -1.0, 3.0, 1.0, 2.0, -3.0], rtol=0.0, atol=1e-6)


@compiled_too
def test_a_tip_force_by_the_base_alone(compiled):
    """A straight rod, so stiff that it bends by 1e-8 of its length: ``F`` and ``L e_z x F`` with their noise."""
    length, sigma = 0.1, (0.01, 2e-4)
    rod = ctr.Tube("rod", 2e-3, 0.0, ctr.Straight(length), bending_stiffness=1e5, torsional_stiffness=1e5)
    force = np.array([0.3, -0.2, 0.5])
    rows = np.vstack((np.eye(3), length * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])))
    seen = ctr.BaseWrenchMeasurement(rows @ force, sigma)
    problem = ctr.ForceEstimationProblem(ctr.Robot([rod]), ctr.TipForce(), compiled=compiled)
    estimate = problem.solve(ctr.Actuation([0.0], [0.0]), seen)
    weights = np.repeat(np.power(sigma, -2.0), 3)
    np.testing.assert_allclose(estimate.force, force, rtol=0.0, atol=1e-6)
    expected = np.linalg.inv(rows.T @ (weights[:, None] * rows))
    np.testing.assert_allclose(estimate.covariance, expected, rtol=1e-6, atol=1e-7 * expected.max())
    assert estimate.degrees_of_freedom == 3
    assert not estimate.undetermined


@compiled_too
def test_base_and_points_find_a_wrench_at_the_tip(compiled):
    """Seeded noise: within four standard errors, and smaller ones than by points alone."""
    robot, rng = small_robot(2), np.random.default_rng(3)
    (actuation,) = actuations(rng, robot, 1)
    truth = np.array([0.15, -0.1, 0.2, 2e-3, -1e-3, 3e-3])
    shape = solve(robot, actuation, [ctr.PointWrench(truth[:3], truth[3:])], TIGHT)
    sigma = np.repeat([0.01, 3e-4], 3)
    s = np.linspace(0.2, 1.0, 8) * shape.length
    points = ctr.PositionMeasurement(s, shape.position(s) + 2e-4 * rng.normal(size=(8, 3)), 2e-4)
    base = ctr.BaseWrenchMeasurement(shape.base_wrench + sigma * rng.normal(size=6), sigma)
    problem = ctr.ForceEstimationProblem(robot, ctr.TipWrench(), compiled=compiled)
    both, alone = (problem.solve(actuation, seen) for seen in ([points, base], [points]))
    assert (np.abs(both.estimates - truth) < 4.0 * both.deviations).all()
    assert (both.deviations < alone.deviations).all()


@pytest.mark.parametrize("method", ["simultaneous", "reduced"])
def test_a_calibration_finds_the_force_that_was_not_written_down(method):
    """Beside the position of the tip, which tells a stiffness: exact data, to the solves' accuracy."""
    robot = small_robot(1)
    data = []
    for k, actuation in enumerate(actuations(np.random.default_rng(2), robot, 2)):
        shape = solve(robot, actuation, [ctr.PointWrench([0.2, -0.1 * k, 0.1])], TIGHT)
        tip = ctr.PositionMeasurement(None, shape.tip_position, 1e-4)
        data.append(
            ctr.Experiment(actuation, shape.loads, [tip, ctr.BaseWrenchMeasurement(shape.base_wrench, (0.01, 1e-3))])
        )
    data[1] = attrs.evolve(data[1], loads=[ctr.PointWrench([0.15, 0.0, 0.0])])
    names = ["experiments[1].loads[0].force", "tubes[0].bending_stiffness"]
    fit = ctr.CalibrationProblem(robot, data, names, tolerance=1e-9).solve(method=method)
    np.testing.assert_allclose(fit.values[names[0]], [0.2, -0.1, 0.1], rtol=0.0, atol=1e-6)
    assert fit.values[names[1]] == pytest.approx(robot.tubes[0].bending_stiffness, rel=1e-5)
    assert {"base force", "base moment"} <= {line[2:13].strip() for line in fit.report().splitlines()}


def test_a_table_of_experiments_holds_them(tmp_path):
    """In N and N mm, as written with four decimals; an experiment without one leaves its fields empty."""
    held = ctr.Actuation([0.1], [-0.01])
    wrench = np.array([0.1234, -0.5, 0.25, 1e-3, -2.5e-3, 3.1234e-3])
    tip = ctr.PositionMeasurement(None, [0.01, 0.0, 0.1])
    made = [ctr.Experiment(held, [], [tip, ctr.BaseWrenchMeasurement(wrench)]), ctr.Experiment(held, [], [tip])]
    ctr.write_experiments(tmp_path / "table.csv", made)
    assert "base_force_x [N]" in (tmp_path / "table.csv").read_text()
    assert "base_moment_z [N*mm]" in (tmp_path / "table.csv").read_text()
    sigmas = {"base_force": 0.01, "base_moment": [1e-3, 1e-3, 2e-3]}
    read = ctr.read_experiments(tmp_path / "table.csv", 1, sigma=1e-3, sigmas=sigmas)
    assert [len(each.measurements) for each in read] == [2, 1]
    found = read[0].measurements[1]
    np.testing.assert_allclose(found.wrench, wrench, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(np.diag(found.whitener[0]), [100.0] * 3 + [1e3, 1e3, 500.0])
    for wrong, message in (({"base_forces": 1.0}, "base_force, base_moment"), ({"base_force": 1.0}, "for both")):
        with pytest.raises(ctr.DefinitionError, match=message):
            ctr.read_experiments(tmp_path / "table.csv", 1, sigma=1e-3, sigmas=wrong)


def test_files_of_force_problems_and_calibrations(tmp_path):
    robot = '[[tubes]]\nname = "rod"\nouter_diameter = "2 mm"\ninner_diameter = 0\nbending_stiffness = 0.05\n'
    robot += 'torsional_stiffness = 0.04\nprecurvature = [{ kind = "straight", length = "0.1 m" }]\n'
    (tmp_path / "robot.toml").write_text(robot)
    head = 'title = "pushed"\nrobot = "robot.toml"\n[source]\ntext = "made up"\n'
    force = '[actuation]\nrotations = [0]\ntranslations = [0]\n[[unknown]]\nkind = "tip_force"\n[[measurements]]\n'
    force += 'kind = "base_wrench"\nforce = ["100 mN", 0, 0]\nmoment = [0, "10 N*mm", 0]\n'
    force += 'force_sigma = "10 mN"\nmoment_sigma = ["1 N*mm", "1 N*mm", "2 N*mm"]\n'
    (tmp_path / "problem.toml").write_text(head + force)
    given = load_force_problem(tmp_path / "problem.toml")
    (seen,) = given.measurements
    np.testing.assert_allclose(seen.wrench, [0.1, 0.0, 0.0, 0.0, 0.01, 0.0])
    np.testing.assert_allclose(np.diag(seen.whitener[0]), [100.0] * 3 + [1e3, 1e3, 500.0])
    np.testing.assert_allclose(given.solve().force, [0.1, 0.0, 0.0], rtol=0.0, atol=1e-4)
    rows = "rotation_0, translation_0, tip_x, tip_y, tip_z, base_force_x, base_force_y, base_force_z, "
    rows += "base_moment_x, base_moment_y, base_moment_z\n0, 0, 0, 0, 0.1, 0.1, 0, 0, 0, 0.01, 0\n"
    (tmp_path / "table.csv").write_text(rows)
    text = 'experiments = "table.csv"\nparameters = ["tubes[0].bending_stiffness"]\n'
    sigma = '[sigma]\nposition = "1 mm"\nbase_force = "10 mN"\nbase_moment = "1 N*mm"\n'
    (tmp_path / "calibration.toml").write_text(text + head + sigma)
    (experiment,) = load_calibration(tmp_path / "calibration.toml").experiments
    np.testing.assert_allclose(np.diag(experiment.measurements[1].whitener[0]), [100.0] * 3 + [1e3] * 3)


@pytest.mark.parametrize(
    ("wrench", "sigma", "message"),
    [
        ([1.0, 2.0, 3.0], None, "wrench has shape"),
        ([1.0, 2.0, 3.0, 4.0, 5.0, np.nan], None, r"wrench\[5\]"),
        (np.zeros(6), (0.1, 0.0), "sigma = .* must be positive"),
        (np.zeros(6), [0.1] * 4, "sigma has shape"),
        (np.zeros(6), -np.eye(6), "positive definite"),
        (np.zeros(6), "0.1 N", "sigma = '0.1 N'"),
    ],
)
def test_wrong_measurements_are_named(wrench, sigma, message):
    with pytest.raises(ctr.DefinitionError, match=message):
        ctr.BaseWrenchMeasurement(wrench, sigma)


def test_a_covariance_is_whitened():
    factor = np.tril(np.random.default_rng(0).normal(size=(6, 6))) + 3.0 * np.eye(6)
    measured = ctr.BaseWrenchMeasurement(np.zeros(6), factor @ factor.T)
    one = measured.whitener[0] @ factor @ factor.T @ measured.whitener[0].T
    np.testing.assert_allclose(one, np.eye(6), rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(measured.isotropic, measured.whitener)


def test_values_of_results_are_not_to_be_written_to():
    tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)
    problem, held = ctr.ForwardProblem(ctr.Robot([tube])), ctr.Actuation([0.0], [-0.02])
    with pytest.raises(ValueError, match="read-only"):
        problem.solve(held).base_wrench[:] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        problem.solve_many([held, held]).snapped[:] = True


def test_a_pair_of_covariances_is_refused():
    with pytest.raises(ctr.DefinitionError, match=r"sigma has shape \(2, 3, 3\), but must .* shape \(6, 6\)"):
        ctr.BaseWrenchMeasurement(np.zeros(6), (np.eye(3), np.eye(3)))
