"""The solved forward problem as a CasADi function: values, derivatives, sorting, and what it never does: lie."""

import pickle

import casadi as ca
import numpy as np
import pytest

import ctr_opt as ctr
from tests.support.perturbed import loads_for_all
from tests.support.physics import held, random_problem, robot, rod, tube

TWO = robot(
    tube("inner", [ctr.Straight(0.10), ctr.Arc(0.08, 12.0)], 0.01, 0.0075),
    tube("outer", [ctr.Straight(0.04), ctr.Arc(0.06, [3.0, 9.0, 0.0])], 0.03, 0.02),
)
START = ctr.Actuation([0.4, 0.0], [-0.09, -0.025])
LOADS = [ctr.PointWrench([0.1, -0.1, 0.05]), ctr.PointWrench([0.0, 0.2, 0.0], arc_length=0.03, tube=1)]
BOTH = ["rotations", "translations"]


@pytest.fixture(scope="module")
def solved():
    return ctr.ForwardProblem(TWO, tolerance=1e-9).solve(START, LOADS)


@pytest.fixture(scope="module")
def forward(solved):
    return ctr.ForwardProblem(TWO).function(solved, [*BOTH, "loads[0].force"], along=[0.02, 0.5], steps=3)


def called(function, solved, rotations, translations, force=LOADS[0].force, initial=None):
    start = solved.unknowns if initial is None else initial
    found = function(rotations=rotations, translations=translations, loads_0_force=force, initial=start)
    return {name: np.array(value).squeeze() for name, value in found.items()}


def test_names(forward):
    assert forward.name_in() == ["rotations", "translations", "loads_0_force", "initial"]
    assert forward.name_out() == ["tip_position", "tip_rotation", "positions", "unknowns", "residual_norm"]


# Curved pieces begin in front of the entry or behind it, the outer tube ends behind the inner one or in front of it.
@pytest.mark.parametrize("translations", [(-0.09, -0.03), (-0.11, -0.03), (-0.09, -0.05), (-0.02, -0.06), (-0.12, 0.0)])
def test_values_wherever_the_break_points_are(forward, solved, translations):
    other = ctr.ForwardProblem(TWO, tolerance=1e-9).solve(ctr.Actuation([0.9, -0.4], translations), LOADS)
    found = called(forward, solved, [0.9, -0.4], translations, initial=other.unknowns)
    assert found["residual_norm"] < 1e-8
    # steps of RK8 in thirds of the sections
    np.testing.assert_allclose(found["tip_position"], other.tip_position, atol=1e-9)
    np.testing.assert_allclose(found["tip_rotation"], other.tip_pose[:3, :3], atol=1e-8)
    np.testing.assert_allclose(found["positions"][:, 0], other.position(0.02), atol=1e-9)
    np.testing.assert_allclose(found["positions"][:, 1], other.tip_position, atol=1e-9)  # beyond the tip: there
    np.testing.assert_allclose(found["unknowns"], other.unknowns, atol=1e-9)


@pytest.mark.parametrize("seed", [1, 2])
def test_random_robots(seed):
    rng = np.random.default_rng(seed)
    n = 1 + seed
    made, actuation, loads = random_problem(rng, n, load=0.5, pose=True, functions=False, most_loads=3)
    loads = [*loads, *loads_for_all(n), ctr.PotentialLoad(lambda p: 5.0 * ca.sumsqr(p), start=0.01)]
    problem = ctr.ForwardProblem(made, tolerance=1e-9)
    solved = problem.solve(actuation, loads)
    found = problem.function(solved)(
        rotations=actuation.rotations, translations=actuation.translations, initial=solved.unknowns
    )
    # as many steps in every section as the solution needed in any, to its tolerance
    np.testing.assert_allclose(found["tip_position"].full()[:, 0], solved.tip_position, atol=2e-9 * solved.length)


def test_first_and_second_derivatives(forward, solved):
    """Those of the equilibrium itself, which differences have confirmed."""
    q = ca.MX.sym("q", 4)
    tip = forward(rotations=q[:2], translations=q[2:], loads_0_force=LOADS[0].force, initial=solved.unknowns)
    weights = ca.MX.sym("weights", 3)
    combined = ca.dot(weights, tip["tip_position"])
    first = ca.Function("first", [q], [ca.jacobian(tip["tip_position"], q)])
    second = ca.Function("second", [q, weights], [ca.hessian(combined, q)[0]])
    at = np.concatenate((START.rotations, START.translations))
    # the function's mesh is not the equilibrium's: both to 1e-9 of the length
    np.testing.assert_allclose(first(at).full(), solved.jacobian()[:3], atol=1e-7)
    whole = solved.sensitivity("tip_position", BOTH, order=2)
    for k in range(3):
        np.testing.assert_allclose(second(at, np.eye(3)[k]).full(), whole[k], atol=1e-6 * np.abs(whole).max())


def test_derivatives_by_loads_and_of_unknowns(forward, solved):
    force = ca.MX.sym("force", 3)
    arguments = {"rotations": START.rotations, "translations": START.translations, "initial": solved.unknowns}
    found = forward(loads_0_force=force, **arguments)
    slope = ca.Function("slope", [force], [ca.jacobian(found["tip_position"], force)])(LOADS[0].force).full()
    np.testing.assert_allclose(slope, solved.compliance()[:3, :3], atol=1e-8)


@pytest.mark.parametrize(
    ("translations", "what"),
    [
        ((-0.09, -0.08), "the load at 30 mm is beyond the end of the outer tube"),
        ((-0.19, -0.03), "the inner tube is drawn out of the entry point"),
        ((0.01, -0.03), "the base of the inner tube is in front of the entry point"),
    ],
)
def test_what_cannot_be_is_nan(forward, solved, translations, what):
    found = called(forward, solved, [0.4, 0.0], translations)
    for name in ("tip_position", "tip_rotation", "positions", "unknowns"):
        assert np.all(np.isnan(found[name])), what


@pytest.mark.parametrize("initial", [np.full(4, 1e3), np.full(4, np.nan), np.full(4, 1e200)])
def test_no_root_is_nan(forward, solved, initial):
    """Newton's method from absurd moments; CasADi's calls a residual of NaN a success."""
    found = called(forward, solved, [0.4, 0.0], [-0.09, -0.03], initial=initial)
    if not found["residual_norm"] < 1e-8:
        assert np.all(np.isnan(found["tip_position"]))
        assert np.all(np.isnan(found["unknowns"]))
    else:  # a root after all
        assert np.all(np.isfinite(found["tip_position"]))
    if not np.all(np.isfinite(initial)):
        assert np.all(np.isnan(found["tip_position"]))


def steering(forward, solved, x0, objective, **options):
    """The program's solver, its answer and its statistics; ``objective(q, tip) -> (f, g)``, g = 0."""
    q = ca.MX.sym("q", 4)
    tip = forward(rotations=q[:2], translations=q[2:], loads_0_force=LOADS[0].force, initial=solved.unknowns)
    f, g = objective(q, tip["tip_position"])
    quiet = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False, "show_eval_warnings": False}
    solver = ca.nlpsol("steer", "ipopt", {"x": q, "f": f, "g": g}, {**quiet, **options})
    bounds = {"lbx": [-np.inf, -np.inf, -0.15, -0.09], "ubx": [np.inf, np.inf, 0.0, 0.0], "lbg": 0.0, "ubg": 0.0}
    return solver(x0=x0, **bounds)["x"].full()[:, 0], solver.stats()


def test_ipopt_steers_tubes_past_each_other(forward, solved):
    """With the exact Hessian, from one order of the curves' beginnings to another."""
    wanted = ctr.ForwardProblem(TWO, tolerance=1e-9).solve(ctr.Actuation([0.7, 0.3], [-0.112, -0.01]), LOADS)
    x0 = np.concatenate((START.rotations, START.translations))
    units = np.array([1.0, 1.0, 0.02, 0.02])

    def objective(q, tip):
        return ca.sumsqr((q - x0) / units), 100.0 * (tip - wanted.tip_position)

    found, stats = steering(forward, solved, x0, objective)
    assert stats["success"]
    assert stats["iter_count"] < 60
    reached = ctr.ForwardProblem(TWO).solve(ctr.Actuation(found[:2], found[2:]), LOADS, initial=solved)
    # IPOPT's tolerance on a hundred times the distance, and the solve's
    np.testing.assert_allclose(reached.tip_position, wanted.tip_position, atol=1e-7)


def test_ipopt_shortens_steps_that_leave_the_possible(forward, solved):
    """A reward for drawing the outer tube back until its load would be beyond its end."""
    x0 = np.concatenate((START.rotations, START.translations))

    def objective(q, tip):
        return 10.0 * q[3] + ca.sumsqr(q[:3] - x0[:3]) + ca.sumsqr(tip), ca.MX(0, 1)

    found, _ = steering(forward, solved, x0, objective, **{"ipopt.max_iter": 6})
    assert np.all(np.isfinite(found))
    assert -0.07 - 1e-6 <= found[3] < START.translations[1]  # the tube ends at 30 mm where its base is at -70 mm


def test_pickle(forward, solved):
    again = pickle.loads(pickle.dumps(forward))
    one, two = (called(each, solved, [0.5, 0.1], [-0.1, -0.02]) for each in (forward, again))
    np.testing.assert_array_equal(one["tip_position"], two["tip_position"])


def test_counts_may_be_integers_of_numpy(solved):
    assert ctr.ForwardProblem(TWO).function(solved, along=np.array([0.01]), steps=np.int64(3)).n_out() == 5


def test_wrong_input(solved):
    problem = ctr.ForwardProblem(TWO)
    with pytest.raises(ctr.DefinitionError, match="must be an Equilibrium of this problem's robot"):
        ctr.ForwardProblem(rod()).function(solved)
    with pytest.raises(ctr.DefinitionError, match="must be a list of names"):
        problem.function(solved, "rotations")
    with pytest.raises(ctr.DefinitionError, match="is not a parameter"):
        problem.function(solved, ["rotation"])
    with pytest.raises(ctr.DefinitionError, match="steps = 0"):
        problem.function(solved, steps=0)
    with pytest.raises(ctr.DefinitionError, match="steps = True must be a whole number, at least 1"):
        problem.function(solved, steps=True)
    with pytest.raises(ctr.DefinitionError, match=r"along has shape \(\)"):
        problem.function(solved, along=0.05)
    with pytest.raises(ctr.DefinitionError, match="along = None must be numbers"):
        problem.function(solved, along=None)
    wave = ctr.DistributedLoad(lambda s: [np.cos(20.0 * s), 0.0, 0.0])
    waved = problem.solve(START, [wave])
    with pytest.raises(ctr.DefinitionError, match="given as a function of s"):
        problem.function(waved)


def test_precurvature_as_a_matrix():
    """A parameter of rows is an input of rows."""
    made = robot(tube("rod", ctr.PolynomialCurvature(0.1, [[1.0, 5.0, 0.0], [2.0, 3.0, 1.0]])))
    problem = ctr.ForwardProblem(made, tolerance=1e-9)
    solved = problem.solve(held())
    function = problem.function(solved, ["tubes[0].precurvature[0].coefficients"])
    assert function.size_in(0) == (2, 3)
    other = robot(tube("rod", ctr.PolynomialCurvature(0.1, [[2.0, 4.0, 0.5], [1.0, 2.0, 3.0]])))
    found = function(ca.DM([[2.0, 4.0, 0.5], [1.0, 2.0, 3.0]]), solved.unknowns)[0]
    wanted = ctr.ForwardProblem(other, tolerance=1e-9).solve(held()).tip_position
    np.testing.assert_allclose(found.full()[:, 0], wanted, atol=1e-8)
