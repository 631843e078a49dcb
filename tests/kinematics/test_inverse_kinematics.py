"""Inverse kinematics: targets are reached as claimed, within limits, by stable shapes, or it is said why not."""

import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ctr_opt as ctr
from benchmarks.inverse_kinematics import Bench, Record, by_scipy, table
from ctr_opt.kinematics.least_distance import bounded_step, least_distance
from ctr_opt.kinematics.limits import Allowed
from ctr_opt.kinematics.search import Point
from ctr_opt.kinematics.targets import LENGTH, Target, _turn_between, rotation
from ctr_opt.native import library as libraries
from ctr_opt.native.compiler import SWITCH
from ctr_opt.robot.actuation import joints_of
from tests.support.physics import robot as made
from tests.support.physics import tube
from tests.support.slow import some_slow

TOLERANCE, ANGLE = 1e-6, 1e-4  # the defaults: m, rad
ROBOT_B = "problems/three_tubes/robot_b.toml"
AT = ctr.Actuation([0.3, 1.2, -0.5], [-0.3, -0.2, -0.1])


@pytest.fixture(scope="module")
def bench():
    return Bench.of("B", loaded=False)


@pytest.fixture(scope="module")
def problem(bench):
    return bench.problem


@pytest.fixture(scope="module")
def shape(problem):
    return problem.forward.solve(AT)


def circle(center, radius, count):
    t = np.linspace(0.0, 2.0 * np.pi, count)
    return center + radius * np.column_stack((np.cos(t) - 1.0, np.sin(t), 0.0 * t))


# -- targets -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "loaded"),
    some_slow(
        [(name, loaded) for loaded in (False, True) for name in ("A", "B", "RJW-S1")],
        [("A", False), ("B", True), ("RJW-S1", False)],
    ),
)
def test_positions_are_reached_from_home_as_claimed(name, loaded):
    bench = Bench.of(name, loaded)
    allowed = Allowed.of(bench.problem.robot, ctr.JointLimits())
    for shape in bench.shapes(200, seed=7):
        answer = bench.problem.solve(shape.tip_position, bench.loads)
        assert answer.converged, answer.message
        assert answer.stable
        assert allowed.room(joints_of(answer.actuation)).min() > -1e-15  # rounding of sums of lengths below 1 m
        position, _ = bench.errors(answer, Target.of(shape.tip_position, None, None))
        # The claim is of a solve with an error of a tenth of the tolerance, or of 1e-7 lengths; so much they differ.
        assert abs(position - answer.position_error) < min(0.1 * TOLERANCE, 1e-7 * shape.length)
        assert position < TOLERANCE


@pytest.mark.parametrize(
    ("name", "kind"),
    some_slow([("A", "axis"), ("A", "pose"), ("B", "axis"), ("B", "pose")], [("A", "axis"), ("B", "pose")]),
)
def test_axes_and_poses_are_reached(name, kind):
    bench = Bench.of(name, loaded=True)
    record = Record()
    for shape in bench.shapes(25, seed=3):
        record.solve(bench, kind, shape.tip_pose)
    assert record.share == 1.0
    assert np.all(np.max(record.errors, axis=0) < [TOLERANCE, ANGLE])


def test_tracking_stays_on_the_branch(bench):
    rng, record = np.random.default_rng(5), Record()
    for shape in bench.shapes(50, seed=5):
        answer = bench.problem.solve(shape.tip_position)
        record.solve(bench, "position", bench.moved(answer.equilibrium, rng).tip_pose, answer.equilibrium)
    assert record.share == 1.0
    assert set(record.starts) == {1}


def test_the_nearest_answer_has_no_nearer_one_beside_it(problem, shape):
    """Where no limit is met, what is left of the way back is across the directions in which the tip stays."""
    answer = problem.solve(shape.tip_position)
    back = problem.weights * (joints_of(problem.home) - joints_of(answer.actuation))
    rates = answer.equilibrium.jacobian()[:3] / problem.weights
    free = np.linalg.svd(rates)[2][3:]
    assert not answer.limits
    step = free.T @ (free @ back)
    gained = np.linalg.norm(back) - np.linalg.norm(back - step)
    assert gained < 0.02 * np.linalg.norm(back)  # it stops where a step promises less than a hundredth


def test_a_pose_may_stand_in_the_place_of_a_position(problem, shape):
    given = problem.solve(shape.tip_pose, initial=shape)
    assert given.converged
    assert given.distance < 1e-6  # it is there already
    assert given.angle_error < ANGLE


def test_where_stability_is_not_defined_it_is_said(problem, shape):
    answer = problem.solve(shape.tip_position, [ctr.PointWrench(moment=[0.001, 0.0, 0.0])])
    assert answer.converged
    assert answer.stable is None
    assert "stable          not defined" in answer.report()


def test_criteria_choose_the_best_of_all_starts(shape):
    robot = ctr.load_robot(ROBOT_B)
    found = {}
    for criterion in ("distance", "torsion", "stability"):
        problem = ctr.InverseKinematicsProblem(robot, criterion=criterion, starts=8, compiled=True)
        found[criterion] = problem.solve(shape.tip_position)
        assert found[criterion].converged
        assert found[criterion].starts == 8
    torsions = {name: np.abs(each.equilibrium.last_iterate.torsional).max() for name, each in found.items()}
    assert min(torsions, key=torsions.get) == "torsion"
    assert min(found, key=lambda name: found[name].distance) == "distance"
    eigenvalues = {name: each.equilibrium.stability for name, each in found.items()}
    assert eigenvalues["stability"] >= max(eigenvalues.values()) - 1e-3  # to which they are known


def test_the_base_may_stand_anywhere(shape):
    robot = ctr.load_robot(ROBOT_B)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation(np.array([0.4, -1.1, 0.7])), [0.2, -0.1, 0.3]
    problem = ctr.InverseKinematicsProblem(ctr.Robot(robot.tubes, pose), compiled=True)
    answer = problem.solve(target_pose=pose @ shape.tip_pose)
    assert answer.converged
    np.testing.assert_allclose(answer.equilibrium.tip_pose, pose @ shape.tip_pose, atol=ANGLE)


def test_one_tube_reaches_what_it_sweeps_and_says_what_it_does_not():
    problem = ctr.InverseKinematicsProblem(made(tube("rod", ctr.Arc(0.1, 10.0), 0.02, 0.015)), compiled=True)
    there = problem.forward.solve(ctr.Actuation([2.0], [-0.03])).tip_position
    answer = problem.solve(there)
    assert answer.converged
    # An error of the tip of 1e-6 m at a radius of 24 mm, and along the arc.
    np.testing.assert_allclose(joints_of(answer.actuation), [2.0, -0.03], atol=5e-5)
    beside = problem.solve(there + np.array([0.0, 0.0, 0.004]))
    assert beside.status is ctr.InverseKinematicsStatus.UNREACHABLE
    assert "no motion within the limits brings the tip nearer" in beside.message
    assert 0.0 < beside.position_error < 0.004  # nearer than the place above which the target stands


# -- limits ------------------------------------------------------------------------------------------------------------


def test_limits_are_kept_and_reported(shape):
    ranges = [[-0.32, -0.05], [-0.22, -0.04], [-0.11, -0.02]]
    limits = ctr.JointLimits(rotations=[[-2.0, 2.0]] * 3, translations=ranges, base_gap=0.01, tip_gap=0.02)
    problem = ctr.InverseKinematicsProblem(ctr.load_robot(ROBOT_B), limits=limits, compiled=True)
    met = set()
    lengths = np.array([each.length for each in problem.robot.tubes])
    for target in circle(shape.tip_position, 0.02, 12):
        answer = problem.solve(target)
        rotations, translations = answer.actuation.rotations, answer.actuation.translations
        assert np.abs(rotations).max() <= 2.0
        assert np.all((translations >= np.array(ranges)[:, 0]) & (translations <= np.array(ranges)[:, 1]))
        assert np.diff(translations).min() > 0.01 - 1e-15
        assert np.diff(translations + lengths).max() < -0.02 + 1e-15
        met.update(answer.limits)
    assert met <= set(problem._solver.allowed.names)
    assert met


def test_tubes_reach_as_far_as_the_loads_on_them(problem, shape):
    clamp = ctr.PointWrench(force=[0.02, 0.0, 0.0], arc_length=0.25, tube=0)
    answer = problem.solve([0.0, 0.0, 0.1], [clamp])
    assert not answer.converged  # the robot is at least 0.25 m long, and bends less
    assert "translations[0] at least -0.2129 m" in answer.limits


def test_far_targets_are_reported_with_the_nearest_shape(problem):
    behind = np.array([0.0, 0.0, -0.1])  # the entry, so that the robot is drawn in as far as it goes
    answer = problem.solve(behind)
    assert answer.status is ctr.InverseKinematicsStatus.UNREACHABLE
    assert answer.stable
    assert answer.starts == problem.starts
    for word in ("20 starts", "100 mm from the target", "no motion", "tip of tube 1 at least 0.0001 m in front"):
        assert word in answer.message
    assert "unreachable from here" in str(answer)
    distance = np.linalg.norm(answer.equilibrium.tip_position - behind)
    assert answer.position_error == pytest.approx(distance, abs=1e-15)
    assert distance == pytest.approx(0.1003, abs=1e-4)  # 0.1 mm of the outer tube, and two gaps of 0.1 mm


def test_poses_beyond_the_joints_are_unreachable():
    """Two tubes have four joints: a tip turned about its own axis out of the way is out of reach."""
    bench = Bench.of("RJW-S1", loaded=False, starts=3)
    (shape,) = bench.shapes(1, seed=2)
    pose = shape.tip_pose.copy()
    pose[:3, :3] = pose[:3, :3] @ rotation(np.array([0.5, 0.0, 0.0]))
    answer = bench.problem.solve(target_pose=pose)
    assert not answer.converged
    assert "deg from the target" in answer.message


# -- paths -------------------------------------------------------------------------------------------------------------


def largest_steps(path):
    """Of a rotation and of a translation."""
    steps = np.abs(np.diff(path.actuations, axis=0)).max(axis=0)
    return steps[:3].max(), steps[3:].max()


def test_a_path_is_continuous_and_on_its_targets(problem, shape):
    targets = circle(shape.tip_position, 0.01, 25)
    path = problem.solve_path(targets, initial=shape, longest_step=(0.1, 2e-3))
    rotation, translation = largest_steps(path)
    assert path.converged
    assert rotation <= 0.1
    assert translation <= 2e-3
    assert path.position_errors.max() < TOLERANCE
    np.testing.assert_allclose(path.tip_positions[path.waypoints], targets, atol=TOLERANCE)
    assert all(each.is_stable for each in path.equilibria)
    for before, after in zip(path.equilibria, path.equilibria[1:], strict=False):
        again = problem.forward.solve(after.actuation, initial=before)  # along the straight way of the joints
        np.testing.assert_allclose(again.unknowns, after.unknowns, atol=1e-8)  # N m, of some 1e-3


def test_long_ways_are_cut(problem, shape):
    targets = shape.tip_position + np.array([[0.0, 0.0, 0.0], [-0.02, 0.02, 0.0]])
    path = problem.solve_path(targets, initial=shape)
    assert len(path) > len(path.waypoints) == 2
    assert largest_steps(path)[0] <= 0.2
    assert largest_steps(path)[1] <= 5e-3


def test_paths_of_poses_turn_evenly(problem, shape):
    far = problem.forward.solve(ctr.Actuation(AT.rotations + 0.1, AT.translations - 0.002), initial=shape)
    path = problem.solve_path([far.tip_pose], initial=shape, longest_step=(0.03, 1e-3))
    assert len(path) >= 4
    assert path.angle_errors.max() < ANGLE
    turned = Rotation.from_matrix(far.tip_pose[:3, :3].T @ path.equilibria[-1].tip_pose[:3, :3])
    assert turned.magnitude() < ANGLE


def test_a_path_is_planned_anew_when_a_load_appears(problem, shape):
    targets, push = circle(shape.tip_position, 0.008, 9), ctr.PointWrench(force=[0.05, 0.05, 0.0])
    free = problem.solve_path(targets, initial=shape)
    whole = problem.solve_path(targets, [[]] * 5 + [[push]] * 4, initial=shape)
    there = free.equilibria[free.waypoints[4]]
    rest = problem.solve_path(targets[5:], [push], initial=there)
    for path in (whole, rest):
        assert path.position_errors.max() < TOLERANCE
        assert path.equilibria[-1].loads == (push,)
    np.testing.assert_allclose(rest.actuations[-1], whole.actuations[-1], atol=1e-12)
    assert np.abs(free.actuations[-1] - rest.actuations[-1]).max() > 0.01  # the load is felt


def test_where_a_path_breaks_off_is_reported(problem, shape):
    targets = [*circle(shape.tip_position, 0.001, 3)[:2], [0.0, 0.0, 1.0]]
    with pytest.raises(ctr.SolveError, match=r"breaks off on the way to targets\[2\]: .*limits") as caught:
        problem.solve_path(targets, initial=shape)
    path = caught.value.result
    assert path.status is ctr.InverseKinematicsStatus.BROKEN
    assert len(path.waypoints) == 2
    assert path.position_errors.max() < TOLERANCE
    first = problem.solve_path([[0.0, 0.0, 1.0]], throw=False)
    assert not first.converged
    assert len(first) == 0
    assert "targets[0]" in first.message


# -- without a compiler, input, parts ----------------------------------------------------------------------------------


def test_the_virtual_machine_finds_the_same():
    bench = Bench.of("RJW-S1", loaded=True)
    slow = ctr.InverseKinematicsProblem(bench.problem.robot, compiled=False)
    (shape,) = bench.shapes(1, seed=4)
    fast, machine = (each.solve(shape.tip_position, bench.loads) for each in (bench.problem, slow))
    assert machine.converged
    assert machine.position_error < TOLERANCE
    # Both errors are below 1e-6 m, and the tip moves by some 0.05 m with a radian.
    np.testing.assert_allclose(joints_of(machine.actuation), joints_of(fast.actuation), atol=1e-4)


def test_compiled_poses_are_those_of_the_states(bench):
    for shape in bench.shapes(5, seed=1):
        np.testing.assert_allclose(shape.tip_pose, shape.pose(shape.length), atol=1e-14)


def test_where_break_points_coincide_the_search_takes_the_advancing_side():
    """At home of robot A the outer tube ends where the inner one begins to be curved: derivatives have sides."""
    problem = Bench.of("A", loaded=False).problem
    home = problem.forward.solve(problem.home)
    assert home.one_sided
    assert set(home.kinks) == {0, 2}
    target = Target.of(home.tip_position, None, None)
    rates = problem.search(target, ())._rates(Point(home, target)) * problem.weights * LENGTH
    advancing, drawn_back = (home.jacobian(side=side)[:3] for side in (1, -1))
    np.testing.assert_allclose(rates, advancing, rtol=1e-14)  # scaled forth and back
    assert np.abs(advancing[:, 5] - drawn_back[:, 5]).max() > 1e-3


def test_results_and_problems_can_be_pickled(problem, shape):
    again = pickle.loads(pickle.dumps(problem))
    answer = pickle.loads(pickle.dumps(again.solve(shape.tip_position)))
    np.testing.assert_array_equal(answer.actuation.rotations, problem.solve(shape.tip_position).actuation.rotations)


def wrong(problem, shape):
    robot = problem.robot
    ik = ctr.InverseKinematicsProblem
    outside = ctr.Actuation([0.0, 0.0, 0.0], [-0.1, -0.2, -0.05])
    beyond = problem.forward.solve(outside)
    return {
        "no target": (lambda: problem.solve(), ["target_position", "target_pose"]),
        "two targets": (lambda: problem.solve([0, 0, 0.1], target_pose=np.eye(4)), ["not both"]),
        "an axis beside a pose": (lambda: problem.solve(target_pose=np.eye(4), target_axis=[0, 0, 1]), ["target_axis"]),
        "two numbers": (lambda: problem.solve([0.0, 0.1]), ["target_position", "(2,)", "(3,)"]),
        "no number": (lambda: problem.solve([0.0, 0.1, np.nan]), ["target_position[2]", "nan"]),
        "no direction": (lambda: problem.solve([0.0, 0.0, 0.1], target_axis=[0, 0, 0]), ["target_axis", "zero"]),
        "no rotation": (lambda: problem.solve(target_pose=2 * np.eye(4)), ["target_pose"]),
        "a load": (lambda: problem.solve([0, 0, 0.1], ctr.PointWrench()), ["list of loads"]),
        "no load": (lambda: problem.solve([0, 0, 0.1], ["push"]), ["loads[0]", "'push'"]),
        "no shape": (lambda: problem.solve([0, 0, 0.1], (), outside), ["initial", "Equilibrium"]),
        "a shape outside": (lambda: problem.solve([0, 0, 0.1], (), beyond), ["initial", "base of tube 0"]),
        "no targets": (lambda: problem.solve_path(np.zeros((0, 3))), ["targets is empty"]),
        "no steps": (lambda: problem.solve_path([shape.tip_position], longest_step=(0.0, 1.0)), ["longest_step"]),
        "loads of others": (lambda: problem.solve_path([shape.tip_position], [[], []]), ["loads has 2", "1 targets"]),
        "no list of loads": (lambda: problem.solve_path([shape.tip_position], None), ["loads = None", "list of loads"]),
        "no list in a list": (lambda: problem.solve_path([shape.tip_position], [None]), ["loads[0] = None"]),
        "one load": (lambda: problem.solve_path([shape.tip_position], ctr.PointWrench()), ["loads = Point", "targets"]),
        "a number for a load": (lambda: problem.solve_path([shape.tip_position], [[5]]), ["loads[0][0] = 5"]),
        "a load beyond its tube": (
            lambda: problem.solve([0, 0, 0.1], [ctr.PointWrench(force=[0.01, 0, 0], arc_length=0.6)]),
            ["loads[0]", "0.6 m", "tube 0", "0.4629 m"],
        ),
        "no rotation on a path": (
            lambda: problem.solve_path([np.eye(4), np.diag([2.0, 1.0, 1.0, 1.0])]),
            ["targets[1]", "not a rotation"],
        ),
        "no direction on a path": (
            lambda: problem.solve_path([[0, 0, 0.1]] * 2, axes=[[0, 0, 1], [0, 0, 0]]),
            ["axes[1]", "zero"],
        ),
        "axes beside poses": (lambda: problem.solve_path([np.eye(4)], axes=[[0, 0, 1]]), ["axes", "poses"]),
        "no robot": (lambda: ik("robot"), ["robot = 'robot'"]),
        "no limits": (lambda: ik(robot, limits=3), ["limits = 3", "JointLimits"]),
        "a home outside": (lambda: ik(robot, home=outside), ["home", "exceeds", "base of tube 0"]),
        "a home of others": (lambda: ik(robot, home=ctr.Actuation([0.0], [0.0])), ["home", "3 tubes"]),
        "no criterion": (lambda: ik(robot, criterion="best"), ["criterion", "'best'", "'nearest'"]),
        "no starts": (lambda: ik(robot, starts=0), ["starts = 0", "at least 1"]),
        "weights of nothing": (lambda: ik(robot, weights=[1, 1, 1, 0, 1, 1]), ["weights[3]", "above 0"]),
        "too tight": (lambda: ik(robot, tolerance=1e-12), ["tolerance", "1e-09"]),
        "upside down": (lambda: ctr.JointLimits(rotations=[[1.0, -1.0]]), ["rotations[0]", "lower"]),
        "a negative gap": (lambda: ctr.JointLimits(tip_gap=-1.0), ["tip_gap", "at least 0"]),
        "too few": (lambda: ik(robot, limits=ctr.JointLimits(rotations=[[-1, 1]])), ["1 rows", "3 tubes"]),
        "too far": (
            lambda: ik(robot, limits=ctr.JointLimits(translations=[[-0.5, 0.0], [-0.3, 0], [-0.1, 0]])),
            ["translations[0]", "-0.5", "0.463", "'inner'"],
        ),
        "contradictions": (lambda: ik(robot, limits=ctr.JointLimits(base_gap=1.0)), ["contradict", "base of tube 0"]),
    }


def test_wrong_input_is_reported(problem, shape):
    for name, (call, words) in wrong(problem, shape).items():
        with pytest.raises(ctr.DefinitionError) as caught:
            call()
        for word in words:
            assert word in str(caught.value), (name, str(caught.value))


def test_the_shortest_vector_within_inequalities():
    rng = np.random.default_rng(0)
    rows, most = rng.normal(size=(6, 4)), rng.normal(size=6)
    found = least_distance(rows, most)
    assert (most - rows @ found).min() > -1e-12  # rounding, of a vector of size 1
    multipliers, *_ = np.linalg.lstsq(rows[np.abs(most - rows @ found) < 1e-9].T, -found, rcond=None)
    assert multipliers.min() > 0.0  # Kuhn and Tucker: it is a sum of the active normals
    np.testing.assert_allclose(rows[np.abs(most - rows @ found) < 1e-9].T @ multipliers, -found, atol=1e-12)
    assert least_distance(np.array([[1.0], [-1.0]]), np.array([-1.0, -1.0])) is None


def test_steps_within_inequalities_are_minima():
    rng = np.random.default_rng(1)
    root, gradient, rows = rng.normal(size=(5, 5)), rng.normal(size=5), rng.normal(size=(4, 5))
    hessian, room = root @ root.T + np.eye(5), np.array([0.0, 0.01, 0.02, 1.0])
    step = bounded_step(hessian, gradient, rows, room)
    assert (room - rows @ step).min() > -1e-12
    for other in rng.normal(size=(200, 5)):
        other *= min(1.0, *(room[rows @ other > 0.0] / (rows @ other)[rows @ other > 0.0]), 1.0)
        along = other - step
        assert (hessian @ step + gradient) @ along > -1e-12  # no allowed direction leads down


def test_steps_keep_inequalities_where_the_hessian_is_nearly_singular():
    rng = np.random.default_rng(3)
    for _ in range(100):
        root, rows = rng.normal(size=(3, 6)), np.vstack((rng.normal(size=(4, 6)), np.eye(6), -np.eye(6)))
        room = np.concatenate((0.1 * rng.random(4), np.full(12, 0.5)))
        step = bounded_step(root.T @ root + 1e-8 * np.eye(6), 10.0 * root.T @ rng.normal(size=3), rows, room)
        assert (room - rows @ step).min() > -1e-15  # rounding, of steps below one


def test_rotation_vectors_are_those_of_rotations():
    rng = np.random.default_rng(4)
    for angle in (0.0, 1e-9, 1e-3, 1.0, 2.6, 2.7, np.pi - 1e-6, np.pi):
        for axis in rng.normal(size=(20, 3)):
            turned = rotation(angle * axis / np.linalg.norm(axis))
            target = Target(np.zeros(3), turned)
            (found,) = target.turns_from(np.eye(3)[None])
            vector = _turn_between(np.eye(3), turned)
            np.testing.assert_allclose(rotation(vector), turned, atol=1e-14)
            if angle < 3.0:
                np.testing.assert_allclose(found, vector, atol=1e-9)


def test_other_starts_keep_limits_of_rotations_by_full_turns():
    limits = ctr.JointLimits(rotations=[[0.0, 2.0 * np.pi]] * 3)
    allowed = Allowed.of(ctr.load_robot(ROBOT_B), limits)
    angles = np.random.default_rng(0).uniform(-10.0, 10.0, (50, 3))
    found = allowed.unwound(angles, np.zeros(3))
    assert found.min() >= 0.0
    assert found.max() <= 2.0 * np.pi
    np.testing.assert_allclose(np.cos(found - angles), 1.0, atol=1e-14)


def test_poses_that_snaps_and_limits_hide_from_home_are_reached():
    """Poses of robot A to which the nearest tips of random shapes do not lead."""
    bench = Bench.of("A", loaded=False)
    shapes = bench.shapes(295, seed=1)
    for k in (269, 294):
        assert bench.problem.solve(shapes[k].tip_pose).converged


def test_axes_that_point_away_can_be_turned_to(problem, shape):
    target = Target.of(shape.tip_position, -shape.tip_pose[:3, 2], None)
    _, angle = Point(shape, target).errors
    assert angle == pytest.approx(np.pi, abs=1e-7)  # the arc sine of rounding of 1e-16 over itself
    assert np.linalg.norm(target.misfit(shape)) == pytest.approx(np.pi, abs=1e-7)


def test_the_benchmark_runs(bench, shape):
    lines = list(table(5, ["B"]))
    assert len(lines) == 2 + 2 * 4
    assert all("100.00%" in line for line in lines[2:])
    seconds, reached = by_scipy(bench, shape.tip_position)
    assert seconds > 0.0
    assert reached in (True, False)


def test_it_works_where_nothing_can_be_compiled(monkeypatch):
    """Compilation that is switched off is no error unless it was asked for."""
    libraries.library.cache_clear()
    monkeypatch.setenv(SWITCH, "0")
    rod = ctr.Robot([ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)])
    start = ctr.ForwardProblem(rod).solve(ctr.Actuation([0.0], [-0.02]))
    problem = ctr.InverseKinematicsProblem(rod)
    goal = ctr.ForwardProblem(rod).solve(ctr.Actuation([0.1], [-0.021])).tip_position
    assert problem.solve(goal, initial=start).position_error < 1e-6
    assert not problem.forward.compiles
