"""What the actuators exert on the tubes' bases: closed forms, the potential energy of solves, virtual work."""

import casadi as ca
import numpy as np
import pytest

import ctr_opt as ctr
from tests.support.perturbed import TIGHT, central, loads_for_all, one_sided
from tests.support.physics import gauss, intervals, point_loads, random_problem, robot, rod, tube
from tests.support.slow import some_slow

# The potential energy is known to about the square of the error of a solve, so that differences of it with steps of
# 20 um and 1 mrad are good to 1e-8 of the forces that act here.
FAR, TURN = 2e-5, 1e-3


def test_a_straight_rod_pushed_axially():
    push = ctr.PointWrench([0.0, 0.0, -0.4])
    solved = ctr.ForwardProblem(rod()).solve(ctr.Actuation([0.2], [-0.03]), [push])
    assert solved.actuator_wrench(0) == pytest.approx((0.4, 0.0), abs=1e-12)


def test_an_arc_held_straight_behind_the_entry_is_drawn_in_by_what_it_stores():
    """Free in front of the entry, it stores EI kappa^2 / 2 per length behind it."""
    solved = ctr.ForwardProblem(rod(curvature=9.0)).solve(ctr.Actuation([0.2], [-0.03]))
    assert solved.actuator_wrench(0) == pytest.approx((-0.5 * 0.02 * 81.0, 0.0), rel=1e-10, abs=1e-12)


def test_two_opposed_arcs():
    """Curved against each other and of unequal ends: energies per length, in closed form."""
    stiff, soft, a, b = 0.03, 0.01, 4.0, -7.0
    made = robot(tube("inner", ctr.Arc(0.12, a), soft), tube("outer", ctr.Arc(0.08, b), stiff))
    solved = ctr.ForwardProblem(made).solve(ctr.Actuation([0.0, 0.0], [-0.01, -0.02]))
    together = 0.5 * stiff * soft / (stiff + soft) * (a - b) ** 2  # per length where both are
    inner, outer = 0.5 * soft * a**2, 0.5 * stiff * b**2  # per length held straight
    assert solved.actuator_wrench(0)[0] == pytest.approx(-inner, rel=1e-9)
    assert solved.actuator_wrench(1)[0] == pytest.approx(together - outer, rel=1e-9)


def test_a_twisted_rod():
    """A dead moment about the axis of a straight rod: drawn in or out, it stores the same energy and does no work."""
    solved = ctr.ForwardProblem(rod()).solve(ctr.Actuation([0.0], [-0.02]), [ctr.PointWrench(moment=[0, 0, 0.01])])
    assert solved.actuator_wrench(0) == pytest.approx((0.0, -0.01), rel=1e-9, abs=1e-12)


def conservative(seed):
    rng = np.random.default_rng(seed)
    n = 1 + seed % 3
    made, actuation, loads = random_problem(rng, n, moments=False, load=0.5, pose=True, functions=False)
    riding = ctr.DistributedLoad(rng.normal(size=3), start=0.01, tube=n - 1)
    field = ctr.PotentialLoad(lambda p: 8.0 * ca.sumsqr(p) + p[0], start=0.005, tube=n - 1)
    at = ctr.PotentialLoad(lambda p: p[1] ** 2 * 30.0, arc_length=0.02)
    return n, made, actuation, [*loads, *loads_for_all(n)[:3], riding, field, at]


@pytest.mark.parametrize("seed", some_slow([1, 2], [1]))
def test_differences_of_the_potential_energy(seed):
    """Along a random direction of the bases' motion."""
    n, made, actuation, loads = conservative(seed)
    problem = ctr.ForwardProblem(made, tolerance=TIGHT)
    solved = problem.solve(actuation, loads)
    direction = np.random.default_rng(seed).uniform(0.5, 1.0, n) * [1.0, -1.0, 1.0][:n]
    wrenches = np.array([solved.actuator_wrench(i) for i in range(n)])

    def energy(pushed, turned):
        other = ctr.Actuation(actuation.rotations + turned * direction, actuation.translations + pushed * direction)
        return problem.solve(other, loads, initial=solved).potential_energy

    force, torque = central(lambda x: energy(x, 0.0), FAR), central(lambda x: energy(0.0, x), TURN)
    assert direction @ wrenches == pytest.approx((force, torque), rel=1e-6, abs=1e-7)


@pytest.mark.parametrize("seed", range(2))
def test_virtual_work_of_any_loads(seed):
    """Elastic energy gained less the work of the dead loads where they act, by exact derivatives of both."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 3
    made, actuation, loads = random_problem(rng, n, load=0.5, functions=False)
    follower = ctr.PointWrench([0.1, -0.1, 0.2], [0.004, 0.002, -0.003], tube=0, frame="body")
    solved = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, [*loads, follower])
    ends = solved.configuration.tube_ends
    total = solved.sensitivity("energy", "translations")
    riding = [load.tube for load in loads if getattr(load, "arc_length", 0.0) is None]
    total = total - sum((wrench @ _rates(solved, s, i, i in riding) for s, i, wrench in _wrenches(solved)), np.zeros(n))
    for start, end, i, force, moment, inner in intervals(solved):

        def work(s, i=i, force=force, moment=moment):
            return np.concatenate((force(s), moment(s))) @ _rates(solved, s, i, False)

        cuts = [*inner, *solved.configuration.break_points]
        total = total - gauss(work, start, end, cuts, points=6)
    found = [solved.actuator_wrench(i)[0] for i in range(n)]
    assert len(ends) == n
    # sums of ten terms of the solves' accuracy, and quadrature with six points
    np.testing.assert_allclose(found, total, rtol=0.0, atol=1e-7 * max(1.0, np.abs(total).max()))


def _wrenches(solved):
    """Every point load's place, tube and wrench in the world."""
    for (s, i, force, moment), load in zip(
        point_loads(solved), [w for w in solved.loads if isinstance(w, ctr.PointWrench)], strict=True
    ):
        frame = solved.pose(s, i)[:3, :3] if load.frame == "body" else np.eye(3)
        yield s, i, np.concatenate((frame @ force, frame @ moment))


def _rates(solved, s, i, riding):
    """Derivative of a tube's pose by the translations, at fixed ``s`` or riding on the tube's end."""
    end = solved.configuration.tube_ends[i]
    if abs(s - end) > 1e-12:
        return solved.sensitivity(("pose", s, i), "translations")
    rates = solved.sensitivity(("pose", end, i), "translations")  # from the left, at fixed s
    frame, bent = solved.pose(end, i)[:3, :3], _left_curvature(solved, i, end)
    rates[:, i] += np.concatenate((frame[:, 2], frame @ bent))
    return rates


def _left_curvature(solved, i, end):
    """``u_i`` in the tube's own frame, left of its end."""
    values = solved.shape.at(np.array([end]), from_left=True)
    psi = values.state.angles[i, 0]
    c, s = np.cos(psi), np.sin(psi)
    x, y = values.bent[:, 0]
    return np.array([c * x + s * y, c * y - s * x, values.twisted[i, 0]])


@pytest.mark.parametrize("side", [1, -1])
def test_forces_at_a_kink(side):
    inner = tube("inner", [ctr.Straight(0.10), ctr.Arc(0.10, 12.0)], 0.01, 0.0075)
    outer = tube("outer", [ctr.Straight(0.04), ctr.Arc(0.10, [3.0, 9.0, 0.0])], 0.03, 0.02)
    made, actuation = robot(inner, outer), ctr.Actuation([0.4, 0.0], [-0.10, -0.04])
    problem, loads = ctr.ForwardProblem(made, tolerance=TIGHT), [ctr.PointWrench([0.1, -0.1, 0.05])]
    solved = problem.solve(actuation, loads)
    for i in range(2):

        def energy(x, i=i):
            other = ctr.Actuation(actuation.rotations, actuation.translations + x * np.eye(2)[i])
            return problem.solve(other, loads, initial=solved).potential_energy

        assert solved.actuator_wrench(i, side)[0] == pytest.approx(one_sided(energy, side * FAR), rel=1e-6)
