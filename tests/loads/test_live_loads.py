"""Loads that depend on the shape: in a tube's frame, by a potential, by an expression."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import ctr_opt as ctr
from tests.support.physics import gauss, held, random_problem, random_robot, robot, rod, tube

EI, GJ, L = 0.02, 0.015, 0.1
XY, XYZ = ca.SX.sym("p", 2), ca.SX.sym("p", 3)


def solve(made, actuation, loads, **options):
    return ctr.ForwardProblem(made, **{"tolerance": 1e-9, **options}).solve(actuation, loads)


# -- loads in a tube's frame: an answer without any boundary-value problem ---------------------------------------------


def from_the_tip(tubes, angles, force, moment, density, couple, length):
    """Tubes of constant precurvature and of one length, loaded in the frame of tube 0, integrated from tip to base.

    ``tubes``: ``(EI, GJ, u*)``; the state is seen in the frame of tube 0 and starts at the tip with tube ``i`` turned
    by ``angles[i]`` against it. Returns the angles at the base, the tip position seen from a base frame that is the
    backbone's (tube 0 turned back), in which no angle of tube 0 is free: its rotation is 0.
    """
    theta = np.array(angles, dtype=float)
    start = np.concatenate((np.zeros(3), np.eye(3).ravel(), theta, np.zeros(len(tubes)), force, moment))
    n = len(tubes)

    def rates(_, x):
        R, turns, torques, N, M = x[3:12].reshape(3, 3), x[12 : 12 + n], x[12 + n : 12 + 2 * n], x[-6:-3], x[-3:]
        own = torques.copy()
        own[0] = M[2] - torques[1:].sum()
        # curvature in the frame of tube 0 from the sum of the tubes' moments
        preset = sum(
            k * Rotation.from_rotvec([0, 0, a]).apply(u)[:2] for (k, _, u), a in zip(tubes, turns, strict=True)
        )
        uxy = (M[:2] + preset) / sum(k for k, _, _ in tubes)
        twists = np.array([u[2] + t / g for (_, g, u), t in zip(tubes, own, strict=True)])
        w = np.array([*uxy, twists[0]])
        hat = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        torque_rates = np.zeros(n)
        for i, ((k, _, u), a) in enumerate(zip(tubes, turns, strict=True)):
            seen = Rotation.from_rotvec([0, 0, -a]).apply([*uxy, 0.0])
            torque_rates[i] = -k * (seen[0] * (seen[1] - u[1]) - seen[1] * (seen[0] - u[0]))
        dN = -np.cross(w, N) - density
        dM = -np.cross(w, M) - np.cross([0, 0, 1.0], N) - couple
        return np.concatenate((R[:, 2], (R @ hat).ravel(), twists - twists[0], torque_rates, dN, dM))

    x = solve_ivp(rates, (length, 0.0), start, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    base, position = x[3:12].reshape(3, 3), x[:3]
    return x[12 : 12 + n], base.T @ -position, base.T


@pytest.mark.parametrize("seed", range(4))
def test_follower_loads_against_integration_from_the_tip(seed):
    rng = np.random.default_rng(seed)
    n = 1 + seed % 3
    tubes = [(0.02 * (i + 1), 0.015 * (i + 1), rng.normal(size=3) * [6.0, 6.0, 2.0]) for i in range(n)]
    size = EI / L**2
    force, moment = rng.normal(size=3) * size, rng.normal(size=3) * 0.3 * size * L
    density, couple = rng.normal(size=3) * size / L, rng.normal(size=3) * 0.3 * size
    tip_angles = np.concatenate(([0.0], rng.uniform(-1.0, 1.0, n - 1)))
    base_angles, tip, tip_frame = from_the_tip(tubes, tip_angles, force, moment, density, couple, L)
    made = robot(*(tube(f"t{i}", ctr.Arc(L, u), k, g) for i, (k, g, u) in enumerate(tubes)))
    loads = [
        ctr.PointWrench(force, moment, frame="body"),
        ctr.DistributedLoad(density, couple, frame="body"),
    ]
    problem = ctr.ForwardProblem(made, tolerance=1e-9)
    actuation = ctr.Actuation(base_angles, np.zeros(n))
    result = problem.solve(actuation, loads)
    if np.linalg.norm(result.tip_position - tip) > 1e-6:  # another branch: start beside the one constructed
        pytest.fail(f"{result.path}: {result.tip_position} instead of {tip}")
    # SciPy's and our tolerance, 1e-9 of the length and less
    np.testing.assert_allclose(result.tip_position, tip, atol=2e-9 * L)
    np.testing.assert_allclose(result.tip_pose[:3, :3], tip_frame, atol=1e-8)
    assert result.verify() < 2e-9 * L
    angles = [result.tube_angle(i, L) - result.tube_angle(0, L) for i in range(n)]
    np.testing.assert_allclose(angles, tip_angles, atol=1e-8)


def test_a_follower_moment_of_a_table_on_an_outer_tube_balances():
    """The internal moment at the base is that of all loads about it (paper, (13) and (14))."""
    made = random_robot(np.random.default_rng(5), 2)
    actuation = ctr.Actuation([0.3, 1.1], [-0.1, -0.03])
    end = actuation.translations[1] + made.tubes[1].length
    s = np.linspace(0.01, end, 4)
    rows = np.random.default_rng(6).normal(size=(4, 3))
    load = ctr.DistributedLoad((s, rows), (s, 0.02 * rows[::-1]), start=0.01, tube=1, frame="body")
    point = ctr.PointWrench([0.2, 0.1, -0.1], [0.01, 0.0, 0.004], arc_length=0.5 * end, tube=1, frame="body")
    result = solve(made, actuation, [load, point])

    def frame(x):
        return result.pose(x, tube=1)[:3, :3]

    def force(x):
        return frame(x) @ [np.interp(x, s, column) for column in rows.T]

    def couple(x):
        return frame(x) @ [np.interp(x, s, column) for column in 0.02 * rows[::-1].T]

    def about_base(x):
        return couple(x) + np.cross(result.position(x), force(x))

    cuts = [*s, *result.configuration.break_points]
    F, M = frame(0.5 * end) @ point.force, frame(0.5 * end) @ point.moment
    total = gauss(force, 0.01, end, cuts) + F
    moment = gauss(about_base, 0.01, end, cuts) + M + np.cross(result.position(0.5 * end), F)
    np.testing.assert_allclose(result.internal_force(0.0), total, atol=1e-8)
    np.testing.assert_allclose(result.internal_moment(0.0), moment, atol=1e-8 * L)


def test_a_tangential_follower_force_leaves_a_straight_rod_straight():
    """Beck's column has no other equilibrium, whatever the force."""
    result = solve(rod(), held(), [ctr.PointWrench([0, 0, -8.0 * EI / L**2], frame="body")])
    np.testing.assert_allclose(result.tip_position, [0, 0, L], atol=1e-12)


def test_a_body_load_on_a_tube_turns_with_its_base():
    made, loads = rod(), [ctr.PointWrench([0.5, 0.0, 0.0], frame="body")]
    still = solve(made, held(), loads)
    turned = solve(made, ctr.Actuation([np.pi / 2], [0.0]), loads)
    expected = Rotation.from_rotvec([0, 0, np.pi / 2]).apply(still.tip_position)
    np.testing.assert_allclose(turned.tip_position, expected, atol=1e-10)


# -- potentials --------------------------------------------------------------------------------------------------------


def test_a_constant_gradient_is_a_dead_force():
    F = [0.3, -0.2, 0.1]
    made = rod(curvature=[8.0, 0.0, 0.0])
    dead = solve(made, held(), [ctr.PointWrench(F, arc_length=0.06)])
    live = solve(made, held(), [ctr.PotentialLoad(lambda p: -ca.dot(ca.DM(F), p), arc_length=0.06)])
    np.testing.assert_allclose(live.position(live.arc_length), dead.position(live.arc_length), atol=1e-11)
    assert live.load_work == pytest.approx(dead.load_work, rel=1e-9)
    np.testing.assert_allclose(live.internal_force(0.0), F, atol=1e-10)


@pytest.mark.parametrize("formulation", ["automatic", "energy"])
def test_a_spring_at_the_tip_shares_a_small_load(formulation):
    """Cantilever and spring in parallel: x = F / (3 EI / L^3 + k)."""
    k, F = 4.0 * EI / L**3, 1e-4 * EI / L**2
    spring = ctr.PotentialLoad(lambda p: 0.5 * k * (p[0] ** 2 + p[1] ** 2))
    result = solve(rod(), held(), [spring, ctr.PointWrench([F, 0, 0])], formulation=formulation)
    x = F / (3 * EI / L**3 + k)
    # geometric nonlinearity: relative (x / L)^2 = 2e-10; the shape is known to 1e-9 of the length
    assert result.tip_position[0] == pytest.approx(x, abs=2e-9 * L)
    assert result.potential_energy == pytest.approx(-0.5 * F * x, abs=1e-6 * F * x)


def test_a_beam_on_an_elastic_foundation():
    """Winkler: EI w'''' + k w = 0 under a small tip force, clamped at the entry; Hetenyi's cantilever."""
    k, F = 300.0 * EI / L**4, 1e-3 * EI / L**2
    bed = ctr.PotentialLoad(lambda p: 0.5 * k * (p[0] ** 2 + p[1] ** 2), start=0.0)
    result = solve(rod(), held(), [bed, ctr.PointWrench([F, 0, 0])])
    b = (k / (4 * EI)) ** 0.25
    x = b * L
    w = 2 * F * b / k * (np.sinh(x) * np.cosh(x) - np.sin(x) * np.cos(x)) / (np.cosh(x) ** 2 + np.cos(x) ** 2)
    # the foundation acts on the shortened rod: relative w'^2 = (F / k)^2 b^4 = 1e-7 at most
    assert result.tip_position[0] == pytest.approx(w, rel=1e-6)


def wall(stiffness, place):
    return ctr.PotentialLoad(lambda p: 0.5 * stiffness * ca.fmax(p[0] - place, 0) ** 2, start=0.0)


@pytest.mark.parametrize("formulation", ["automatic", "energy"])
def test_a_wall_pushes_as_dead_loads_of_its_size_would(formulation):
    made, loads = rod(curvature=[0.0, 8.0, 0.0]), [ctr.PointWrench([0.4, 0.2, -0.1])]
    pressed = solve(made, held(), [wall(2e3, 0.02), *loads], formulation=formulation, tolerance=1e-8)
    depth = pressed.tip_position[0] - 0.02
    assert depth > 1e-3  # it does touch

    s = np.linspace(0.0, L, 400)
    x = CubicSpline(s, pressed.position(s)[:, 0])  # off by (L / 400)^4 of its fourth derivative, 1e-12

    def pressure(s):
        return [-2e3 * max(float(x(s)) - 0.02, 0.0), 0.0, 0.0]

    touch = float(brentq(lambda s: x(s) - 0.02, 0.0, L))
    same = ctr.DistributedLoad(pressure, start=touch)
    dead = ctr.ForwardProblem(made, tolerance=1e-8).solve(held(), [same, *loads], initial=pressed)
    np.testing.assert_allclose(dead.tip_position, pressed.tip_position, atol=3e-8 * L)
    assert pressed.verify() < 2e-8 * L


def test_a_wall_that_is_not_reached_does_nothing():
    made, loads = rod(curvature=[0.0, 8.0, 0.0]), [ctr.PointWrench([0.4, 0.2, -0.1])]
    free = solve(made, held(), loads)
    beside = solve(made, held(), [wall(2e3, 0.2), *loads])
    np.testing.assert_allclose(beside.tip_position, free.tip_position, atol=1e-9 * L)


@pytest.mark.slow
def test_energy_and_equilibrium_agree_on_random_robots_with_springs():
    for seed in range(4):
        rng = np.random.default_rng(700 + seed)
        made, actuation, loads = random_problem(rng, 1 + seed % 3, moments=False, load=0.3, functions=False)
        reach = min(t.length + b for t, b in zip(made.tubes, actuation.translations, strict=True))
        stiffness, anchor = 0.3 * made.tubes[0].bending_stiffness / reach**3, ca.DM(rng.uniform(-0.1, 0.1, 3))
        spring = ctr.PotentialLoad(lambda p, a=anchor, k=stiffness: 0.5 * k * ca.sumsqr(p - a), arc_length=0.7 * reach)
        first = ctr.ForwardProblem(made).solve(actuation, [*loads, spring])
        for other in (
            {"formulation": "energy"},
            {"formulation": "energy", "transcription": ctr.MultipleShooting()},
            {"formulation": "equilibrium", "transcription": ctr.MultipleShooting()},
            {"formulation": "equilibrium", "transcription": ctr.Collocation(3, "radau")},
        ):
            second = ctr.ForwardProblem(made, **other).solve(actuation, [*loads, spring])
            np.testing.assert_allclose(second.tip_position, first.tip_position, atol=2e-7 * first.length)
            assert second.potential_energy == pytest.approx(first.potential_energy, rel=1e-5)


# -- expressions -------------------------------------------------------------------------------------------------------


def test_an_expression_can_be_any_other_load():
    made = random_robot(np.random.default_rng(8), 2)
    actuation = ctr.Actuation([0.3, 1.1], [-0.1, -0.03])
    F, M = np.array([0.2, -0.1, 0.3]), np.array([0.003, 0.004, -0.002])
    pairs = [
        (ctr.PointWrench(F, M, tube=1), ctr.ExpressionLoad(lambda s, p, R: (F, M), tube=1)),
        (
            ctr.PointWrench(F, M, tube=1, frame="body"),
            ctr.ExpressionLoad(lambda s, p, R: (R @ ca.DM(F), R @ ca.DM(M)), tube=1),
        ),
        (
            ctr.DistributedLoad(lambda s: F * np.sin(40 * s), 5 * M, start=0.01, tube=1, frame="body"),
            ctr.ExpressionLoad(lambda s, p, R: (R @ ca.DM(F) * ca.sin(40 * s), R @ ca.DM(5 * M)), start=0.01, tube=1),
        ),
        (
            ctr.PotentialLoad(lambda p: 3 * ca.sumsqr(p), start=0.0),
            ctr.ExpressionLoad(lambda s, p, R: (-6 * p, [0, 0, 0]), start=0.0),
        ),
    ]
    for known, expressed in pairs:
        a, b = solve(made, actuation, [known]), solve(made, actuation, [expressed])
        np.testing.assert_allclose(b.tip_position, a.tip_position, atol=2e-9 * a.length)
        np.testing.assert_allclose(b.internal_moment(0.0), a.internal_moment(0.0), atol=1e-8)


def test_factors_and_places_add_up():
    made = rod(curvature=[8.0, 0.0, 0.0])

    def pull(s, p, R):
        return [0.1 + p[0], 0.0, 0.0], [0, 0, 0]

    twice = [ctr.ExpressionLoad(pull, arc_length=0.05), ctr.ExpressionLoad(pull, arc_length=0.05)]
    doubled = [ctr.ExpressionLoad(pull, arc_length=0.05, factor=2.0)]
    a, b = solve(made, held(), twice), solve(made, held(), doubled)
    np.testing.assert_allclose(a.tip_position, b.tip_position, atol=1e-11)
    assert len(a.configuration.kind.fields) == 1  # one expression, compiled once


def test_at_the_entry_a_body_moment_twists_the_transmission_alone():
    made, M = rod(length=2 * L), 0.01
    act = ctr.Actuation([0.0], [-L])
    result = solve(made, act, [ctr.PointWrench(moment=[0, 0, M], arc_length=0.0, frame="body")])
    assert result.last_iterate.torsional[0] == pytest.approx(M, rel=1e-10)
    assert result.tube_angle(0, L) == pytest.approx(M * L / GJ, rel=1e-9)


@pytest.mark.parametrize("formulation", ["automatic", "energy"])
@pytest.mark.parametrize("load", ["dead", "potential"])
def test_a_force_at_the_entry_is_held_by_the_base(formulation, load):
    """It moves nothing; the internal force behind it is that of the other load."""
    made = rod(curvature=[0.0, 8.0, 0.0])
    at_entry = (
        ctr.PointWrench([-3.0, 0, 0], arc_length=0.0)
        if load == "dead"
        else ctr.PotentialLoad(lambda p: 3.0 * p[0], arc_length=0.0)
    )
    push = ctr.PointWrench([0.3, 0.1, 0.0])
    alone = solve(made, held(), [push], formulation=formulation)
    both = solve(made, held(), [at_entry, push], formulation=formulation)
    np.testing.assert_allclose(both.internal_force(0.0), [0.3, 0.1, 0.0], atol=1e-9)
    np.testing.assert_allclose(both.position(both.arc_length), alone.position(both.arc_length), atol=1e-9 * L)
    assert both.energy == pytest.approx(alone.energy, rel=1e-8)
    assert both.last_iterate.force[0] == pytest.approx(0.0 if load == "dead" else -3.0, abs=1e-9)
    assert both.verify() <= 1e-9 * L


@pytest.mark.parametrize(
    "load",
    [
        ctr.ExpressionLoad(lambda s, p, R: ([10 * ca.sqrt(s - 0.05), 0, 0], [0, 0, 0]), start=0.05),
        ctr.ExpressionLoad(lambda s, p, R: ([ca.log(s - 0.05), 0, 0], [0, 0, 0]), start=0.06),
        ctr.PotentialLoad(lambda p: 25.0 * (ca.norm_2(p) - 0.08) ** 2),  # a string to the entry, without value there
        ctr.ExpressionLoad(lambda s, p, R: ([ca.log(-1 - s), 0, 0], [0, 0, 0]), factor=0.0),
    ],
)
def test_where_a_load_does_not_act_it_needs_no_value(load):
    # sqrt has no polynomial at its start: 1e-6 is what steps of a thousandth of the rod give
    result = solve(rod(curvature=[0.0, 8.0, 0.0]), held(), [load], tolerance=1e-6)
    assert result.verify() <= 1e-6 * L


def test_a_narrow_expression_is_seen():
    """1 N within a fifth of a millimetre, anywhere, is nearly a point force."""
    made, width = rod(curvature=[0.0, 8.0, 0.0]), 2e-4
    for c in (0.0471, 0.0633):

        def bump(s, p, R, c=c):
            return [ca.exp(-(((s - c) / width) ** 2)) / (width * np.sqrt(np.pi)), 0, 0], [0, 0, 0]

        spread = solve(made, held(), [ctr.ExpressionLoad(bump, start=0.0)], tolerance=1e-7)
        point = solve(made, held(), [ctr.PointWrench([1.0, 0, 0], arc_length=c)])
        # second moment of the bump, (2e-4)^2 / 2, times what a second derivative does: 1e-6 of the length
        np.testing.assert_allclose(spread.tip_position, point.tip_position, atol=3e-6 * L)
        assert spread.verify() <= 1e-7 * L


# -- routes ------------------------------------------------------------------------------------------------------------


def test_from_a_dead_load_to_a_live_one_and_back():
    """The unknowns differ, the branch does not."""
    made = random_robot(np.random.default_rng(9), 2)
    problem, actuation = ctr.ForwardProblem(made), ctr.Actuation([0.3, 1.1], [-0.1, -0.03])
    dead, live = [ctr.PointWrench([0.2, 0.1, 0.0])], [ctr.PointWrench([0.1, -0.2, 0.0], frame="body")]
    a, b = problem.solve(actuation, dead), problem.solve(actuation, live)
    forth, back = problem.solve(actuation, live, initial=a), problem.solve(actuation, dead, initial=b)
    np.testing.assert_allclose(forth.tip_position, b.tip_position, atol=2e-7 * a.length)
    np.testing.assert_allclose(back.tip_position, a.tip_position, atol=2e-7 * a.length)
    assert forth.last_iterate.force @ forth.last_iterate.force > 0.0
    assert not back.last_iterate.force.any()


def test_a_follower_force_bends_a_rod_round_and_round():
    """Far from the straight start: steps of the load, each from the last equilibrium, end where one solve does."""
    made, problem = rod(), ctr.ForwardProblem(rod())
    whole = 12.0 * EI / L**2
    there = problem.solve(held())
    for factor in np.linspace(0.1, 1.0, 10):
        there = problem.solve(held(), [ctr.PointWrench([factor * whole, 0, 0], frame="body")], initial=there)
    once = problem.solve(held(), [ctr.PointWrench([whole, 0, 0], frame="body")])
    np.testing.assert_allclose(once.tip_position, there.tip_position, atol=3e-7 * L)
    _, tip, _ = from_the_tip([(EI, GJ, np.zeros(3))], [0.0], [whole, 0, 0], np.zeros(3), 0.0, 0.0, L)
    np.testing.assert_allclose(once.tip_position, tip, atol=2e-7 * L)
    assert made == once.robot


# -- refusals ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("load", "words"),
    [
        (ctr.PointWrench([1, 0, 0], frame="body"), r"loads\[0\] \(PointWrench\) acts in a tube's frame"),
        (ctr.DistributedLoad([1, 0, 0], frame="body"), r"loads\[0\] \(DistributedLoad\) acts in a tube's frame"),
        (ctr.PointWrench(moment=[1, 0, 0]), r"loads\[0\] \(PointWrench\) applies a moment"),
        (ctr.ExpressionLoad(lambda s, p, R: (p, p)), r"loads\[0\] \(ExpressionLoad\) is given as an expression"),
    ],
)
def test_the_energy_refuses_loads_without_potential_by_name(load, words):
    with pytest.raises(ctr.DefinitionError, match=words):
        ctr.ForwardProblem(rod(), formulation="energy").solve(held(), [load])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ctr.PotentialLoad(3.0), "potential = 3.0 must be a function"),
        (lambda: ctr.PotentialLoad(lambda p: p), r"potential\(p\) must be a scalar, but has shape \(3, 1\)"),
        (lambda: ctr.PotentialLoad(lambda p: ca.SX.sym("k") * p[0]), "of its arguments alone"),
        (lambda: ctr.PotentialLoad(lambda p: p.missing), "potential.* failed: AttributeError"),
        (lambda: ctr.ExpressionLoad(lambda s, p, R: p), r"must return a pair \(force, moment\)"),
        (lambda: ctr.ExpressionLoad(lambda s, p, R: (R, p)), r"the force of .* must be a vector of 3"),
        (lambda: ctr.PotentialLoad(lambda p: p[0], arc_length=0.1, start=0.0), "are both given"),
        (lambda: ctr.PotentialLoad(lambda p: p[0], start=0.2, end=0.1), r"end = 0.1 m must be above start"),
        (lambda: ctr.PotentialLoad(lambda p: p[0], factor=np.nan), "factor = nan must be a finite number"),
        (lambda: ctr.PotentialLoad(ca.Function("potential", [XY], [XY[0]])), "potential.* failed"),
        (lambda: ctr.PotentialLoad(ca.Function("potential", [XYZ], [XYZ])), r"must be a scalar, but has shape"),
        (lambda: ctr.ExpressionLoad(ca.Function("function", [XYZ], [XYZ])), "function.* failed"),
        (lambda: ctr.PointWrench([1, 0, 0], frame="tube"), "frame = 'tube' must be 'world' or 'body'"),
    ],
)
def test_wrong_loads_are_reported(make, words):
    with pytest.raises(ctr.DefinitionError, match=words):
        make()


def test_a_force_that_is_not_finite_is_not_solved():
    load = ctr.ExpressionLoad(lambda s, p, R: ([ca.sqrt(-1 - p[2] ** 2), 0, 0], [0, 0, 0]))
    with pytest.raises(ctr.SolveError, match="not finite"):
        ctr.ForwardProblem(rod()).solve(held(), [load])


def test_loads_by_expression_are_told_apart_by_content():
    def spring(k):
        return ctr.PotentialLoad(lambda p: k * ca.sumsqr(p))

    assert spring(1.0) == spring(1.0)
    assert spring(1.0) != spring(2.0)
    import pickle

    assert pickle.loads(pickle.dumps(spring(1.0))) == spring(1.0)
