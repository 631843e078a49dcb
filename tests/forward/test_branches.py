"""Which branch an answer lies on: an initial equilibrium is followed, and no step jumps over what it should meet."""

import threading

import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.solvers.homotopy import regular_between
from tests.support.physics import held, robot, rod, tube


def pair(curvature, length=0.2):
    arc = ctr.Arc(length, float(curvature))
    return robot(tube("a", arc, 0.005, 0.004), tube("b", arc, 0.005, 0.004))


def test_an_initial_equilibrium_is_followed_and_not_jumped_from():
    """Steps of 30 degrees on a strongly curved pair: plain Newton lands on an unstable branch 177 mm away."""
    problem, shape = ctr.ForwardProblem(pair(15.0)), None
    for degrees in (0, 30, 60, 90):
        actuation = ctr.Actuation([0.0, np.deg2rad(degrees)], [0.0, 0.0])
        shape = problem.solve(actuation, initial=shape)
        cold = problem.solve(actuation)
        assert shape.determinant > 0.0
        np.testing.assert_allclose(shape.tip_position, cold.tip_position, atol=1e-7 * 0.2 * 2)  # two tolerances
    assert "continuation" in shape.path


@pytest.mark.parametrize("times", [4.0, 20.0, 22.5, 60.0])
def test_a_column_far_beyond_its_load_does_not_stay_straight(times):
    """The straight column is regular again beyond each further critical load, and unstable all the same."""
    load = ctr.PointWrench(force=[0.0, 0.0, -times * np.pi**2 / 4 * 0.02 / 0.2**2])
    shape = ctr.ForwardProblem(rod(0.2, 0.02, 0.015)).solve(held(), [load])
    assert np.hypot(*shape.tip_position[:2]) > 0.02


def test_a_regular_path_may_not_cross_zero_however_near_it_came():
    before, behind = np.diag([1.0, 1e-7]), np.diag([1.0, -1e-7])
    assert regular_between(before, before)
    assert not regular_between(before, behind)
    assert not regular_between(np.diag([1.0, 0.0]), behind)
    assert not regular_between(np.diag([1.0, 1.0]), np.diag([-1.0, -1.0]))  # the determinant does not show this one
    assert regular_between(before, behind, family=1e-6)  # along a family of equilibria both are rounding


def test_a_buckled_column_is_followed_in_its_plane():
    """It may lie in any plane, so the Jacobian is singular along that family; more load bends it on in the same one."""
    problem, critical = ctr.ForwardProblem(rod(0.2, 0.02, 0.015)), np.pi**2 / 4 * 0.02 / 0.2**2
    shape = problem.solve(held(), [ctr.PointWrench(force=[0.0, 0.0, -1.15 * critical])])
    plane = np.arctan2(*shape.tip_position[:2])
    for times in (1.2, 1.25):
        further = problem.solve(held(), [ctr.PointWrench(force=[0.0, 0.0, -times * critical])], initial=shape)
        assert further.path == "newton from initial"
        assert further.tip_position[2] < shape.tip_position[2]
        assert np.arctan2(*further.tip_position[:2]) == pytest.approx(plane, abs=1e-3)
        shape = further


@pytest.mark.parametrize("curvature", [60.0, 70.0, 90.0])
def test_opposed_tubes_far_beyond_their_threshold(curvature):
    """They snap until they lie side by side; where Newton's method cannot polish the minimum it is kept as it is."""
    shape = ctr.ForwardProblem(pair(curvature)).solve(ctr.Actuation([0.0, np.pi], [0.0, 0.0]))
    assert shape.stability_checked
    relative = shape.tube_angle(1, 0.2) - shape.tube_angle(0, 0.2)
    assert np.cos(relative) == pytest.approx(1.0, abs=1e-6)  # exp(-L sqrt(lambda)) of a radian is left at the tip
    assert shape.verify() <= 1e-7 * shape.length


def test_the_energy_starts_from_a_guess_as_well():
    problem = ctr.ForwardProblem(rod(0.2, 0.02, 0.015), formulation="energy")
    push = [ctr.PointWrench(force=[0.0, 0.0, -2.0 * np.pi**2 / 4 * 0.02 / 0.2**2])]
    left, right = (
        problem.solve(held(), push, initial=problem.guess(held(), push, bending=[0.0, sign * 0.2])) for sign in (-1, 1)
    )
    assert "energy from initial" in left.path
    assert left.tip_position[0] == pytest.approx(-right.tip_position[0], abs=1e-7)  # the two ways to buckle in a plane
    assert abs(left.tip_position[0]) > 0.05


@pytest.mark.parametrize(
    ("method", "path"), [("newton", "newton"), (ctr.Newton(), "newton"), ("ipopt", "energy"), ("homotopy", "homotopy")]
)
def test_a_method_chooses_its_formulation(method, path):
    push = [ctr.PointWrench(force=[0.3, 0.0, 0.0])]
    shape = ctr.ForwardProblem(rod(0.1), method=method).solve(held(), push)
    assert shape.path.startswith(path)
    with pytest.raises(ctr.DefinitionError, match="method = 'newtn' must be 'homotopy' or 'newton' or 'ipopt'"):
        ctr.ForwardProblem(rod(), method="newtn")


def test_threads_may_minimize_at_once():
    """IPOPT's linear solver is not safe in threads; a lock keeps them apart."""
    answers, push = [], [ctr.PointWrench(force=[0.3, 0.0, 0.0])]

    def work():
        problem = ctr.ForwardProblem(rod(0.1), formulation="energy")
        answers.extend(problem.solve(held(), push).tip_position for _ in range(10))

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(answers) == 30
    assert all(np.array_equal(answer, answers[0]) for answer in answers)


@pytest.mark.parametrize("width", [1e-3, 1e-4])
def test_a_narrow_load_is_seen(width):
    """A force of 0.5 N spread over a hair is the point force at its middle, but for its width squared."""
    place, made = 0.0713, rod(0.15, 0.01, 0.008, curvature=8.0)
    peak = 0.5 / (width * np.sqrt(np.pi))
    load = ctr.DistributedLoad(force=lambda s: [peak * np.exp(-(((s - place) / width) ** 2)), 0.0, 0.0])
    spread = ctr.ForwardProblem(made).solve(held(), [load])
    point = ctr.ForwardProblem(made).solve(held(), [ctr.PointWrench(force=[0.5, 0.0, 0.0], arc_length=place)])
    np.testing.assert_allclose(spread.internal_force(0.0), [0.5, 0.0, 0.0], atol=1e-6)
    assert np.linalg.norm(spread.tip_position - point.tip_position) < 20 * width**2 + 2e-7 * 0.15
    assert spread.verify() <= 1e-7 * spread.length


def test_verify_counts_the_force_that_the_steps_missed(monkeypatch):
    """Without break points for it the steps see 0.4999 N of 0.5 N; the distance to the exact shape tells."""
    from ctr_opt.loads import density

    peak, made = 0.5 / (2e-3 * np.sqrt(np.pi)), rod(0.15, 0.01, 0.008)
    load = ctr.DistributedLoad(force=lambda s: [peak * np.exp(-(((s - 0.0713) / 2e-3) ** 2)), 0.0, 0.0])
    exact = ctr.ForwardProblem(made, tolerance=1e-9).solve(held(), [load])
    monkeypatch.setattr(density, "resolve", lambda *_: [])
    missed = ctr.ForwardProblem(made, tolerance=1e-3).solve(held(), [load])
    assert np.linalg.norm(missed.internal_force(0.0) - [0.5, 0.0, 0.0]) > 1e-4
    error = np.linalg.norm(missed.tip_position - exact.tip_position)
    assert missed.verify() == pytest.approx(error, rel=0.01)  # the largest distance is at the tip


def test_coincident_tube_ends_are_one_up_to_rounding():
    """0.3 - 0.1 and 0.25 - 0.05 differ by one unit in the last place; the tip is the innermost tube's all the same."""
    made = robot(tube("a", ctr.Arc(0.3, 5.0)), tube("b", ctr.Arc(0.25, 3.0)))
    shape = ctr.ForwardProblem(made).solve(ctr.Actuation([0.3, 0.9], [-0.1, -0.05]))
    np.testing.assert_array_equal(shape.tip_pose, shape.pose(shape.length, 0))
    assert np.isfinite(shape.torsion(0, shape.length))
    assert np.isfinite(shape.torsion(1, shape.length))


def test_a_failed_continuation_tells_the_last_equilibrium():
    """The turned pair snaps on its way; the last shape before has all but the loads and the actuation asked for."""
    problem = ctr.ForwardProblem(pair(15.0))
    push = [ctr.PointWrench(force=[0.02, 0.0, 0.0])]
    start = problem.solve(ctr.Actuation([0.0, 1.0], [0.0, 0.0]), push)
    failed = problem.solve(ctr.Actuation([0.0, 6.0], [0.0, 0.0]), push, initial=start, throw=False)
    last = failed.last_equilibrium
    assert failed.status is ctr.SolveStatus.FOLD
    assert 0.0 < failed.reached < 1.0
    assert last.actuation.rotations[1] == pytest.approx(1.0 + 5.0 * failed.reached, abs=1e-12)
    assert last.verify() <= 1e-7 * last.length
    assert start.last_equilibrium is None
    np.testing.assert_allclose(last.last_iterate.vector, failed.last_iterate.vector, rtol=1e-3, atol=1e-6)


def test_a_cold_start_that_fails_tells_the_last_equilibrium():
    """A straight column under 1.5 times Euler's load: no path of equilibria leads there without leaving the axis."""
    made, critical = rod(), np.pi**2 / 4 * 0.02 / 0.1**2
    load = [ctr.PointWrench([0.0, 0.0, -1.5 * critical])]
    failed = ctr.ForwardProblem(made, formulation="equilibrium").solve(held(), load, throw=False)
    last = failed.last_equilibrium
    assert failed.status is ctr.SolveStatus.FOLD
    assert failed.reached == pytest.approx(1 / 1.5, abs=1e-2)
    assert -last.loads[0].force[2] == pytest.approx(critical, rel=1e-2)
    np.testing.assert_allclose(last.tip_position, [0.0, 0.0, 0.1], atol=1e-9)
    assert last.verify() <= 1e-7 * last.length


def test_loads_too_strong_for_shooting_are_reached_in_steps():
    """P L^2 / EI = 300 bends the rod at its base alone; known in closed form but for exp(-sqrt(300)) = 3e-8.

    The semi-infinite elastica leaves its clamp with curvature 2 sqrt(P / EI) sin(45 deg), and a rod clamped across the
    force keeps the first integral EI kappa^2 / 2 = P (1 - sin(angle)) that vanishes at the tip.
    """
    EI, L = 0.02, 0.1
    P = 300.0 * EI / L**2
    problem = ctr.ForwardProblem(rod(L, EI), formulation="energy")
    result = problem.solve(held(), [ctr.PointWrench([P, 0.0, 0.0])])
    assert "loads in steps" in result.path
    assert result.stability_checked
    assert result.verify() <= 1e-7 * L
    assert np.linalg.norm(result.curvature(0.0)) == pytest.approx(np.sqrt(2.0 * P / EI), rel=1e-6)
