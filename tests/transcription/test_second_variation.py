"""The count of unstable directions: against closed forms, the energy's Hessian, and one by differences."""

from collections import Counter

import attrs
import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

import ctr_opt as ctr
from ctr_opt.forward import ways
from ctr_opt.forward.record import BaseMoments, SolvedRecord
from ctr_opt.layout.configuration import Configuration
from ctr_opt.mechanics.state import stacked
from ctr_opt.solvers import homotopy
from ctr_opt.solvers.ipopt import IpoptPoint
from ctr_opt.solvers.minimum import Minimum
from ctr_opt.solvers.newton import newton
from ctr_opt.transcription.shooting import Shooting, cut
from ctr_opt.transcription.stability import MARGIN, count, second_variation
from tests.support.by_energy import MOST, energy_inertia, hessian_by_differences
from tests.support.physics import data, held, random_pose, random_problem, robot, rod, tube
from tests.support.slow import some_slow

L, EI, GJ = 0.1, 0.02, 0.015
EULER = np.pi**2 / 4 * EI / L**2
COLUMN = rod(L, EI, GJ)
POINT = IpoptPoint(np.zeros(1), np.zeros(1), 0.0, 0, False, "nothing", np.zeros(1))


def beside(made, actuation, loads=(), **guess):
    """The equilibrium next to a guess; straight tubes without moments are one."""
    problem = ctr.ForwardProblem(made)
    return problem.solve(actuation, loads, initial=problem.guess(actuation, loads, **guess), throw=False)


def threshold(unstable, low, high):
    """Where a straight robot becomes unstable, by bisection to rounding."""
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if unstable(middle) else (middle, high)
    return middle


# -- closed forms ------------------------------------------------------------------------------------------------------


def pressed(factor, pose=None):
    made = rod(L, EI, GJ, base_pose=pose)
    axis = np.array([0.0, 0.0, 1.0]) if pose is None else pose[:3, 2]
    return beside(made, held(), [ctr.PointWrench(-factor * EULER * axis)])


@pytest.mark.parametrize(
    ("factor", "passed"), [(0.9, 0), (1.1, 1), (8.9, 1), (9.1, 2), (24.0, 2), (26.0, 3), (400.0, 10)]
)
def test_a_column_gives_way_in_both_planes_for_each_critical_load_passed(factor, passed):
    """The critical loads are the odd squares times Euler's."""
    column = pressed(factor)
    np.testing.assert_allclose(column.tip_position, [0.0, 0.0, L], atol=1e-12)
    assert column.unstable_directions == 2 * passed
    assert column.is_stable is (passed == 0)
    assert pressed(factor, random_pose(np.random.default_rng(1))).unstable_directions == 2 * passed


def test_eulers_load_to_six_digits():
    assert threshold(lambda x: pressed(x).unstable_directions, 0.5, 2.0) == pytest.approx(1.0, abs=1e-6)


def test_greenhills_self_buckling_to_six_digits():
    critical = float(data("benchmarks.json")["greenhill_self_buckling"]["qL3_over_EI_critical"])

    def unstable(q):
        return beside(COLUMN, held(), [ctr.DistributedLoad([0.0, 0.0, -q * EI / L**3])]).unstable_directions

    assert threshold(unstable, 5.0, 11.0) == pytest.approx(critical, rel=1e-6)


def opposed(factor, behind=(0.0, 0.0)):
    """Two equal tubes turned against each other by pi; ``factor``: lambda over (pi/2)^2 / L^2."""
    kappa = np.sqrt(factor * (np.pi / 2 / L) ** 2 * GJ / EI)
    tubes = [
        tube(f"tube {i}", [*([ctr.Straight(b)] if b else []), ctr.Arc(L, [kappa, 0.0, 0.0])], EI, GJ)
        for i, b in enumerate(behind)
    ]
    return robot(*tubes), ctr.Actuation([0.0, np.pi], -np.array(behind))


@pytest.mark.parametrize(("factor", "negative"), [(0.95, 0), (1.05, 1), (5.0, 1), (12.0, 2), (30.0, 3)])
def test_opposed_tubes(factor, negative):
    """One direction more at the odd squares."""
    found = beside(*opposed(factor))
    assert found.unstable_directions == negative
    assert energy_inertia(found).negative == negative


@pytest.mark.parametrize("behind", [(0.0, 0.0), (0.05, 0.05), (0.1, 0.02), (0.0, 0.2)])
def test_opposed_tubes_with_transmissions_to_six_digits(behind):
    """``x tan x = L / l`` with ``x = L sqrt(lambda)`` and the mean length behind, as the stiffnesses are equal."""
    mean = sum(behind) / 2
    x = brentq(lambda x: x * np.sin(x) * mean - L * np.cos(x), 1e-3, np.pi / 2 + 1e-9, xtol=1e-15)
    found = threshold(lambda f: beside(*opposed(f, behind)).unstable_directions, 0.05, 2.0)
    assert found == pytest.approx((x / (np.pi / 2)) ** 2, rel=1e-6)


def test_a_spring_that_pushes_aside_overcomes_the_cantilever():
    """At the tip ``3 EI / L^3`` holds against ``-k``; a potential has its Hessian in the count."""

    push = ctr.PotentialLoad(lambda p: -0.5 * EI / L**3 * (p[0] ** 2 + 2.0 * p[1] ** 2))

    def unstable(k):
        return beside(COLUMN, held(), [push.times(k)]).unstable_directions

    assert threshold(unstable, 1.0, 2.0) == pytest.approx(1.5, rel=1e-6)  # in y, which is pushed twice as much
    assert [unstable(k) for k in (1.4, 2.0, 4.0, 1e6)] == [0, 1, 2, 2]


# -- other ways to see it ----------------------------------------------------------------------------------------------


def several(configuration, rng, tries=3):
    """The equilibria that Newton's method finds from random moments, be they stable or not."""
    shooting = Shooting(configuration, configuration.mesh())
    stiffness = configuration.stiffness.torsional_stiffness / configuration.scales.stiffness
    size = np.ones(shooting.unknowns)
    size[2 : 2 + len(stiffness)] = stiffness
    for _ in range(tries):
        solution = newton(shooting, size * rng.normal(size=len(size)) * rng.uniform(0.0, 5.0), 1e-9)
        if not solution.converged:
            continue
        base = BaseMoments.of(solution.z, configuration.scales, configuration.tube_count)
        start = ctr.Equilibrium(SolvedRecord.guess(configuration, base))
        problem = ctr.ForwardProblem(configuration.robot)
        found = problem.solve(configuration.actuation, configuration.loads, initial=start, throw=False)
        if found.converged:  # a few do not on finer steps
            yield found


def soft(seed, rng):
    """A seeded random robot of one to four tubes, soft in torsion, under dead forces."""
    n = 1 + seed % 4
    made, actuation, loads = random_problem(rng, n, moments=False, load=rng.choice([1, 5, 20]), functions=False)
    tubes = [attrs.evolve(t, torsional_stiffness=t.torsional_stiffness * rng.uniform(0.02, 0.3)) for t in made.tubes]
    return Configuration(robot(*tubes, base_pose=random_pose(rng)), actuation, loads)


@pytest.mark.parametrize("seeds", some_slow([range(0, 6), range(6, 12)], [range(6, 12)]))
def test_the_energys_reduced_hessian_agrees(seeds):
    counts = Counter()
    for seed in seeds:
        rng = np.random.default_rng(seed)
        for found in several(soft(seed, rng), rng):
            inertia = energy_inertia(found)
            assert min(found.unstable_directions, MOST) == inertia.negative, seed
            assert found.is_stable is (inertia.smallest > MARGIN)
            assert np.sign(found.determinant) == (-1) ** found.unstable_directions
            counts[found.unstable_directions] += 1
    assert len(counts) >= 3, counts


@pytest.mark.parametrize("seed", some_slow(range(2), [0]))
def test_live_potentials_agree_with_the_energy(seed):
    """Wells and hills along the robot and at a point."""
    rng, p = np.random.default_rng(seed), ca.SX.sym("p", 3)
    made = robot(*(tube(f"{i}", ctr.Arc(0.1 - 0.02 * i, 15.0 * rng.normal(size=3)), EI, GJ / 4) for i in range(2)))
    field = ca.Function("V", [p], [EI / L * ca.sin(ca.dot(ca.DM([50.0, 30.0, 10.0]), p))])
    loads = [ctr.PotentialLoad(field, arc_length=0.07), ctr.PotentialLoad(field, start=0.0, end=0.05, factor=1 / L)]
    actuation = ctr.Actuation(rng.uniform(-3.0, 3.0, 2), [0.0, 0.0])
    for strength in (-20.0, -5.0, 5.0, 20.0):
        for found in several(Configuration(made, actuation, [load.times(strength) for load in loads]), rng):
            inertia = energy_inertia(found)
            assert min(found.unstable_directions, MOST) == inertia.negative
            assert found.is_stable is (inertia.smallest > MARGIN)


def some_of_each():
    """Stable ones, saddles of one to six directions; robots of one and two tubes, some with transmissions."""
    yield pressed(26.0)
    yield beside(*opposed(12.0))
    yield beside(*opposed(2.0, behind=(0.1, 0.03)))
    rng = np.random.default_rng(1)
    yield from list(several(soft(1, rng), rng))[:1]


@pytest.mark.slow
def test_a_hessian_by_differences_agrees():
    """Energy, kinematics and basis are the test's own. They miss kinks at tube ends, but little of a saddle."""
    seen = set()
    for found in some_of_each():
        values, smallest = hessian_by_differences(found), energy_inertia(found).smallest
        assert np.abs(values).min() > 1e-3  # the differences are good to 1e-5
        assert found.unstable_directions == (values < 0.0).sum()
        assert values[0] > smallest - 0.02 * abs(smallest)  # of fewer directions, in coarser cells
        if smallest < 0.0:
            assert values[0] == pytest.approx(smallest, rel=0.02)
        seen.add(found.unstable_directions)
    assert seen >= {0, 1, 2, 6}


# -- what must not matter ----------------------------------------------------------------------------------------------


def recount(found, mesh, integrator="RK8"):
    """The count on another mesh, at the states of the shape."""
    shape = found.shape
    at = shape.at(mesh[:, 0])
    return second_variation(Shooting(shape.configuration, mesh, integrator), stacked(at.state) / shape.unit[:, None])


@pytest.mark.parametrize("seed", [2, 9])
def test_steps_do_not_matter(seed):
    """Sections whole or in twenty parts, whatever the integrator; a whole robot in one step is cut until it is safe."""
    rng = np.random.default_rng(seed)
    for found in several(soft(seed, rng), rng):
        sections = found.configuration.break_points
        coarse = np.column_stack((sections[:-1], sections[1:]))
        for mesh, integrator in ((coarse, "RK8"), (cut(coarse, np.full(len(coarse), 20)), "RK4")):
            assert recount(found, mesh, integrator).negative == found.unstable_directions


def test_a_step_that_hides_conjugate_points_is_cut():
    """A straight column under 400 times Euler's load, its whole length one step: ten points in either plane."""
    column = pressed(400.0)
    whole = np.array([[0.0, L]])
    _, doubtful = count(Shooting(column.configuration, whole), column.shape.nodes.right[:, :1])
    assert doubtful.all()
    assert recount(column, whole).negative == 20


def test_a_node_at_a_conjugate_point_does_no_harm():
    """Four times Euler's load, a node in the middle: the Jacobi fields from the tip vanish there, but for rounding."""
    for pose in (None, random_pose(np.random.default_rng(2))):
        column = pressed(4.0, pose)
        for parts in (2, 4, 8, 6):
            edges = np.linspace(0.0, L, parts + 1)
            assert recount(column, np.column_stack((edges[:-1], edges[1:]))).negative == 2


def test_linear_maps_of_short_steps_are_symplectic():
    """Which sign, which half of a correction: nothing else is symplectic to rounding, under bending, torsion, force."""
    rng = np.random.default_rng(22)
    configuration = soft(22, rng)
    for found in several(configuration, rng):
        mesh = cut(found.shape.mesh, np.full(len(found.shape.mesh), 16))
        states = stacked(found.shape.at(mesh[:, 0]).state) / found.shape.unit[:, None]
        variation, _ = count(Shooting(configuration, mesh), states, 0.0)
        assert variation.margin < 1e-13


def test_base_turn_and_idle_break_points_do_not_matter():
    """An unstable robot turned and moved, its arcs cut where a force of nothing pulls."""
    made, actuation = opposed(12.0, behind=(0.03, 0.01))
    idle = [ctr.PointWrench([0.0, 0.0, 0.0], arc_length=x) for x in (0.01, 0.05, 0.05 + 1e-9, 0.0999999)]
    split = [
        attrs.evolve(t, precurvature=[t.precurvature[0], *(ctr.Arc(L / 4, t.precurvature[1].curvature),) * 4])
        for t in made.tubes
    ]
    turned = robot(*split, base_pose=random_pose(np.random.default_rng(5)))
    found = [beside(made, actuation), beside(turned, actuation, idle)]
    assert [each.unstable_directions for each in found] == [2, 2]
    assert found[1].configuration.break_points.size > found[0].configuration.break_points.size + 5


def test_the_order_of_ends_and_a_tube_without_transmission():
    """The limit of a short transmission is none; which tube ends first says nothing but by the energy."""
    for ends in ((0.1, 0.06), (0.06, 0.1), (0.1, 0.0999999)):
        counts = []
        for behind in (0.0, 1e-9, 1e-5):
            tubes = [tube(f"{i}", [ctr.Straight(1e-9 + behind), ctr.Arc(e, 60.0)], EI, GJ) for i, e in enumerate(ends)]
            found = beside(robot(*tubes), ctr.Actuation([0.0, np.pi], [-1e-9 - behind] * 2))
            counts.append(found.unstable_directions)
            assert energy_inertia(found).negative == counts[-1]
        assert len(set(counts)) == 1
        assert counts[0] >= 1


# -- neutral -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", [1e-3, 1e-7, 1e-10])
@pytest.mark.parametrize("factor", [1.02, 1.5, 5.0])
def test_a_buckled_column_is_neutral(factor, tolerance):
    """It may lie in any plane. The tolerance of the shape does not matter."""
    pose = random_pose(np.random.default_rng(7))
    load = [ctr.PointWrench(-factor * EULER * pose[:3, 2])]
    shape = ctr.ForwardProblem(rod(L, EI, GJ, base_pose=pose), tolerance=tolerance).solve(held(), load)
    assert shape.unstable_directions == 0
    assert shape.is_stable is False
    assert "neutral" in shape.report()
    assert shape.shape.second_variation.margin <= 1e-6  # of a shape that is known to 1e-3, too


def test_the_margin_is_that_of_the_energy():
    """Of a column just below Euler's load the smallest eigenvalue is what is missing of the load."""
    column = pressed(1.0 - 3e-6)
    shooting, states = Shooting(column.configuration, column.shape.mesh), column.shape.nodes.right
    assert [count(shooting, states, least)[0].positive for least in (2.9e-6, 3.1e-6)] == [True, False]
    assert energy_inertia(column).smallest == pytest.approx(3e-6, rel=1e-3)


# -- what a solve does about it ----------------------------------------------------------------------------------------


def blind(monkeypatch):
    """Homotopy that does not see what it passes: it keeps to the straight pair beyond its threshold."""
    monkeypatch.setattr(homotopy, "regular_between", lambda *_: True)


def test_a_cold_solve_leaves_an_unstable_answer(monkeypatch):
    blind(monkeypatch)
    made, actuation = opposed(2.0)
    found = ctr.ForwardProblem(made).solve(actuation)
    assert found.is_stable
    assert found.path == "homotopy (unstable: 1 direction) -> energy (1 saddle left) -> newton"
    reported = ctr.ForwardProblem(made, formulation="equilibrium").solve(actuation)
    assert reported.path == "homotopy"
    assert reported.is_stable is False
    assert reported.unstable_directions == 1
    assert "no: 1 direction in which the potential energy falls" in reported.report()


def test_a_cold_solve_that_finds_unstable_ones_alone_fails(monkeypatch):
    blind(monkeypatch)
    monkeypatch.setattr("ctr_opt.forward.optimized.minimize", lambda *_: Minimum(None, None, 0, 0))
    monkeypatch.setattr("ctr_opt.forward.optimized.minimize_in_steps", lambda *_: Minimum(POINT, None, 0, 0))
    monkeypatch.setattr(ways, "COLD", [way for way in ways.COLD if "around" not in way.name])  # they find a stable one
    made, actuation = opposed(12.0)
    failed = ctr.ForwardProblem(made).solve(actuation, throw=False)
    assert failed.status is ctr.SolveStatus.UNSTABLE
    assert "homotopy (unstable: 2 directions) -> energy" in failed.path
    assert failed.message.startswith("no stable equilibrium found")
    assert failed.is_stable is None
    assert failed.last_equilibrium.unstable_directions == 2
    assert failed.last_equilibrium.verify() < 1e-7 * L


def test_an_initial_equilibrium_is_followed_where_it_is_unstable():
    made, actuation = opposed(2.0)
    problem = ctr.ForwardProblem(made)
    saddle = problem.solve(actuation, initial=problem.guess(actuation))
    followed = problem.solve(actuation, [ctr.PointWrench([1e-3, 0.0, 0.0])], initial=saddle)
    assert followed.unstable_directions == 1
    assert "energy" not in followed.path
