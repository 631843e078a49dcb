"""Balance of forces and moments, jumps, work and energy: statics that knows nothing of how the shape was found."""

import attrs
import numpy as np
import pytest

import ctr_opt as ctr
from tests.support.physics import (
    break_points,
    gauss,
    held,
    intervals,
    point_loads,
    random_problem,
    robot,
    rod,
    tube,
    tube_ends,
)

TOLERANCE = 1e-11
L, EI, GJ = 0.1, 0.02, 0.015


def solve(made, actuation, loads=(), initial=None, tolerance=TOLERANCE):
    return ctr.ForwardProblem(made, tolerance=tolerance).solve(actuation, loads, initial)


def telescope():
    """Two tubes with transmissions, the inner one reaching further; curved, so that everything is coupled."""
    made = robot(
        tube("inner", [ctr.Straight(0.08), ctr.Arc(0.07, [12.0, 0.0, 3.0])], 0.01, 0.008),
        tube("outer", [ctr.Straight(0.03), ctr.Arc(0.06, [6.0, 4.0, -5.0])], 0.03, 0.022),
    )
    return made, ctr.Actuation([0.5, -0.9], [-0.06, -0.035])


# -- balance -----------------------------------------------------------------------------------------------------------


def beyond(result, s, side=1):
    """Force and moment about ``p(s)`` of all that acts on ``[s, length]``, by quadrature over the shape."""
    here = result.position(s)
    force, moment = np.zeros(3), np.zeros(3)
    for at, _, F, M in point_loads(result):
        if at > s + 1e-12 or (abs(at - s) <= 1e-12 and side < 0):
            force, moment = force + F, moment + np.cross(result.position(at) - here, F) + M
    cuts = break_points(result)
    for start, end, _, f, m, _ in intervals(result):
        if s < end:
            begin = max(s, start)
            force = force + gauss(f, begin, end, cuts)
            moment = moment + gauss(
                lambda x, f=f, m=m: np.cross(result.position(x) - here, f(x)) + m(x), begin, end, cuts
            )
    return force, moment


@pytest.mark.parametrize(("seed", "n"), [(11, 1), (12, 2), (13, 3), (14, 4), (15, 3), (16, 2)])
def test_balance_of_forces_and_moments(seed, n):
    made, actuation, loads = random_problem(np.random.default_rng(seed), n, load=1.5, most_loads=6, pose=True)
    result = solve(made, actuation, loads)
    unit = max(t.bending_stiffness for t in made.tubes) / result.length
    # The shape is good to 1e-11 of the length, so moments of loads of the order of EI/length^2 are good to 1e-11 of
    # EI/length times the number of loads; 12 Gauss points a piece leave less.
    for s in np.linspace(0.0, result.length, 6):
        force, moment = beyond(result, s, -1 if s == result.length else 1)
        np.testing.assert_allclose(result.internal_force(s), force, atol=1e-10 * unit / result.length)
        np.testing.assert_allclose(result.internal_moment(s), moment, atol=1e-9 * unit)


@pytest.mark.parametrize(("seed", "n"), [(21, 2), (22, 3), (23, 4)])
def test_tube_moments_add_up(seed, n):
    made, actuation, loads = random_problem(np.random.default_rng(seed), n, load=1.5)
    result = solve(made, actuation, loads)
    ends = tube_ends(made, actuation)
    unit = max(t.bending_stiffness for t in made.tubes) / result.length
    for s in np.linspace(0.0, 0.97 * result.length, 7):
        there = [i for i in range(n) if ends[i] > s]
        total = sum(result.pose(s, i)[:3, :3] @ result.tube_moment(i, s) for i in there)
        # The same states, added up in another order: rounding.
        np.testing.assert_allclose(total, result.internal_moment(s), atol=1e-12 * unit)


# -- jumps -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("carrier", [0, 1])
def test_jumps_at_a_point_wrench(carrier):
    made, actuation = telescope()
    at, F, M = 0.03, np.array([0.4, -0.3, 0.2]), np.array([0.01, 0.006, 0.012])
    result = solve(made, actuation, [ctr.PointWrench(F, M, at, carrier), ctr.PointWrench([0.1, 0.2, 0.3])])
    step = 1e-9
    # Nothing else changes by more than its slope times 1e-9 m; slopes are below 1e3 in these units.
    before, after = at - step, at
    np.testing.assert_allclose(result.internal_force(before) - result.internal_force(after), F, atol=1e-12)
    np.testing.assert_allclose(result.internal_moment(before) - result.internal_moment(after), M, atol=1e-7)
    R = result.pose(at)[:3, :3]
    for i, t in enumerate(made.tubes):
        jump = t.torsional_stiffness * (result.torsion(i, before) - result.torsion(i, after))
        assert jump == pytest.approx((R.T @ M)[2] if i == carrier else 0.0, abs=1e-8)
        assert result.tube_angle(i, before) == pytest.approx(result.tube_angle(i, after), abs=1e-7)
    stiffness = sum(t.bending_stiffness for t in made.tubes)
    frame = R @ _turn(-result.tube_angle(0, at))
    bent = stiffness * (result.curvature(before) - result.curvature(after))
    np.testing.assert_allclose(bent[:2], (frame.T @ M)[:2], atol=1e-7)
    np.testing.assert_allclose(result.pose(before), result.pose(after), atol=1e-7)


def _turn(a):
    return np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])


def test_values_at_a_jump_are_limits_from_the_right():
    made, actuation = telescope()
    loads = [ctr.PointWrench([0.4, 0.1, 0.2], [0.01, 0.0, 0.02], arc_length=0.04, tube=1)]
    result = solve(made, actuation, loads)
    steps = [0.02, 0.04, 0.055]  # inner tube's curvature begins, wrench, outer tube's end
    step = 1e-9
    for s in steps:
        # Slopes of curvatures are below 1e4/m^2, so 1e-5/m in 1e-9 m.
        np.testing.assert_allclose(result.curvature(s), result.curvature(s + step), atol=1e-5)
        assert np.linalg.norm(result.curvature(s) - result.curvature(s - step)) > 0.1
        assert result.torsion(0, s) == pytest.approx(result.torsion(0, s + step), abs=1e-5)
        np.testing.assert_allclose(result.internal_force(s), result.internal_force(s + step), atol=1e-12)
        np.testing.assert_allclose(result.tube_moment(0, s), result.tube_moment(0, s + step), atol=1e-6)
    # u*_z of the inner tube steps by 3/m where its arc begins, and its torsion with it.
    assert result.torsion(0, 0.02) - result.torsion(0, 0.02 - step) == pytest.approx(3.0, abs=1e-5)


def test_values_at_a_tube_end_and_at_the_tip_are_limits_from_the_left():
    made, actuation = telescope()
    couple, force = np.array([0.01, 0.005, 0.02]), np.array([0.3, -0.1, 0.2])
    loads = [ctr.PointWrench(force, couple, tube=1), ctr.PointWrench(-force, 2 * couple, tube=0)]
    result = solve(made, actuation, loads)
    outer_end, step = 0.055, 1e-9
    # The outer tube still carries what acts on its end: an axial moment, and its share of the bending.
    R = result.pose(outer_end, 1)[:3, :3]
    assert result.tube_moment(1, outer_end)[2] == pytest.approx((R.T @ couple)[2], abs=1e-10)
    assert result.torsion(1, outer_end) == pytest.approx(result.torsion(1, outer_end - step), abs=1e-5)
    np.testing.assert_allclose(result.tube_moment(1, outer_end), result.tube_moment(1, outer_end - step), atol=1e-6)
    assert abs(result.tube_moment(1, outer_end)[:2]).max() > 1e-3
    # At the tip everything is what acts on it.
    np.testing.assert_allclose(result.internal_force(result.length), -force, atol=1e-12)
    np.testing.assert_allclose(result.internal_moment(result.length), 2 * couple, atol=1e-11)
    np.testing.assert_allclose(result.curvature(result.length), result.curvature(result.length - step), atol=1e-5)


def test_nothing_is_said_outside_the_robot():
    made, actuation = telescope()
    result = solve(made, actuation)
    for call in (
        lambda: result.position(-1e-6),
        lambda: result.position(result.length + 1e-6),
        lambda: result.torsion(1, 0.055 + 1e-6),
        lambda: result.pose([0.0, 0.06], tube=1),
        lambda: result.internal_force(np.nan),
    ):
        with pytest.raises(ctr.DefinitionError):
            call()


# -- a point load is the limit of distributed ones ---------------------------------------------------------------------


@pytest.mark.parametrize(("centred", "order"), [(True, 2), (False, 1)], ids=["centred", "one-sided"])
@pytest.mark.parametrize("kind", ["force", "moment"])
def test_point_load_is_a_limit(kind, centred, order):
    made, actuation = telescope()
    at = 0.042  # inside smooth sections on both sides, 0.013 before the outer tube's end
    vector = np.array([0.5, 0.3, -0.2]) if kind == "force" else np.array([0.01, -0.02, 0.015])
    limit = solve(made, actuation, [ctr.PointWrench(**{kind: vector}, arc_length=at, tube=1)])
    errors = []
    for width in (8e-3, 4e-3, 2e-3):
        start, end = (at - width, at + width) if centred else (at, at + width)
        load = ctr.DistributedLoad(**{kind: vector / (end - start)}, start=start, end=end, tube=1)
        errors.append(np.linalg.norm(solve(made, actuation, [load], limit).tip_position - limit.tip_position))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    # Errors are 1e-4 to 1e-7 m, far above the 1e-12 m of the solves; the next term shifts the order by a few percent.
    np.testing.assert_allclose(orders, order, atol=0.1)


# -- work and energy ---------------------------------------------------------------------------------------------------


def test_work_of_slowly_growing_forces_is_the_energy_gained():
    """Loads lambda F do the work ``F . p(1) - integral of F . p dlambda``; transmissions take part of it."""
    made, actuation = telescope()
    loads = [
        ctr.PointWrench([0.9, -0.5, 0.3]),
        ctr.PointWrench([-0.4, 1.0, 0.2], arc_length=0.035, tube=1),
        ctr.DistributedLoad([4.0, 6.0, -3.0], start=0.01, tube=1),
        ctr.DistributedLoad(([0.0, 0.04, 0.09], [[0, 0, 1], [5, 0, 0], [0, 3, 0]])),
    ]
    unloaded = solve(made, actuation)

    def at(factor):
        return solve(made, actuation, [load.times(factor) for load in loads], unloaded)

    def force_dot_position(result):
        total = sum(F @ result.position(s) for s, _, F, _ in point_loads(result))
        for start, end, _, f, _, _ in intervals(result):
            total += gauss(lambda x, f=f: np.array([f(x) @ result.position(x)]), start, end, break_points(result))[0]
        return total

    x, w = np.polynomial.legendre.leggauss(10)
    loaded = at(1.0)
    # F . p of the full load at the shape under the partial one.
    between = [force_dot_position(_carrying(at(0.5 * (1 + a)), loads)) for a in x]
    work = force_dot_position(loaded) - 0.5 * np.dot(w, between)
    gained = loaded.energy - unloaded.energy
    # Gauss quadrature with 10 points over a smooth path, positions to 1e-12 m: nine digits of the work.
    assert gained == pytest.approx(work, rel=1e-9)
    twist = abs(loaded.last_iterate.torsional - unloaded.last_iterate.torsional)
    assert twist.max() > 1e-3  # the transmissions are twisted, and their energy counts
    assert loaded.load_work == pytest.approx(force_dot_position(loaded), rel=1e-11)
    assert loaded.potential_energy == pytest.approx(loaded.energy - loaded.load_work, rel=1e-14)


class _carrying:
    """The shape of a result, with other loads: for the work that the full load would do."""

    def __init__(self, result, loads):
        self._result, self.loads = result, loads

    def __getattr__(self, name):
        return getattr(self._result, name)


def test_work_of_a_slowly_growing_end_moment():
    """A moment on tube i does work through the rotation of that tube's material."""
    made, actuation = telescope()
    wrench = ctr.PointWrench([0.5, 0.2, -0.1], [0.015, -0.02, 0.03])
    couple = ctr.PointWrench(moment=[0.01, 0.012, -0.03], tube=1)  # mostly axial, on the outer tube's end
    tip, outer = 0.09, 0.055

    def at(factor, initial=None):
        return solve(made, actuation, [wrench.times(factor), couple.times(factor)], initial)

    # Polynomials through 17 Chebyshev points in the load factor; the path is analytic and bends little.
    count = 17
    nodes = 0.5 * (1 + np.cos(np.pi * (np.arange(count) + 0.5) / count))
    results = [at(x) for x in nodes]
    fit = np.polynomial.chebyshev.Chebyshev.fit

    def path(values):
        flat = np.array(values).reshape(count, -1)
        parts = [fit(nodes, column, count - 1, domain=[0.0, 1.0]) for column in flat.T]
        shape = np.shape(values[0])

        def evaluate(x, order=0):
            return np.array([(part.deriv(order) if order else part)(x) for part in parts]).reshape(shape)

        return evaluate

    position = path([r.tip_position for r in results])
    turns = {
        0: path([r.pose(tip, 0)[:3, :3] for r in results]),
        1: path([r.pose(outer, 1)[:3, :3] for r in results]),
    }

    def power(x):
        total = wrench.force @ position(x, 1)
        for i, load in ((0, wrench), (1, couple)):
            spin = turns[i](x, 1) @ turns[i](x).T  # hat(omega)
            total += load.moment @ np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        return np.array([x * total])

    work = gauss(power, 0.0, 1.0, points=16)[0]
    gained = at(1.0).energy - at(0.0).energy
    # Derivatives of a polynomial through 17 points: eight digits.
    assert gained == pytest.approx(work, rel=1e-8)


def test_base_torque_is_the_energys_slope():
    """``dPi/dalpha_i = -tau_i(0)``, by central differences with Richardson's extrapolation."""
    made, actuation = telescope()
    loads = [ctr.PointWrench([0.6, -0.4, 0.2]), ctr.DistributedLoad([3.0, 2.0, -4.0], tube=1)]
    middle = solve(made, actuation, loads)

    def slope(i, h):
        energies = []
        for sign in (1, -1):
            rotations = actuation.rotations + sign * h * np.eye(2)[i]
            turned = ctr.Actuation(rotations, actuation.translations)
            energies.append(solve(made, turned, loads, middle).potential_energy)
        return (energies[0] - energies[1]) / (2 * h)

    for i, t in enumerate(made.tubes):
        expected = (4 * slope(i, 0.01) - slope(i, 0.02)) / 3
        # h^4 = 1e-8 times a coefficient of a few percent, and energies (1e-2 J) to 1e-14 over h: 1e-9 of the torque
        # scale EI/L.
        assert -middle.last_iterate.torsional[i] == pytest.approx(expected, abs=2e-9 * EI / L)
        # Behind the entry both tubes are straight, so tau_i = GJ_i u_i,z there.
        assert middle.last_iterate.torsional[i] == pytest.approx(
            t.torsional_stiffness * middle.torsion(i, 0.0) - (t.torsional_stiffness * -5.0 if i == 1 else 0.0),
            abs=1e-12,
        )


def test_energy_of_curved_parts_held_straight():
    """A curved tube drawn back costs half EI kappa^2 times what is inside, whatever it does in front."""
    kappa, inside = 12.0, 0.03
    made = robot(tube("arc", ctr.Arc(0.08, [kappa, 0.0, 0.0]), EI, GJ))
    result = solve(made, ctr.Actuation([0.4], [-inside]))
    assert result.energy == pytest.approx(0.5 * EI * kappa**2 * inside, rel=1e-12)


# -- on which tube a load acts -----------------------------------------------------------------------------------------


def straight_pair():
    made = robot(tube("inner", ctr.Straight(0.1), 0.01, 0.008), tube("outer", ctr.Straight(0.06), 0.03, 0.022))
    return made, held(2)


def test_axial_moment_twists_the_tube_named_and_no_other():
    made, actuation = straight_pair()
    M = 0.01
    result = solve(made, actuation, [ctr.PointWrench(moment=[0, 0, M], tube=1)])
    # Linear, so exact but for rounding.
    assert result.torsion(1, 0.03) == pytest.approx(M / 0.022, rel=1e-12)
    assert result.torsion(0, 0.03) == pytest.approx(0.0, abs=1e-12)
    result = solve(made, actuation, [ctr.PointWrench(moment=[0, 0, M], arc_length=0.04, tube=0)])
    assert result.torsion(0, 0.03) == pytest.approx(M / 0.008, rel=1e-12)
    assert result.torsion(0, 0.05) == pytest.approx(0.0, abs=1e-12)
    assert result.torsion(1, 0.03) == pytest.approx(0.0, abs=1e-12)


def test_force_across_may_act_on_any_tube():
    """Concentric tubes share forces and bending; on curved tubes that twist as well as on straight ones."""
    made, actuation = telescope()
    loads = [[ctr.PointWrench([0.5, 0.8, -0.3], arc_length=0.04, tube=i)] for i in (0, 1)]
    a, b = (solve(made, actuation, load) for load in loads)
    s = np.linspace(0, a.length, 7)
    np.testing.assert_allclose(a.pose(s), b.pose(s), atol=1e-12)  # the same numbers


def test_wrench_on_the_outer_tubes_end_rides_with_it():
    made, actuation = telescope()
    load = ctr.PointWrench([0.3, 0.4, 0.1], [0.0, 0.0, 0.02], tube=1)
    ridden = solve(made, actuation, [load])
    fixed = solve(made, actuation, [attrs.evolve(load, arc_length=0.055)])
    np.testing.assert_allclose(ridden.tip_pose, fixed.tip_pose, atol=1e-13)
    further = ctr.Actuation(actuation.rotations, actuation.translations + np.array([0.0, 0.01]))
    moved = solve(made, further, [load])
    np.testing.assert_allclose(moved.internal_force(0.06), load.force, atol=1e-12)
    np.testing.assert_allclose(moved.internal_force(0.066), 0.0, atol=1e-12)
    stayed = solve(made, further, [attrs.evolve(load, arc_length=0.055)])
    np.testing.assert_allclose(stayed.internal_force(0.06), 0.0, atol=1e-12)


def test_wrench_on_tube_0_that_ends_inside_another():
    made = robot(
        tube("inner", ctr.Arc(0.06, [9.0, 0.0, 0.0]), 0.01, 0.008),
        tube("outer", ctr.Arc(0.1, [0.0, 4.0, 0.0]), 0.03, 0.022),
    )
    F, M = np.array([0.5, 0.2, -0.3]), np.array([0.004, 0.006, 0.01])
    result = solve(made, held(2), [ctr.PointWrench(F, M)])
    assert result.length == pytest.approx(0.1)
    np.testing.assert_allclose(result.internal_force(0.05), F, atol=1e-13)
    np.testing.assert_allclose(result.internal_force(0.06), 0.0, atol=1e-13)
    R = result.pose(0.06, 0)[:3, :3]
    assert result.tube_moment(0, 0.06)[2] == pytest.approx((R.T @ M)[2], abs=1e-11)
    # Behind it the outer tube is free and keeps its own curvature; without a tube named the pose is the outer one's,
    # but where the inner tube ends still that one's.
    s = np.array([0.06, 0.08, 0.1])
    np.testing.assert_allclose(np.linalg.norm(result.curvature(s), axis=1), 4.0, rtol=1e-9)
    np.testing.assert_array_equal(result.pose(s[1:]), result.pose(s[1:], 1))
    np.testing.assert_array_equal(result.pose(s[0]), result.pose(s[0], 0))
    with pytest.raises(ctr.DefinitionError, match="tube 0"):
        result.pose(0.08, 0)


# -- at the entry ------------------------------------------------------------------------------------------------------


def test_wrench_at_the_entry_moves_nothing_but_twists_the_transmission():
    made, actuation = telescope()
    free = solve(made, actuation)
    pushed = solve(made, actuation, [ctr.PointWrench([3.0, -2.0, 5.0], [0.05, 0.08, 0.0], arc_length=0.0)])
    s = np.linspace(0.0, free.length, 7)
    # The wall takes all of it.
    np.testing.assert_allclose(pushed.pose(s), free.pose(s), atol=1e-12)
    np.testing.assert_allclose(pushed.internal_force(s), 0.0, atol=1e-12)

    M, behind = 0.02, 0.04
    straight = robot(tube("rod", ctr.Straight(0.1 + behind), EI, GJ))
    twisted = solve(straight, ctr.Actuation([0.3], [-behind]), [ctr.PointWrench(moment=[0.0, 0.0, M], arc_length=0.0)])
    assert twisted.tube_angle(0, 0.0) == pytest.approx(0.3 + M * behind / GJ, rel=1e-12)
    np.testing.assert_allclose(twisted.torsion(0, np.array([0.0, 0.05])), 0.0, atol=1e-12)
    assert twisted.last_iterate.torsional[0] == pytest.approx(M, rel=1e-12)  # at 0-, where the base holds it
    assert twisted.energy == pytest.approx(0.5 * M**2 * behind / GJ, rel=1e-11)


def test_base_exerts_what_the_loads_ask_for():
    """``internal_moment(0)`` of a rod under a tip force is its lever times the force."""
    F = np.array([1.2, -0.8, 0.5])
    result = solve(rod(L, EI, GJ, [5.0, 3.0, 0.0]), held(), [ctr.PointWrench(F)])
    np.testing.assert_allclose(result.internal_force(0.0), F, atol=1e-13)
    np.testing.assert_allclose(result.internal_moment(0.0), np.cross(result.tip_position, F), atol=1e-10 * EI / L)
