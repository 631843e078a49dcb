"""Are the answers as accurate as they say, and the methods of the order they claim?"""

import attrs
import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.forward.record import SolvedRecord
from ctr_opt.layout.configuration import Configuration
from ctr_opt.solvers.newton import newton
from ctr_opt.transcription.shape import Shape
from ctr_opt.transcription.shooting import Shooting
from tests.support.physics import held, random_problem, robot, rod, tube
from tests.support.slow import some_slow

SAMPLES = 60


def sample(seed):
    rng = np.random.default_rng(1000 + seed)
    return random_problem(rng, 1 + seed % 4, load=1.5, pose=bool(seed % 2))


def largest_error(result, exact):
    """Along the whole backbone, between the nodes as well."""
    s = np.linspace(0.0, result.length, 41)
    return float(np.linalg.norm(result.position(s) - exact.position(s), axis=1).max())


# -- the estimated error -----------------------------------------------------------------------------------------------


def compare(tolerance, seeds):
    """Rows ``(length, estimate, error against a solve to 1e-11, verify())`` of solves to a tolerance."""
    rows = []
    for seed in seeds:
        made, actuation, loads = sample(seed)
        result = ctr.ForwardProblem(made, tolerance=tolerance).solve(actuation, loads)
        exact = ctr.ForwardProblem(made, tolerance=1e-11).solve(actuation, loads, result)
        rows.append((result.length, result.discretization_error, largest_error(result, exact), result.verify()))
    return np.array(rows).T


@pytest.mark.parametrize("part", some_slow(range(3), [1]))
def test_errors_are_as_estimated(part):
    """In each third of the sample: a bound in 95 of 100 cases, and exaggerated a hundredfold at most."""
    length, estimate, error, verified = compare(1e-7, range(part, SAMPLES, 3))
    floor = 1e-12 * length  # below, all are rounding
    for true in (error, verified):
        ratio = np.maximum(estimate, floor) / np.maximum(true, floor)
        assert np.mean(ratio >= 1.0) >= 0.95
        assert np.median(ratio) <= 100.0
    # And the tolerance is kept, which for robots up to half a metre means 1e-7 m.
    assert np.all(error <= 1e-7 * length)
    assert np.all(verified < 1e-7 * length)
    assert np.all(error[length <= 0.5] <= 1e-7)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
def test_a_loose_tolerance_is_kept_too(tolerance):
    length, estimate, error, verified = compare(tolerance, range(0, SAMPLES, 11))
    assert np.all(estimate <= tolerance * length)
    assert np.all(error <= tolerance * length)
    assert np.all(verified <= tolerance * length)


@pytest.mark.parametrize("integrator", ["RK4", "RK5"])
def test_other_integrators_keep_the_tolerance(integrator):
    for seed in (1, 6):
        made, actuation, loads = sample(seed)
        result = ctr.ForwardProblem(made, tolerance=1e-6, integrator=integrator).solve(actuation, loads)
        assert result.verify() <= result.discretization_error <= 1e-6 * result.length


def test_a_coarse_energy_solve_keeps_the_tolerance_between_its_nodes():
    made, actuation, loads = random_problem(np.random.default_rng(5), 3, moments=False)
    exact = ctr.ForwardProblem(made, tolerance=1e-9).solve(actuation, loads)
    for degree, tolerance in ((1, 1e-2), (2, 1e-3), (4, 1e-2)):
        transcription = ctr.Collocation(degree)
        problem = ctr.ForwardProblem(made, formulation="energy", tolerance=tolerance, transcription=transcription)
        result = problem.solve(actuation, loads)
        assert largest_error(result, exact) <= tolerance * result.length


# -- verify() ----------------------------------------------------------------------------------------------------------


def spoiled(result, nodes=None, base=None):
    shape = result.shape
    nodes = shape.nodes if nodes is None else nodes
    other = Shape(result.configuration, shape.mesh, nodes, shape.integrator)
    base = result.last_iterate if base is None else base
    return ctr.Equilibrium(attrs.evolve(result.record, base=base, shape=other))


@pytest.fixture(scope="module")
def solved():
    made, actuation, loads = sample(7)
    return ctr.ForwardProblem(made).solve(actuation, loads)


@pytest.mark.parametrize("size", [1e-6, 1e-4, 1e-2])
def test_verify_sees_a_moved_node(solved, size):
    moved = solved.shape.nodes.left.copy()
    moved[:3, -1] += [0.0, size, 0.0]
    wrong = spoiled(solved, attrs.evolve(solved.shape.nodes, left=moved))
    # Nodes are in units of the length; the shape itself is good to 1e-7.
    assert wrong.verify() == pytest.approx(size * solved.length, rel=0.2)


def test_verify_sees_a_shape_that_is_no_equilibrium(solved):
    """A smooth robot-like shape, integrated from the wrong base moments: every equation holds but the tip's."""
    scales = solved.configuration.scales
    shooting = Shooting(solved.configuration, solved.shape.mesh)
    z = solved.last_iterate.vector / scales.moment
    nodes, _ = shooting.sweep(z + 1e-3)
    moments = (z + 1e-3) * scales.moment
    wrong = spoiled(solved, nodes, ctr.BaseMoments(moments[:2], moments[2:]))
    error = largest_error(wrong, solved)
    assert error > 1e-5 * solved.length
    # One Newton step leads back but for its square: (1e-3)^2 against 1e-3.
    assert wrong.verify() == pytest.approx(error, rel=0.1)


def test_verify_sees_steps_too_long():
    """Spoil the discretization itself: three RK4 steps for a robot that turns by two radians."""
    made = robot(tube("a", ctr.Arc(0.2, [10.0, 0, 0])), tube("b", ctr.Arc(0.2, [9.0, 4.0, 3.0])))
    configuration = Configuration(made, ctr.Actuation([0.0, 1.5], [0.0, 0.0]))
    good = ctr.ForwardProblem(made).solve(configuration.actuation)
    edges = np.linspace(0.0, 0.2, 4)
    shooting = Shooting(configuration, np.column_stack((edges[:-1], edges[1:])), "RK4")
    solution = newton(shooting, good.last_iterate.vector / configuration.scales.moment, 1e-12)
    assert solution.converged
    nodes, _ = shooting.sweep(solution.z)
    moments = solution.z * configuration.scales.moment
    base, shape = ctr.BaseMoments(moments[:2], moments[2:]), Shape(configuration, shooting.mesh, nodes, "RK4")
    coarse = ctr.Equilibrium(SolvedRecord(configuration, base, good.record.outcome, shape))
    error = np.linalg.norm(coarse.tip_position - good.tip_position)
    assert error > 3e-5
    assert coarse.verify() == pytest.approx(error, rel=0.2)  # its Newton step uses the coarse Jacobian


# -- what tolerance buys -----------------------------------------------------------------------------------------------


def test_tighter_tolerances_give_smaller_errors():
    made, loads = rod(0.1, 0.02, 0.015, [8.0, 2.0, 3.0]), [ctr.PointWrench([8.0, 6.0, -4.0], [0.05, 0.0, 0.1])]
    exact = ctr.ForwardProblem(made, tolerance=1e-11).solve(held(), loads)
    for tolerance in (1e-2, 1e-4, 1e-6, 1e-8, 1e-10):
        result = ctr.ForwardProblem(made, tolerance=tolerance, integrator="RK5").solve(held(), loads, exact)
        assert largest_error(result, exact) <= tolerance * result.length
        assert result.discretization_error <= tolerance * result.length


def test_the_tightest_tolerance_allowed_can_be_met():
    """1e-11 is the least that ``ForwardProblem`` accepts, so an easy robot must reach it."""
    result = ctr.ForwardProblem(rod(0.1, 0.02, 0.015, [8.0, 0.0, 0.0]), tolerance=1e-11).solve(held())
    assert result.discretization_error <= 1e-11 * result.length


def test_verify_sees_a_step_that_begins_elsewhere(solved):
    """Positions inside a step are carried on from its beginning: a wrong state there spoils the shape as well."""
    moved = solved.shape.nodes.right.copy()
    moved[:3, 1:] += 1e-2
    wrong = spoiled(solved, attrs.evolve(solved.shape.nodes, right=moved))
    assert largest_error(wrong, solved) > 1e-3 * solved.length
    assert wrong.verify() > 1e-3 * solved.length
