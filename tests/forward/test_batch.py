"""Chains of rows: what continues a branch is not marked, what snaps is, against folds in closed form."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.special import ellipj

import ctr_opt as ctr
from ctr_opt.native.compile import compiler
from tests.support.physics import held, rod
from tests.support.slow import some_slow

K, L = 0.02, 0.1
needs_compiler = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
by_both = pytest.mark.parametrize("compiled", [pytest.param(True, marks=needs_compiler), False])


def fold(x):
    """The largest relative base angle of two arcs, degrees, before they snap; ``x = L sqrt(lambda)``.

    Their relative angle is ``alpha(s) = pi - 2 asin(k cd(sqrt(lambda) (L - s) | k^2))``, ``k = cos(alpha(L) / 2)``
    (``tests/data/benchmarks.json``, two_tube_torsion); the branch from 0 ends where the base angle has its maximum.
    """

    def base(tip):
        k = np.cos(tip / 2.0)
        _, cn, dn, _ = ellipj(x, k**2)
        return np.pi - 2.0 * np.arcsin(k * cn / dn)

    best = minimize_scalar(lambda tip: -base(tip), bounds=(0.0, np.pi), method="bounded", options={"xatol": 1e-10})
    return np.rad2deg(-best.fun)


def pair(x, **options):
    """Two tubes alike, whose relative angle obeys ``alpha'' = lambda sin(alpha)``, ``lambda = 1.3 k^2``."""
    arc = ctr.Arc(L, x / L / np.sqrt(1.3))
    sizes = {"a": (1e-3, 0.5e-3), "b": (1.6e-3, 1.1e-3)}
    tubes = [ctr.Tube(n, *d, arc, bending_stiffness=K, torsional_stiffness=K / 1.3) for n, d in sizes.items()]
    return ctr.ForwardProblem(ctr.Robot(tubes), **options)


def turned(degrees):
    """Rows of actuations: the outer tube turned."""
    rotations = np.column_stack((np.zeros(len(degrees)), np.deg2rad(degrees)))
    return rotations, np.zeros_like(rotations)


def test_the_folds_are_those_of_the_theory():
    """By two other integrations of the pendulum (degrees): lambda L^2 = 4 and 9."""
    np.testing.assert_allclose([fold(2.0), fold(3.0)], [197.7856142523, 258.8719594576], atol=1e-8)


@by_both
@pytest.mark.parametrize("x", [2.0, 3.0])
@pytest.mark.parametrize("step", some_slow([5.0, 40.0], [40.0]))
def test_the_row_behind_a_fold_alone_is_marked(compiled, x, step):
    """Turned to 400 deg and back: forward at the fold, backward at its mirror image, however long the steps are."""
    degrees, problem = np.arange(0.0, 401.0, step), pair(x, compiled=compiled)
    there, back = problem.solve_many(turned(degrees)), problem.solve_many(turned(degrees[::-1]))
    assert there.converged.all()
    assert back.converged.all()
    np.testing.assert_array_equal(np.flatnonzero(there.snapped), [np.searchsorted(degrees, fold(x))])
    np.testing.assert_array_equal(degrees[::-1][back.snapped], degrees[degrees < 360.0 - fold(x)][-1:])
    relative = [row.tube_angle(1, L) - row.tube_angle(0, L) for row in there]
    jumps = np.flatnonzero(np.diff(np.array(relative) > np.pi)) + 1  # from one side of the opposed tubes to the other
    np.testing.assert_array_equal(jumps, np.flatnonzero(there.snapped))


@by_both
def test_paths_without_snaps_mark_nothing(compiled):
    """In fast steps of 65 deg up to the fold, and both tubes turned at once, which turns the shape as a whole."""
    problem = pair(2.0, compiled=compiled)
    assert not problem.solve_many(turned(np.linspace(0.0, fold(2.0) - 0.5, 4))).snapped.any()
    together = 1.9 * np.arange(6.0)[:, None] + [0.0, 2.0]
    batch = problem.solve_many((together, np.zeros_like(together)))
    assert batch.converged.all()
    assert not batch.snapped.any()


@by_both
def test_whole_turns_are_no_way_past_a_fold(compiled):
    """Newton's method would leap: turned once more, the pair has the same equilibrium with the same Jacobian."""
    problem = pair(2.0, compiled=compiled)
    batch = problem.solve_many(turned([100.0, 460.0, 420.0]))
    assert batch.converged.all()
    assert batch.snapped.tolist() == [False, True, False]
    start = batch[0]
    for degrees in (300.0, 410.0, 640.0, -300.0, -450.0):
        step = problem.solve(ctr.Actuation([0.0, np.deg2rad(100.0 + degrees)], [0.0, 0.0]), initial=start, throw=False)
        assert step.status is ctr.SolveStatus.FOLD
        assert degrees * step.reached == pytest.approx(np.sign(degrees) * fold(2.0) - 100.0, abs=0.1)
    both = 4.0 * np.pi + start.actuation.rotations
    assert problem.solve(ctr.Actuation(both, [0.0, 0.0]), initial=start).path == "newton from initial"
    moments = start.last_iterate
    guess = problem.guess(start.actuation, bending=moments.bending, torsional=moments.torsional)  # on no branch
    once_more = start.actuation.rotations + np.array([0.0, 2.0 * np.pi])
    assert problem.solve(ctr.Actuation(once_more, [0.0, 0.0]), initial=guess).path == "newton from initial"


@by_both
def test_a_growing_load_snaps_once(compiled):
    """A lateral force at the tip of a three-tube robot: its shapes are neighbours but for one leap of 6 cm."""
    given = ctr.load_problem("problems/three_tubes/a4.toml")
    forces = [[ctr.PointWrench([-newton, 0.0, 0.0])] for newton in np.arange(0.0, 0.201, 0.02)]
    batch = ctr.ForwardProblem(given.robot, compiled=compiled).solve_many([given.actuation] * len(forces), forces)
    leaps = np.linalg.norm(np.diff(batch.tip_position, axis=0), axis=1)
    assert batch.snapped.sum() == 1
    np.testing.assert_array_equal(batch.snapped[1:], leaps > 0.05)
    assert np.sort(leaps)[-2] < 0.02


def test_marks_belong_to_chains_and_to_rows_that_follow_an_equilibrium():
    problem, degrees = pair(2.0, compiled=False), [0.0, 150.0, 190.0, 200.0, 220.0]
    batch = problem.solve_many(turned(degrees))
    assert batch.snapped.tolist() == [False, False, False, True, False]
    assert batch[2:].snapped.tolist() == [False, True, False]
    assert batch[::-1].snapped.tolist() == [False, True, False, False, False]
    assert repr(batch[2:]) == "<Batch of 3 equilibria, 0 failed, 1 snapped>"
    alone = problem.solve_many(turned(degrees), initial=batch[1], chained=False)  # some of them are solved cold
    assert alone.converged.all()
    assert not alone.snapped.any()
    beyond = turned([200.0])
    assert problem.solve_many(beyond, initial=batch[2]).snapped.tolist() == [True]
    assert problem.solve_many(beyond).snapped.tolist() == [False]
    guess = problem.guess(ctr.Actuation(*(row[0] for row in beyond)), bending=[1e3, 1e3])  # leads nowhere
    assert problem.solve_many(beyond, initial=guess).snapped.tolist() == [False]


def test_failed_rows_are_not_marked_and_the_next_ones_follow_the_last_equilibrium():
    """By homotopy alone a straight column has no way past Euler's load; unloaded a little, it is where it was."""
    critical = np.pi**2 / 4 * 0.02 / L**2
    loads = [[ctr.PointWrench([0.0, 0.0, -times * critical])] for times in (0.5, 1.5, 0.7)]
    problem = ctr.ForwardProblem(rod(L, 0.02, 0.015), formulation="equilibrium", compiled=False)
    batch = problem.solve_many([held()] * 3, loads)
    assert batch.converged.tolist() == [True, False, True]
    assert batch[2].path == "newton from initial"
    assert not batch.snapped.any()


@pytest.mark.parametrize("options", [{"formulation": "energy"}, {"formulation": "equilibrium", "method": "ipopt"}])
def test_minimization_that_jumps_is_marked(options):
    """IPOPT starts at the shape before and finds the one behind the fold without a word."""
    problem = pair(2.0, compiled=False, **options)
    batch = problem.solve_many(turned([150.0, 180.0, 195.0, 200.0, 230.0]))
    assert batch.converged.all()
    assert batch.snapped.tolist() == [False, False, False, True, False]


def test_a_buckled_column_keeps_its_plane_unmarked():
    """It may lie in any plane: along the family nothing is determined, and nothing snaps."""
    critical, length = np.pi**2 / 4 * 0.02 / 0.2**2, 0.2
    problem = ctr.ForwardProblem(rod(length, 0.02, 0.015), compiled=False)
    loads = [[ctr.PointWrench([0.0, 0.0, -times * critical])] for times in (1.15, 1.2, 1.3, 1.2)]
    assert not problem.solve_many([held()] * 4, loads).snapped.any()


@pytest.mark.parametrize(
    ("actuations", "loads", "message"),
    [
        (None, [], "actuations = None must be a list of Actuations, or a pair of rotations and translations"),
        (ctr.Actuation([0.0], [0.0]), [], "actuations = Actuation.* must be a list of Actuations"),
        (
            [ctr.Actuation([0.0], [0.0])],
            ctr.PointWrench(),
            "loads = PointWrench.* must be a list of loads for all actu",
        ),
        ([ctr.Actuation([0.0], [0.0])], [5], r"loads\[0\] = 5 must be a list of loads"),
        ([ctr.Actuation([0.0], [0.0])], [[5]], r"loads\[0\]\[0\] = 5 must be a load"),
        ([ctr.Actuation([0.0], [0.0])], [[], []], "loads has 2 entries, but there are 1 actuations"),
    ],
)
def test_what_is_no_row_is_refused(actuations, loads, message):
    rod = ctr.Tube("rod", 2e-3, 0.0, ctr.Straight(0.1), bending_stiffness=0.05, torsional_stiffness=0.04)
    with pytest.raises(ctr.DefinitionError, match=message):
        ctr.ForwardProblem(ctr.Robot([rod])).solve_many(actuations, loads)
