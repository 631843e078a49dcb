"""Compiled solves against the virtual machine, which shares the equations but neither the packing nor the driver."""

import os
import pickle
import threading
from pathlib import Path

import attrs
import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.forward.compiled import CompiledRecord
from ctr_opt.layout.configuration import Configuration
from ctr_opt.mechanics.kind import DEAD
from ctr_opt.native.compile import compiler
from ctr_opt.native.generate import library_source, origin
from ctr_opt.transcription.shooting import Shooting
from tests.support.physics import held, random_problem, random_robot, rod, tube
from tests.support.physics import robot as robot_of
from tests.support.slow import some_slow

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")


def both(robot, **options):
    return (ctr.ForwardProblem(robot, compiled=flag, **options) for flag in (True, False))


def constant(loads):
    """Loads that the compiled solver knows: no tables."""
    return [x for x in loads if not (isinstance(x, ctr.DistributedLoad) and not isinstance(x.force, np.ndarray))]


def opposed():
    """Two equal tubes, to be turned against each other beyond the threshold: straight is a saddle then."""
    kappa = np.sqrt(2.0 * (np.pi / 2 / 0.1) ** 2 * 0.015 / 0.02)
    return robot_of(tube("inner", ctr.Arc(0.1, kappa)), tube("outer", ctr.Arc(0.1, kappa)))


def by_compiled_code(result):
    return isinstance(result.record, CompiledRecord)


def random_case(rng, n, **options):
    robot, actuation, loads = random_problem(rng, n, pose=True, functions=False, **options)
    return robot, actuation, constant(loads)


@pytest.mark.parametrize("tubes", some_slow([1, 2, 3, 4], [1, 2, 3]))
def test_cold_answers_are_those_of_the_virtual_machine(tubes):
    """The answers differ by what 1e-9 of the length, and 1e-10 in the tip conditions, moves the shape."""
    rng = np.random.default_rng(100 + tubes)
    used = 0
    for _ in range(6):
        robot, actuation, loads = random_case(rng, tubes)
        compiled, machine = both(robot, tolerance=1e-9)
        a, b = compiled.solve(actuation, loads), machine.solve(actuation, loads)
        used += by_compiled_code(a)
        np.testing.assert_allclose(a.tip_pose, b.tip_pose, atol=1e-8)
        assert a.discretization_error < 1e-9 * a.length
        if np.array_equal(a.shape.mesh.shape, b.shape.mesh.shape) and np.allclose(
            a.shape.mesh, b.shape.mesh, atol=1e-12
        ):
            expected = pytest.approx(b.discretization_error, rel=0.2, abs=1e-10 * a.length)
            assert a.discretization_error == expected
        assert a.residual_norm < 1e-10
        assert a.determinant == pytest.approx(b.determinant, rel=1e-5)  # of meshes that may differ
        assert a.verify() < 1e-9 * a.length
        assert (a.unstable_directions, a.is_stable) == (b.unstable_directions, b.is_stable)
    assert used >= 4  # the others meet folds on the way


@pytest.mark.parametrize("tubes", some_slow([1, 2, 3, 4], [1, 2, 3]))
def test_meshes_are_those_of_the_virtual_machine(tubes):
    rng = np.random.default_rng(200 + tubes)
    for _ in range(10):
        robot, actuation, loads = random_case(rng, tubes)
        result = ctr.ForwardProblem(robot, compiled=True, tolerance=1e-2).solve(actuation, loads, throw=False)
        if by_compiled_code(result):
            mesh = Configuration(robot, actuation, loads).mesh()
            np.testing.assert_allclose(result.shape.mesh, mesh, atol=1e-14)  # rounding of sums of lengths below 1 m


def test_states_along_the_backbone_are_those_of_the_virtual_machine():
    """One sweep from the same unknowns: only the order of additions differs."""
    rng = np.random.default_rng(5)
    for tubes in (1, 2, 3, 4):
        robot, actuation, loads = random_case(rng, tubes)
        result = ctr.ForwardProblem(robot, compiled=True).solve(actuation, loads, throw=False)
        if not by_compiled_code(result):
            continue
        shooting = Shooting(result.configuration, result.shape.mesh)
        z = result.last_iterate.unknowns(result.configuration.scales, result.configuration.kind.live)
        nodes, _ = shooting.sweep(z)
        np.testing.assert_allclose(result.shape.nodes.right, nodes.right, atol=1e-10)
        np.testing.assert_allclose(result.shape.nodes.left, nodes.left, atol=1e-10)


@pytest.mark.parametrize("tubes", some_slow([1, 3], [1]))
def test_body_loads_and_weights(tubes):
    rng = np.random.default_rng(300 + tubes)
    robot = random_robot(rng, tubes)
    heavy = robot_of(*[attrs.evolve(each, density=6450.0) for each in robot.tubes])
    actuation = ctr.Actuation(rng.uniform(-2, 2, tubes), [-0.4 * t.length for t in robot.tubes])
    follower = [ctr.PointWrench([0.05, 0.02, -0.01], [0.0, 1e-3, 2e-3], frame="body"),
                ctr.DistributedLoad([0.1, 0.0, 0.0], [0.0, 0.0, 1e-3], frame="body", start=0.002)]  # fmt: skip
    weights = [ctr.Gravity([3.0, 0.0, -9.0]), ctr.PointMass(2e-3, 0.01), ctr.DistributedMass(0.05, 0.003)]
    for loads in (follower, weights, [*follower, *weights]):
        compiled, machine = both(heavy)
        a, b = compiled.solve(actuation, loads), machine.solve(actuation, loads)
        assert by_compiled_code(a)
        np.testing.assert_allclose(a.tip_pose, b.tip_pose, atol=1e-9)
        near = ctr.Actuation(actuation.rotations + 0.02, actuation.translations - 2e-4)
        c, d = compiled.solve(near, loads, initial=a), machine.solve(near, loads, initial=b)
        assert by_compiled_code(c)
        np.testing.assert_allclose(c.tip_pose, d.tip_pose, atol=1e-8)


def test_a_warm_solve_continues_the_branch():
    """Along two circles of an actuation at which tubes snap, each step from the one before, both ways agree."""
    given = ctr.load_problem("problems/three_tubes/a4.toml")
    compiled, machine = both(given.robot, tolerance=1e-9)
    a, b = compiled.solve(given.actuation), machine.solve(given.actuation)
    for angle in np.linspace(0.0, 1.0, 60):
        actuation = ctr.Actuation(given.actuation.rotations + np.array([0.0, angle, 0.0]), given.actuation.translations)
        a = compiled.solve(actuation, initial=a, throw=False)
        b = machine.solve(actuation, initial=b, throw=False)
        assert a.status is b.status
        if not a.converged:
            break
        np.testing.assert_allclose(a.tip_pose, b.tip_pose, atol=1e-9)


def test_what_the_compiled_solver_does_not_know_is_solved_as_before():
    made = rod(curvature=[4.0, 0.0, 0.0])
    compiled, machine = both(made)
    table = ctr.DistributedLoad(force=([0.0, 0.05, 0.1], [[0.0, 0, 0], [1.0, 0, 0], [0.0, 0, 0]]))
    wall = ctr.PotentialLoad(lambda p: 50.0 * p[0] ** 2)
    for load in (table, wall, ctr.DistributedLoad(force=lambda s: [s, 0.0, 0.0])):
        a, b = compiled.solve(held(), [load]), machine.solve(held(), [load])
        assert not by_compiled_code(a)
        np.testing.assert_array_equal(a.tip_position, b.tip_position)


def test_other_methods_are_never_compiled():
    for options in ({"formulation": "energy"}, {"integrator": "RK4"}, {"method": "newton"}):
        assert not by_compiled_code(ctr.ForwardProblem(rod(), compiled=True, **options).solve(held()))


def test_errors_are_the_same():
    compiled, machine = both(rod(0.1))
    cases = [
        (ctr.Actuation([0.0], [-0.1]), []),
        (held(), [ctr.PointWrench([1.0, 0, 0], arc_length=0.11)]),
        (held(), [ctr.DistributedLoad([1.0, 0, 0], start=0.05, end=0.12)]),
        (held(), [ctr.PointWrench([1.0, 0, 0], tube=1)]),
        (held(), [ctr.PointWrench([1.0, 0, 0], tube=2**40)]),  # no int of C
        (held(), [ctr.DistributedLoad([1.0, 0, 0], tube=2**31)]),
        (ctr.Actuation([0.0, 0.0], [0.0, 0.0]), []),
        (held(), ["a load"]),
        ("actuation", []),
    ]
    for actuation, loads in cases:
        messages = []
        for problem in (compiled, machine):
            with pytest.raises(ctr.DefinitionError) as reported:
                problem.solve(actuation, loads)
            messages.append(str(reported.value))
        assert messages[0] == messages[1]
    with pytest.raises(ctr.DefinitionError, match="compiled = 1 must be True or False"):
        ctr.ForwardProblem(rod(), compiled=1)


def test_an_unstable_branch_is_left_by_cold_solves_and_kept_by_warm_ones():
    """Two equal tubes turned against each other beyond the threshold: straight is a saddle."""
    made = opposed()
    actuation = ctr.Actuation([0.0, np.pi], [0.0, 0.0])
    compiled = ctr.ForwardProblem(made, compiled=True)
    cold = compiled.solve(actuation)
    assert cold.is_stable
    saddle = compiled.solve(actuation, initial=compiled.guess(actuation))
    nearby = compiled.solve(ctr.Actuation([0.001, np.pi + 0.001], [0.0, 0.0]), initial=saddle)
    assert by_compiled_code(nearby)
    assert (nearby.unstable_directions, nearby.is_stable) == (1, False)


def test_many_rows_are_as_many_solves():
    given = ctr.load_problem("problems/three_tubes/a1.toml")
    problem = ctr.ForwardProblem(given.robot, compiled=True)
    rng = np.random.default_rng(8)
    rotations = given.actuation.rotations + np.cumsum(rng.normal(size=(40, 3)) * 0.02, axis=0)
    translations = np.minimum(given.actuation.translations + np.cumsum(rng.normal(size=(40, 3)) * 2e-4, axis=0), 0.0)
    loads = [ctr.PointWrench(rng.normal(size=3) * 0.01, rng.normal(size=3) * 1e-4) for _ in range(40)]
    batch = problem.solve_many((rotations, translations), [[load] for load in loads])
    assert len(batch) == 40
    assert batch.converged.all()
    assert all(by_compiled_code(result) for result in batch)
    for k in (0, 7, 39):
        alone = problem.solve(ctr.Actuation(rotations[k], translations[k]), [loads[k]])
        np.testing.assert_allclose(batch.tip_pose[k], alone.tip_pose, atol=1e-9)
        np.testing.assert_array_equal(batch[k].actuation.rotations, rotations[k])
        assert batch[k].loads == (loads[k],)
    objects = [ctr.Actuation(a, b) for a, b in zip(rotations, translations, strict=True)]
    same = problem.solve_many(objects, [loads[0]], chained=False)
    assert {result.path for result in same} == {"homotopy"}
    machine = ctr.ForwardProblem(given.robot, compiled=False).solve_many(objects[:3], [loads[0]])
    np.testing.assert_allclose(same.tip_position[:3], machine.tip_position, atol=1e-9)


def test_rows_lie_in_memory_as_they_like():
    given = ctr.load_problem("problems/three_tubes/a1.toml")
    problem = ctr.ForwardProblem(given.robot, compiled=True)
    rotations = given.actuation.rotations + 0.1 * np.random.default_rng(9).normal(size=(5, 3))
    translations = np.tile(given.actuation.translations, (5, 1))
    across = problem.solve_many((np.asfortranarray(rotations), np.asfortranarray(translations)), chained=False)
    along = problem.solve_many((rotations, translations), chained=False)
    assert all(by_compiled_code(result) for result in across)
    np.testing.assert_array_equal(across.tip_pose, along.tip_pose)


@pytest.mark.parametrize("chained", [True, False])
def test_rows_start_from_any_initial_as_single_solves_do(chained):
    """A guess keeps rows on the saddle; from nothing they would leave it."""
    problem = ctr.ForwardProblem(opposed(), compiled=True)
    guess = problem.guess(ctr.Actuation([0.0, np.pi], [0.0, 0.0]))
    rows = (np.array([[0.0, np.pi + 0.001], [0.0, np.pi + 0.002]]), np.zeros((2, 2)))
    batch = problem.solve_many(rows, initial=guess, chained=chained)
    assert [result.unstable_directions for result in batch] == [1, 1]


def test_rows_far_apart_are_continued_as_single_solves_are():
    """Steps too large for Newton's method, so that continuation is needed, and cold starts where that fails."""
    given = ctr.load_problem("problems/three_tubes/a1.toml")
    rng = np.random.default_rng(3)
    rotations = given.actuation.rotations + rng.uniform(-3.0, 3.0, (8, 3))
    factors = 1.0 + 0.3 * rng.normal(size=(8, 3))
    translations = np.minimum(given.actuation.translations * factors, 0.0)
    a, b = (each.solve_many((rotations, translations)) for each in both(given.robot))
    assert a.converged.all()
    np.testing.assert_allclose(a.tip_pose, b.tip_pose, rtol=0.0, atol=2e-8)  # solves are good to 1e-7 of 0.2 m
    assert any("continuation from initial" in result.path for result in a)


def test_a_step_over_a_fold_is_not_taken():
    """Two tubes turned far at once: Newton's method ends on another branch, where continuation meets a fold."""
    rng = np.random.default_rng(5426)
    tubes, load = int(rng.integers(1, 4)), rng.choice([0.0, 1.0, 5.0])
    robot, actuation, loads = random_case(rng, tubes, load=load)
    compiled, machine = both(robot, tolerance=1e-10)
    result = compiled.solve(actuation, loads)
    for _ in range(3):
        step = 10.0 ** rng.uniform(-2.0, 0.3)
        rotations = actuation.rotations + step * rng.normal(size=tubes)
        translations = np.minimum(actuation.translations * (1.0 + 0.2 * step * rng.normal(size=tubes)), 0.0)
        near = ctr.Actuation(rotations, translations)
        pushed = loads if rng.random() < 0.7 else [load.times(1.0 + step * rng.normal()) for load in loads]
        try:
            compiled.check(near, pushed)
        except ctr.DefinitionError:  # a load beyond its tube
            continue
        actuation, loads = near, pushed
        before, result = result, compiled.solve(actuation, loads, initial=result, throw=False)
    assert before.converged
    assert result.status is machine.solve(actuation, loads, initial=before, throw=False).status is ctr.SolveStatus.FOLD


def test_errors_of_soft_tubes_count():
    """An inner tube 1e8 times softer than the outer: what the tip conditions leave may still turn it visibly."""
    inner = tube("inner", [ctr.Straight(0.1), ctr.Arc(0.1, 10.0)], EI=2e-10, GJ=1.5e-10)
    made = robot_of(inner, tube("outer", ctr.Arc(0.1, 10.0)))
    rng = np.random.default_rng(1)
    problem = ctr.ForwardProblem(made, compiled=True)
    for _ in range(5):
        actuation = ctr.Actuation(rng.uniform(-3.0, 3.0, 2), [-0.03, -0.01])
        result = problem.solve(actuation)
        assert result.discretization_error < 1e-7 * result.length
        assert result.verify() < 1e-7 * result.length


def test_positions_that_rounding_spoils_are_refused():
    """A robot of 1e-13 m a metre away from the origin: a position's last digit is 2e-3 of its length."""
    pose = np.eye(4)
    pose[:3, 3] = [0.6, 1.1, 0.4]
    made = rod(1e-13, EI=1e-10, GJ=1e-11, curvature=[1e13, 0.0, 0.0], base_pose=pose)
    load = ctr.PointWrench(arc_length=2e-14)
    result = ctr.ForwardProblem(made, compiled=True).solve(held(), [load], throw=False)
    assert not by_compiled_code(result)


def test_angles_of_many_turns():
    """An angle of 1e5 turns has an uncertain digit of 1e-10 rad; larger ones are left to the other way."""
    given = ctr.load_problem("problems/three_tubes/a1.toml")
    for turns, compiled in ((1e5, True), (1e6, False)):
        rotations = given.actuation.rotations + 2.0 * np.pi * turns * np.array([1.0, 0.0, 0.0])
        a, b = (each.solve(ctr.Actuation(rotations, given.actuation.translations)) for each in both(given.robot))
        assert by_compiled_code(a) is compiled
        np.testing.assert_allclose(a.tip_position, b.tip_position, atol=1e-9)


@pytest.mark.parametrize("compiled", [True, False])
def test_failed_rows_are_marked_and_stop_nothing(compiled):
    """Opposed tubes beyond their threshold, by homotopy alone, which ends at the bifurcation."""
    problem = ctr.ForwardProblem(opposed(), formulation="equilibrium", compiled=compiled)
    rotations = np.array([[0.0, 0.5], [0.0, np.pi], [0.0, 0.7]])
    batch = problem.solve_many((rotations, np.zeros((3, 2))), chained=False)
    assert batch.converged.tolist() == [True, False, True]
    assert np.isnan(batch.tip_position[1]).all()
    assert np.isfinite(batch.tip_pose[[0, 2]]).all()
    assert "bifurcation" in batch[1].message
    assert repr(batch) == "<Batch of 3 equilibria, 1 failed, 0 snapped>"
    with pytest.raises(ctr.SolveError):
        _ = batch[1].tip_position


def test_wrong_rows_are_reported():
    problem = ctr.ForwardProblem(rod(), compiled=False)
    cases = {
        "rotations has shape": (np.zeros((3, 2)), np.zeros((3, 1))),
        "rotations has 3 rows, but translations has 2": (np.zeros((3, 1)), np.zeros((2, 1))),
        r"translations\[1, 0\] = 0.1 m": (np.zeros((2, 1)), np.array([[0.0], [0.1]])),
        r"actuations\[1\]": [held(), "there"],
    }
    for message, rows in cases.items():
        with pytest.raises(ctr.DefinitionError, match=message):
            problem.solve_many(rows)
    load = ctr.PointWrench([0.01, 0, 0])
    with pytest.raises(ctr.DefinitionError, match="loads has 3 entries, but there are 2 actuations"):
        problem.solve_many([held(), held()], [[load], [load], [load]])
    with pytest.raises(ctr.DefinitionError, match=r"loads\[1\] must be a list of loads"):
        problem.solve_many([held(), held()], [[load], load])


def test_results_outlive_the_problem_and_travel():
    given = ctr.load_problem("problems/three_tubes/a1.toml")
    problem = ctr.ForwardProblem(given.robot, compiled=True)
    result = problem.solve(given.actuation)
    copy = pickle.loads(pickle.dumps(result))
    np.testing.assert_array_equal(copy.tip_pose, result.tip_pose)
    assert copy.is_stable is result.is_stable is True
    again = pickle.loads(pickle.dumps(problem)).solve(given.actuation, initial=copy)
    assert by_compiled_code(again)
    np.testing.assert_allclose(again.tip_pose, result.tip_pose, atol=1e-9)
    tip = result.tip_position.copy()
    del problem, again, copy
    np.testing.assert_array_equal(result.position(result.length), tip)


def test_threads_do_not_disturb_each_other():
    given = ctr.load_problem("problems/three_tubes/a1.toml")
    problem = ctr.ForwardProblem(given.robot, compiled=True)
    first = problem.solve(given.actuation)
    actuations = [ctr.Actuation(given.actuation.rotations + 0.003 * k, given.actuation.translations) for k in range(40)]
    alone = [problem.solve(a, initial=first).tip_position for a in actuations]
    found = {}

    def work(which):
        found[which] = [problem.solve(actuations[k], initial=first).tip_position for k in which for _ in range(20)]

    parts = [tuple(range(k, 40, 4)) for k in range(4)]
    threads = [threading.Thread(target=work, args=(part,)) for part in parts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for part in parts:
        np.testing.assert_array_equal(found[part], [alone[k] for k in part for _ in range(20)])


def test_threads_that_end_leave_no_memory():
    """Before, each left 26 kB."""
    given = ctr.load_problem("problems/three_tubes/a1.toml")
    problem = ctr.ForwardProblem(given.robot, compiled=True)
    first = problem.solve(given.actuation)

    def after(count):
        for _ in range(count):
            thread = threading.Thread(target=problem.solve, args=(given.actuation, (), first))
            thread.start()
            thread.join()
        statm = Path("/proc/self/statm")  # of Linux
        return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if statm.exists() else 0

    assert after(300) + 3e6 > after(300)


def test_many_steps_and_loads_find_room():
    """A hundred point loads make a hundred steps: more than a result has room for at first."""
    made = rod(0.2, curvature=[3.0, 0.0, 0.0])
    loads = [ctr.PointWrench([1e-3, -5e-4, 0.0], [0.0, 0.0, 1e-5], s) for s in np.linspace(0.001, 0.2, 100)]
    compiled, machine = both(made)
    a, b = compiled.solve(held(), loads), machine.solve(held(), loads)
    assert by_compiled_code(a)
    np.testing.assert_allclose(a.tip_pose, b.tip_pose, atol=1e-9)
    assert compiled.solve_many([held()] * 3, loads).converged.all()


def test_the_source_is_standard_c_and_told_by_its_origin():
    assert origin(3, DEAD) != origin(2, DEAD)
    source = library_source(2, DEAD)
    assert source == library_source(2, DEAD)
    assert "casadi_int" not in source  # nothing of CasADi's runtime is needed
