"""Which of several equilibria is returned, what is said of its stability, and how a solve fails."""

import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ctr_opt as ctr
from tests.support.physics import held, robot, rod, tube

L, EI, GJ = 0.1, 0.02, 0.015
CRITICAL = np.pi**2 / 4 * EI / L**2  # Euler's load of a cantilever


def opposed(factor, behind=0.0):
    """Two equal tubes turned against each other by pi; ``factor``: lambda over its threshold (pi/2)^2 / L^2."""
    kappa = np.sqrt(factor * (np.pi / 2 / L) ** 2 * GJ / EI)  # lambda = EI/2 kappa^2 * 2/GJ

    def pieces():
        return [*([ctr.Straight(behind)] if behind else []), ctr.Arc(L, [kappa, 0.0, 0.0])]

    made = robot(tube("inner", pieces(), EI, GJ), tube("outer", pieces(), EI, GJ))
    return made, ctr.Actuation([0.0, np.pi], [-behind, -behind])


def twist(result):
    return result.tube_angle(1, L) - result.tube_angle(0, L)


# -- opposed tubes -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [0.3, 0.97])
@pytest.mark.parametrize("formulation", ["automatic", "energy", "equilibrium"])
def test_opposed_tubes_below_the_threshold_stay_straight(factor, formulation):
    made, actuation = opposed(factor)
    result = ctr.ForwardProblem(made, formulation=formulation).solve(actuation)
    np.testing.assert_allclose(result.tip_position, [0.0, 0.0, L], atol=1e-12)
    assert twist(result) == pytest.approx(np.pi, abs=1e-9)
    assert result.determinant > 0.0
    assert result.is_stable
    assert result.unstable_directions == 0


@pytest.mark.parametrize("factor", [1.05, 2.0, 12.0])
@pytest.mark.parametrize("formulation", ["automatic", "energy"])
def test_opposed_tubes_beyond_the_threshold_snap(factor, formulation):
    """The planar shape is a saddle there (from a factor of 9 on with two negative directions); it is not returned."""
    made, actuation = opposed(factor)
    result = ctr.ForwardProblem(made, formulation=formulation).solve(actuation)
    assert abs(twist(result) - np.pi) > 0.1
    assert result.stability_checked
    # The saddle has the energy of both tubes straight.
    kappa = made.tubes[0].precurvature[0].curvature[0]
    assert result.energy < EI * kappa**2 * L * (1.0 - 1e-4)
    # sin((pi - alpha_L) / 2) = k of the elliptic functions: the tip's angle of the first mode, by quadrature.
    assert _base_angle(factor, abs(twist(result) - np.pi)) == pytest.approx(0.0, abs=1e-5)


def _base_angle(factor, beta):
    """``alpha'' = lambda sin(alpha)`` from the free tip, ``alpha = pi - beta``, to the base: ``alpha(0) - pi``."""
    found = solve_ivp(
        lambda _, y: [y[1], -factor * (np.pi / 2) ** 2 * np.sin(y[0])], (0, 1), [beta, 0.0], rtol=1e-11, atol=1e-13
    )
    return found.y[0, -1]


def test_opposed_tubes_with_transmissions_snap_earlier():
    """With l = L the threshold of lambda L^2 is 0.74017388, 0.29998 of the one without."""
    for factor, straight in ((0.29, True), (0.31, False)):
        made, actuation = opposed(factor, behind=L)
        result = ctr.ForwardProblem(made, formulation="energy").solve(actuation)
        assert bool(abs(twist(result) - np.pi) < 1e-6) is straight
        assert result.stability_checked


def test_the_saddle_is_there_and_is_not_called_stable():
    made, actuation = opposed(2.0)
    problem = ctr.ForwardProblem(made)
    saddle = problem.solve(actuation, initial=problem.guess(actuation))
    assert twist(saddle) == pytest.approx(np.pi, abs=1e-12)
    assert saddle.determinant < 0.0
    assert saddle.unstable_directions == 1
    assert saddle.is_stable is False
    assert not saddle.stability_checked
    # The energy formulation leaves it when it starts there.
    left = ctr.ForwardProblem(made, formulation="energy").solve(actuation, initial=saddle)
    assert abs(twist(left) - np.pi) > 0.5
    assert left.stability_checked
    assert left.energy < saddle.energy


@pytest.mark.parametrize("formulation", ["automatic", "energy", "equilibrium"])
def test_aligned_tubes_do_not_move(formulation):
    made, actuation = opposed(12.0)
    actuation = ctr.Actuation([0.4, 0.4], actuation.translations)
    result = ctr.ForwardProblem(made, formulation=formulation).solve(actuation)
    kappa = made.tubes[0].precurvature[0].curvature[0]
    np.testing.assert_allclose(np.linalg.norm(result.curvature([0.0, 0.05]), axis=1), kappa, rtol=1e-9)
    assert twist(result) == pytest.approx(0.0, abs=1e-9)
    assert result.energy == pytest.approx(0.0, abs=1e-12)
    assert result.stability_checked


# -- columns -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("formulation", ["automatic", "energy"])
@pytest.mark.parametrize("factor", [0.5, 0.98, 1.02, 1.5, 5.0])
def test_straight_column_buckles_above_its_critical_load(factor, formulation):
    load = [ctr.PointWrench([0.0, 0.0, -factor * CRITICAL])]
    result = ctr.ForwardProblem(rod(L, EI, GJ), formulation=formulation).solve(held(), load)
    aside = np.hypot(*result.tip_position[:2]) / L
    if factor < 1.0:
        assert aside < 1e-9
        assert result.stability_checked
        return
    assert aside > 0.15
    # It may lie in any plane: neutral, so not called stable.
    assert not result.stability_checked
    assert result.is_stable is False
    assert result.unstable_directions == 0
    straight = L * factor * CRITICAL  # potential of the load at the straight rod
    assert result.potential_energy < straight


def test_precurved_column_has_a_plane_to_buckle_in():
    """A slight curvature breaks the symmetry: the buckled shape is a proper minimum."""
    load = [ctr.PointWrench([0.0, 0.0, -1.3 * CRITICAL])]
    result = ctr.ForwardProblem(rod(L, EI, GJ, [0.3, 0.0, 0.0]), formulation="energy").solve(held(), load)
    assert result.stability_checked
    assert result.tip_position[1] < -0.3 * L
    assert abs(result.tip_position[0]) < 1e-6 * L


# -- what is said ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("loads", "named"),
    [
        ([ctr.PointWrench(moment=[0.0, 0.0, 1e-3])], r"loads\[0\]"),
        ([ctr.PointWrench([1, 0, 0]), ctr.DistributedLoad(moment=[0.0, 1e-3, 0.0])], r"loads\[1\]"),
        ([ctr.PointWrench([1, 0, 0]), ctr.DistributedLoad(moment=lambda s: [0.0, s, 0.0])], r"loads\[1\]"),
        ([ctr.DistributedLoad(moment=([0.0, 0.1], [[0, 0, 0], [0, 0, 1]]))], r"loads\[0\]"),
    ],
    ids=["point", "distributed", "function", "table"],
)
def test_energy_refuses_moments_by_name(loads, named):
    problem = ctr.ForwardProblem(rod(L, EI, GJ), formulation="energy")
    with pytest.raises(ctr.DefinitionError, match=named + ".*moment"):
        problem.solve(held(), loads)
    # The other formulations take them, and stability is not defined.
    result = ctr.ForwardProblem(rod(L, EI, GJ)).solve(held(), loads)
    assert result.converged
    assert not result.stability_checked
    assert result.is_stable is None
    assert result.unstable_directions is None
    assert re.search(r"stable +not defined: " + named + ".*moment.* which has no potential", result.report())


def failing():
    made, actuation = opposed(2.0)
    return ctr.ForwardProblem(made, formulation="equilibrium"), actuation


def test_a_path_through_a_fold_fails_and_says_where():
    problem, actuation = failing()
    result = problem.solve(actuation, throw=False)
    assert not result.converged
    assert result.status is ctr.SolveStatus.FOLD
    # lambda grows with the square of the homotopy's parameter: the threshold lies at 1/sqrt(2).
    assert result.reached == pytest.approx(1 / np.sqrt(2), abs=1e-3)
    assert "fold" in result.message
    assert "homotopy" in result.message
    assert result.status.advice in result.message
    assert "homotopy" in result.path
    assert np.all(np.isfinite(result.last_iterate.vector))
    assert result.last_iterate.torsional.shape == (2,)
    assert not result.stability_checked
    assert result.is_stable is None
    assert result.unstable_directions is None


@pytest.mark.parametrize(
    "of",
    [
        lambda r: r.tip_position,
        lambda r: r.tip_pose,
        lambda r: r.position(0.0),
        lambda r: r.pose(0.0),
        lambda r: r.curvature(0.0),
        lambda r: r.torsion(0, 0.0),
        lambda r: r.tube_angle(0, 0.0),
        lambda r: r.internal_force(0.0),
        lambda r: r.internal_moment(0.0),
        lambda r: r.tube_moment(0, 0.0),
        lambda r: r.energy,
        lambda r: r.load_work,
        lambda r: r.potential_energy,
        lambda r: r.verify(),
        lambda r: r.shape,
    ],
)
def test_a_failed_result_has_no_shape(of):
    problem, actuation = failing()
    result = problem.solve(actuation, throw=False)
    with pytest.raises(ctr.SolveError, match="no shape") as caught:
        of(result)
    assert caught.value.result is result


def test_the_error_carries_the_failed_result():
    problem, actuation = failing()
    with pytest.raises(ctr.SolveError) as caught:
        problem.solve(actuation)
    result = caught.value.result
    assert result.status is ctr.SolveStatus.FOLD
    assert str(caught.value) == result.message
    assert repr(result).startswith("<Equilibrium")


def test_a_failed_result_may_be_started_from():
    problem, actuation = failing()
    failed = problem.solve(actuation, throw=False)
    aside = ctr.Actuation(actuation.rotations - [0.0, 0.5], actuation.translations)
    result = problem.solve(aside, initial=failed)
    assert result.converged
    assert result.verify() < 1e-7 * L


def test_a_guess_is_no_solution():
    made, actuation = opposed(0.5)
    guess = ctr.ForwardProblem(made).guess(actuation)
    assert guess.status is ctr.SolveStatus.GUESS
    assert not guess.converged
    with pytest.raises(ctr.SolveError):
        _ = guess.tip_position


def test_an_unreachable_tolerance_is_reported():
    """Seven halvings of a fourth-order method do not reach 1e-11 on a robot that turns by sixteen radians."""
    made = robot(tube("a", ctr.Arc(0.4, [40.0, 0, 2.0])), tube("b", ctr.Arc(0.4, [36.0, 4.0, 3.0])))
    actuation = ctr.Actuation([0.0, 0.8], [0.0, 0.0])
    result = ctr.ForwardProblem(made, tolerance=1e-11, integrator="RK4").solve(actuation, throw=False)
    assert result.status is ctr.SolveStatus.INACCURATE
    assert "tolerance" in result.message


@pytest.mark.parametrize("part", [0.1, 0.5, 0.9])
def test_stability_of_a_column_is_what_is_left_of_its_critical_load(part):
    """The load lowers the second variation in proportion: the smallest eigenvalue falls from 1 to 0 along a line."""
    column = ctr.ForwardProblem(rod(L, EI, GJ)).solve(held(), [ctr.PointWrench([0.0, 0.0, -part * CRITICAL])])
    assert column.stability == pytest.approx(1.0 - part, abs=2e-3)  # found to 1e-3; the rest is that of the steps


def test_stability_is_zero_where_it_is_lost_and_none_where_it_is_not_defined():
    problem, load = ctr.ForwardProblem(rod(L, EI, GJ)), [ctr.PointWrench([0.0, 0.0, -1.5 * CRITICAL])]
    assert problem.solve(held(), load, initial=problem.guess(held(), load)).stability == 0.0
    assert problem.solve(held(), [ctr.PointWrench(moment=[0.0, 0.01, 0.0])]).stability is None
