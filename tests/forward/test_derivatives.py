"""Derivatives of equilibria against central differences of problems solved anew, closed forms, and symmetry."""

import attrs
import casadi as ca
import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.robot.names import parameters
from tests.support.perturbed import TIGHT, central, changed, loads_for_all, one_sided, pose_vector
from tests.support.physics import held, random_problem, robot, rod, tube
from tests.support.slow import some_slow

EI, GJ, L = 0.02, 0.015, 0.1
RELATIVE = 1e-6
# Steps of the differences: the formulas are of fourth order, and the solves good to about 1e-12 m, so that both errors
# stay below 1e-7 of derivatives of order one with a thousandth of what the parameter does something with.
STEPS = {"rotations": 1e-3, "base.rotation": 1e-3, "curvature": 3e-2, "coefficients": 3e-2}
LENGTHS = ("translations", "length", "arc_length", "start", "end")


def step(name, value):
    field = name.rpartition(".")[2]
    if field in LENGTHS:
        return 1e-5
    if name in STEPS or field in STEPS:
        return STEPS.get(name, STEPS.get(field))
    return 1e-3 * max(float(np.abs(value).max()), 1e-3)


def problem_of(seed, live=True):
    rng = np.random.default_rng(seed)
    n = 1 + seed % 4
    made, actuation, loads = random_problem(rng, n, load=0.5, pose=True, functions=False, most_loads=3)
    made = attrs.evolve(made, tubes=[attrs.evolve(each, density=6450.0) for each in made.tubes])
    # where a table begins with its load, the derivative by that place has two sides
    loads = [
        attrs.evolve(load, start=load.start + 1e-3, end=load.end - 1e-3)
        if isinstance(load, ctr.DistributedLoad) and not isinstance(load.force, np.ndarray)
        else load
        for load in loads
    ]
    return rng, n, made, actuation, [*loads, *(loads_for_all(n) if live else [])]


def solver(solved, made, actuation, loads):
    def at(name, value):
        one, two, three = changed(made, actuation, loads, name, value)
        return ctr.ForwardProblem(one, tolerance=TIGHT).solve(two, three, initial=solved)

    return at


def close(found, wanted, scale):
    """To a relative 1e-6 of the largest entry, or of what the output changes by over ``scale``."""
    found, wanted = np.asarray(found), np.asarray(wanted)
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=RELATIVE * max(np.abs(wanted).max(), scale))


@pytest.mark.parametrize("seed", [1, 2])
def test_jacobian_against_differences(seed):
    """Along random directions of all rotations and all translations."""
    rng, n, made, actuation, loads = problem_of(seed)
    solved = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, loads)
    at, s = solver(solved, made, actuation, loads), 0.6 * solved.length
    reference, tip_reference = solved.pose(s), solved.tip_pose
    both = np.vstack((solved.jacobian(), solved.jacobian(s)))
    assert solved.kinks == ()
    for k, name in enumerate(("rotations", "translations")):
        value, direction = np.array(getattr(actuation, name)), rng.uniform(-1.0, 1.0, n)

        def values(x, name=name, value=value, direction=direction):
            other = at(name, value + x * direction)
            return np.concatenate((pose_vector(other.tip_pose, tip_reference), pose_vector(other.pose(s), reference)))

        close(both[:, k * n : (k + 1) * n] @ direction, central(values, step(name, value)), 1e-3)


OUTPUTS = ("tip_pose", "energy", "load_work", "position", "pose", "curvature", "internal_force", "internal_moment")
BY_TUBE = ("torsion", "tube_angle", "tube_moment")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4])
def test_sensitivity_of_everything_by_every_parameter(seed):
    """Along a random direction of the numbers of each group of parameters."""
    rng, n, made, actuation, loads = problem_of(seed)
    solved = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, loads)
    i = n - 1
    s = 0.4 * solved.configuration.tube_ends[i]
    given = [p for p in parameters(made, actuation, loads).values() if not p.idle]
    known = {p.name: p.value for p in given if not p.name.endswith("stiffness")}
    of = [name if name in solved.__dir__() and name in OUTPUTS[:3] else (name, s) for name in OUTPUTS]
    of += [(name, i, s) for name in BY_TUBE] + [("actuator_wrench", i)]
    exact = [solved.sensitivity(each, list(known)).reshape(-1, sum(v.size for v in known.values())) for each in of]
    references = {"tip_pose": solved.tip_pose, "pose": solved.pose(s)}

    def value(result, each):
        name, arguments = (each, ()) if isinstance(each, str) else (each[0], each[1:])
        found = getattr(result, name)
        found = found(*arguments) if arguments else found
        return pose_vector(found, references[name]) if name in references else np.atleast_1d(found)

    sizes = np.cumsum([len(rows) for rows in exact])[:-1]
    nominal = np.split(np.concatenate([value(solved, each) for each in of]), sizes)
    ends = np.cumsum([v.size for v in known.values()])
    groups = {}
    for (name, v), end in zip(known.items(), ends, strict=True):
        direction = step(name, v) * rng.uniform(-1.0, 1.0, v.shape)
        groups.setdefault(group_of(name), []).append((name, v, direction, slice(end - v.size, end)))
    assert len(groups) == 7
    for group, members in groups.items():

        def values(x, members=members):
            problem = made, actuation, loads
            for name, v, direction, _ in members:
                problem = changed(*problem, name, v + x * direction)
            other = ctr.ForwardProblem(problem[0], tolerance=TIGHT).solve(*problem[1:], initial=solved)
            return np.concatenate([value(other, each) for each in of])

        differences = np.split(central(values, 1.0), sizes)
        for each, rows, difference, now in zip(of, exact, differences, nominal, strict=True):
            found = sum(rows[:, part] @ direction.ravel() for _, _, direction, part in members)
            # differences cannot tell changes below the error of the solves, 1e-11 of the output
            floor = 1e-11 * max(np.abs(now).max(), 1e-3) / RELATIVE
            try:
                close(found, difference, floor)
            except AssertionError as error:
                raise AssertionError(f"{each} by {group}: {error}") from None


def group_of(name):
    """Parameters that are changed together."""
    field = name.rpartition(".")[2]
    if name.startswith("base") or name == "rotations":
        return "rotations"
    if name.startswith("loads"):
        return "load places" if field in LENGTHS else "loads"
    if field in LENGTHS:
        return "translations" if field == "translations" else "lengths"
    return "preset curvature" if field in STEPS else "sections"


@pytest.mark.parametrize("name", ["tubes[0].bending_stiffness", "tubes[1].torsional_stiffness"])
def test_stiffnesses_in_the_place_of_moduli(name):
    _, _, made, actuation, loads = problem_of(9)
    solved = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, loads)
    at = solver(solved, made, actuation, loads)
    value = parameters(made, actuation, loads)[name].value
    difference = central(lambda x: at(name, value * (1.0 + x)).tip_position, 1e-3) / value
    close(solved.sensitivity("tip_position", name), difference, 0.0)


def expression_loads():
    pull = ctr.ExpressionLoad(
        lambda s, p, R: (3.0 * R[:, 2] * ca.cos(20.0 * s) - p, [0.01 * p[1], 0, 0.01]), start=0.01
    )
    spring = ctr.PotentialLoad(lambda p: 20.0 * ca.sumsqr(p - ca.DM([0.02, 0.05, 0.1])), arc_length=0.05, factor=1.5)
    return [pull, spring, ctr.PotentialLoad(lambda p: 5.0 * p[0] ** 4 + p[1] ** 2, start=0.0)]


@pytest.mark.parametrize(
    "name",
    some_slow(
        ["translations", "loads[0].start", "loads[1].arc_length", "loads[1].factor", "base.rotation"],
        ["loads[0].start", "loads[1].arc_length"],
    ),
)
def test_loads_by_expressions(name):
    made = robot(tube("inner", [ctr.Straight(0.1), ctr.Arc(0.1, 6.0)]), tube("outer", ctr.Arc(0.12, [4.0, 1.0, 0.5])))
    actuation, loads = ctr.Actuation([0.3, 1.0], [-0.08, -0.03]), expression_loads()
    solved = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, loads)
    at = solver(solved, made, actuation, loads)
    value = parameters(made, actuation, loads)[name].value
    direction = np.ones(value.shape)

    def values(x):
        other = at(name, value + x * direction)
        return np.concatenate((other.tip_position, [other.energy, other.load_work]))

    found = np.vstack([solved.sensitivity(of, name).reshape(-1, value.size) for of in ("tip_position", "energy")])
    found = np.vstack((found, solved.sensitivity("load_work", name).reshape(1, -1))) @ direction.ravel()
    close(found, central(values, step(name, value)), 1e-4)


# -- closed forms ------------------------------------------------------------------------------------------------------


def test_straight_rod_at_zero_load():
    """To ten digits: the linear bending and twist of a cantilever."""
    solved = ctr.ForwardProblem(rod()).solve(held())
    wanted = np.diag([L**3 / (3 * EI)] * 2 + [0.0] + [L / EI] * 2 + [L / GJ])
    wanted[0, 4] = wanted[4, 0] = L**2 / (2 * EI)
    wanted[1, 3] = wanted[3, 1] = -(L**2) / (2 * EI)
    np.testing.assert_allclose(solved.compliance(), wanted, rtol=1e-10, atol=1e-14)
    np.testing.assert_allclose(solved.compliance(s=0.5 * L)[3, 3], 0.5 * L / EI, rtol=1e-10)


def test_an_arc_by_castigliano():
    """A circular arc bent in x-z, loaded at its tip, in and out of its plane, to ten digits."""
    a, radius = 1.2, 0.08
    length = a * radius
    parts = [ctr.Arc(length / 8, [0.0, 1.0 / radius, 0.0])] * 8  # steps so short that they cost no digit
    solved = ctr.ForwardProblem(robot(tube("arc", parts)), tolerance=TIGHT).solve(held())
    # the centre line r(t) = R (1 - cos t, 0, sin t), tangent (sin t, 0, cos t); moments of unit loads at t = a
    t, w = np.polynomial.legendre.leggauss(40)  # of the trigonometric integrals, exact to rounding
    t, w = 0.5 * a * (t + 1.0), 0.5 * a * w

    def place(x):
        return radius * np.array([1.0 - np.cos(x), 0.0 * x, np.sin(x)])

    wanted = np.zeros((6, 6))
    for x, weight in zip(t, w, strict=True):
        frame = np.array([[np.cos(x), 0.0, np.sin(x)], [0.0, 1.0, 0.0], [-np.sin(x), 0.0, np.cos(x)]])
        arm = place(a) - place(x)
        hat = np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]])
        moments = frame.T @ np.hstack((hat, np.eye(3)))  # own axes: bending, bending, twist
        wanted += weight * radius * moments.T @ np.diag([1 / EI, 1 / EI, 1 / GJ]) @ moments
    found = solved.compliance()
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-10 * np.abs(wanted).max())
    # in closed form: in the plane by a force along x, and out of it by one along y
    in_plane = a * np.sin(a) ** 2 - 2 * np.sin(a) * (1 - np.cos(a)) + a / 2 - np.sin(2 * a) / 4
    np.testing.assert_allclose(found[0, 0], radius**3 * in_plane / EI, rtol=1e-10)
    bend = a / 2 - np.sin(2 * a) / 4
    twist = 3 * a / 2 - 2 * np.sin(a) + np.sin(2 * a) / 4
    np.testing.assert_allclose(found[1, 1], radius**3 * (bend / EI + twist / GJ), rtol=1e-10)


# -- symmetry ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", some_slow([1, 2], [1]))
def test_compliance_is_symmetric_under_conservative_loads(seed):
    rng = np.random.default_rng(seed)
    n = 1 + seed % 4
    made, actuation, loads = random_problem(rng, n, moments=False, load=0.5, functions=False)
    loads = [*loads, *loads_for_all(n)[:3], ctr.PotentialLoad(lambda p: 5.0 * ca.sumsqr(p), start=0.0)]
    solved = ctr.ForwardProblem(made, tolerance=1e-10).solve(actuation, loads)
    places = [(0.5 * end, i) for i, end in enumerate(solved.configuration.tube_ends)]
    longest = int(np.argmax(solved.configuration.tube_ends))
    for found in [solved.compliance(tube=longest), *(solved.compliance(s, s, i) for s, i in places)]:
        # exact but for the discretization, 1e-10 of the length, and its amplification
        np.testing.assert_allclose(found, found.T, rtol=0.0, atol=1e-8 * np.abs(found).max())


def test_a_dead_moment_makes_compliance_unsymmetric_by_itself():
    made = robot(tube("inner", [ctr.Straight(0.1), ctr.Arc(0.1, 6.0)]), tube("outer", ctr.Arc(0.12, [4.0, 1.0, 0.5])))
    moment = np.array([0.03, -0.02, 0.025])
    loads = [ctr.PointWrench([0.1, 0.2, -0.1], moment), ctr.PointWrench([0.2, 0.0, 0.1], arc_length=0.05)]
    solved = ctr.ForwardProblem(made, tolerance=1e-10).solve(ctr.Actuation([0.3, 1.0], [-0.08, -0.03]), loads)
    inverse = np.linalg.inv(solved.compliance())
    wanted = np.zeros((6, 6))
    x, y, z = moment
    wanted[3:, 3:] = -np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # the inverse loses what the compliance's condition takes
    np.testing.assert_allclose(inverse - inverse.T, wanted, rtol=0.0, atol=1e-8 * np.abs(inverse).max())


def test_compliance_of_an_outer_tube_against_differences():
    _, n, made, actuation, loads = problem_of(6)
    solved = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, loads)
    i, s = n - 1, 0.5 * solved.configuration.tube_ends[n - 1]
    found, reference = solved.compliance(s, tube=i), solved.pose(s, i)
    for k in range(6):
        unit = np.eye(6)[k]

        def values(x, unit=unit):
            added = ctr.PointWrench(x * unit[:3], x * unit[3:], tube=i)
            other = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, [*loads, added], initial=solved)
            return pose_vector(other.pose(s, i), reference)

        close(found[:, k], central(values, 3e-3 if k < 3 else 3e-4), 1e-4)


# -- kinks -------------------------------------------------------------------------------------------------------------


def flush():
    """Two tubes that end together, the outer one's curved part beginning at the entry point."""
    inner = tube("inner", [ctr.Straight(0.10), ctr.Arc(0.10, 12.0)], 0.01, 0.0075)
    outer = tube("outer", [ctr.Straight(0.04), ctr.Arc(0.10, [3.0, 9.0, 0.0])], 0.03, 0.02)
    return robot(inner, outer), ctr.Actuation([0.4, 0.0], [-0.10, -0.04])


@pytest.mark.parametrize("side", [1, -1])
def test_one_sided_derivatives_where_break_points_meet(side):
    made, actuation = flush()
    loads = [ctr.PointWrench([0.1, -0.1, 0.05])]
    solved = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, loads)
    assert solved.kinks == (0, 1)
    at, found = solver(solved, made, actuation, loads), solved.jacobian(side=side)
    middle = solved.jacobian(0.05, side=side)
    for i in range(2):

        def values(x, i=i):
            other = at("translations", actuation.translations + x * np.eye(2)[i])
            return np.concatenate((other.tip_position, other.position(0.05), other.tip_pose[:3, 2]))

        difference = one_sided(values, side * 2e-5)
        turning = np.cross(found[3:, 2 + i], solved.tip_pose[:3, 2])  # of the tangent, whichever tube's the frame is
        close(np.concatenate((found[:3, 2 + i], middle[:3, 2 + i], turning)), difference, 1e-2)


def random_kinks(seed):
    """A robot of pieces, translations and loads in whole centimetres, so that break points often meet."""
    rng = np.random.default_rng(seed)
    n, tubes = 1 + seed % 3, []
    for i in range(n):
        pieces = []
        for _ in range(rng.integers(1, 4)):
            length, u = 0.01 * rng.integers(2, 6), rng.normal(size=3) * [8.0, 8.0, 2.0]
            pieces.append(
                [ctr.Straight(length), ctr.Arc(length, u), ctr.PolynomialCurvature(length, [u, -u])][rng.integers(3)]
            )
        tubes.append(tube(f"tube {i}", pieces, 0.01 * (i + 1), 0.008 * (i + 1)))
    beta = np.array([-0.01 * rng.integers(1, round(each.length / 0.01)) for each in tubes])
    loads = [ctr.PointWrench(rng.normal(size=3) * 0.3, rng.normal(size=3) * 0.01, 0.01, 0, frame="body")]
    loads.append(ctr.DistributedLoad(rng.normal(size=3), rng.normal(size=3) * 0.1, 0.0, None, n - 1))
    if tubes[0].length + beta[0] < 0.015:  # a load at the tube's very end stays there
        loads = loads[1:]
    return n, robot(*tubes), ctr.Actuation(rng.uniform(-2.0, 2.0, n), beta), loads


@pytest.mark.parametrize("seed", some_slow([1, 2, 5], [1]))
def test_kinks_of_random_robots(seed):
    n, made, actuation, loads = random_kinks(seed)
    solved = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, loads)
    at = solver(solved, made, actuation, loads)
    s, i = 0.53 * solved.length, seed % n
    both = {}
    for side in (1, -1):

        def values(x):
            other = at("translations", actuation.translations + x * np.eye(n)[i])
            return np.concatenate((other.tip_position, other.position(s)))

        both[side] = one_sided(values, side * 2e-5)
        found = np.concatenate([solved.jacobian(where, side)[:3, n + i] for where in (None, s)])
        close(found, both[side], 1e-2)
    apart = np.abs(both[1] - both[-1]).max() > 1e-6 * np.abs(both[1]).max()
    assert (i in solved.kinks) == apart


def test_the_two_sides_may_differ_by_a_factor():
    """A stiff sheath around a curved wire whose ends are flush: an advancing wire leads the tip alone."""
    made, actuation = flush()
    solved = ctr.ForwardProblem(made).solve(actuation)
    ahead, back = solved.jacobian(side=1), solved.jacobian(side=-1)
    assert np.linalg.norm(ahead[:3, 2]) > 4.0 * np.linalg.norm(back[:3, 2])
    np.testing.assert_allclose(ahead[:, :2], back[:, :2], atol=1e-14)  # rotations move no break point


def test_a_base_at_the_entry_is_drawn_back_alone():
    made = rod(curvature=8.0)
    solved = ctr.ForwardProblem(made, tolerance=TIGHT).solve(held())
    assert solved.kinks == ()
    np.testing.assert_array_equal(solved.jacobian(side=1), solved.jacobian(side=-1))
    at = solver(solved, made, held(), [])
    difference = one_sided(lambda x: at("translations", np.array([x])).tip_position, -1e-4)
    close(solved.jacobian()[:3, 1], difference, 0.0)


def test_break_points_that_meet_without_consequence_are_no_kinks():
    """The end of a straight piece in front of a straight one at the entry point."""
    made = robot(tube("rod", [ctr.Straight(0.05), ctr.Straight(0.05), ctr.Arc(0.05, 5.0)]))
    assert ctr.ForwardProblem(made).solve(ctr.Actuation([0.0], [-0.05])).kinks == ()


def test_side_of_a_load_that_meets_a_tube_end():
    made = robot(tube("inner", ctr.Arc(0.15, 6.0)), tube("outer", ctr.Arc(0.08, [0.0, 5.0, 0.0])))
    actuation = ctr.Actuation([0.2, 0.0], [-0.01, -0.02])
    loads = [ctr.PointWrench([0.3, 0.1, 0.0], [0.02, 0.0, 0.01], arc_length=0.06)]
    solved = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, loads)
    at = solver(solved, made, actuation, loads)
    for side in (1, -1):
        difference = one_sided(lambda x: at("loads[0].arc_length", 0.06 + x).tip_position, side * 2e-5)
        close(solved.sensitivity("tip_position", "loads[0].arc_length", side=side), difference, 1e-3)


# -- second derivatives ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("of", some_slow(["tip_pose", "energy"], ["tip_pose"]))
def test_second_derivatives(of):
    _, n, made, actuation, loads = problem_of(1)
    solved = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, loads)
    at, wrt = solver(solved, made, actuation, loads), ["rotations", "translations"]
    second = solved.sensitivity(of, wrt, order=2)
    np.testing.assert_allclose(second, np.swapaxes(second, -1, -2), rtol=0.0, atol=1e-9 * np.abs(second).max())
    rows = slice(0, 3) if of == "tip_pose" else slice(None)  # angular velocities turn with the pose themselves
    turned, moved = np.array([1.0, -0.6]), np.array([0.5, 1.0])
    for name, direction in (("rotations", turned), ("translations", moved)):
        value = np.array(getattr(actuation, name))

        def values(x, name=name, value=value, direction=direction):
            return at(name, value + x * direction).sensitivity(of, wrt)[rows]

        part = slice(0, n) if name == "rotations" else slice(n, 2 * n)
        close(second[rows][..., part] @ direction, central(values, step(name, value)), np.abs(second).max())


def test_second_derivatives_of_a_rotation():
    """Of the rotation vector from the pose as it is, by second differences of poses."""
    _, _, made, actuation, loads = problem_of(1)
    solved = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, loads)
    at, direction, h = solver(solved, made, actuation, loads), np.array([1.0, 0.4]), 2e-3
    second = np.einsum("aij,i,j", solved.sensitivity("tip_pose", "rotations", order=2), direction, direction)

    def turned(x):
        return pose_vector(at("rotations", actuation.rotations + x * direction).tip_pose, solved.tip_pose)

    near, far, now = turned(h) + turned(-h), turned(2 * h) + turned(-2 * h), turned(0.0)
    difference = (16.0 * near - far - 30.0 * now) / (12.0 * h**2)
    # solves to 1e-12 m over the square of the step
    np.testing.assert_allclose(second, difference, atol=2e-6 * max(1.0, np.abs(second).max()))


# -- input -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def simple():
    made = robot(tube("inner", [ctr.Straight(0.1), ctr.Arc(0.1, 6.0)]), tube("outer", ctr.Arc(0.12, 4.0)))
    wave = ctr.DistributedLoad(lambda s: [np.cos(20.0 * s), 0.0, 0.0])
    return ctr.ForwardProblem(made).solve(
        ctr.Actuation([0.3, 1.0], [-0.08, -0.03]), [ctr.PointWrench([0.1, 0, 0]), wave]
    )


@pytest.mark.parametrize(
    ("of", "wrt", "message"),
    [
        ("tip", "rotations", "of = 'tip' is not an output; allowed are 'tip_position', 'tip_pose'"),
        (("torsion", 0), "rotations", "not an output"),
        (("torsion", 2, 0.1), "rotations", "index of a tube from 0 to 1"),
        (("position", 0.2), "rotations", "s = 0.2 m must be a finite number in m, at least 0 and at most 0.12"),
        ("energy", "rotation", "wrt = 'rotation' is not a parameter (did you mean 'rotations'"),
        ("energy", "tubes[0].youngs_modulus", "does not act: youngs_modulus is not given"),
        ("energy", "tubes[0].outer_diameter", "does not act: the stiffnesses are given"),
        ("energy", "tubes[0].density", "does not act: there is no Gravity"),
        ("energy", "loads[0].arc_length", "does not act: arc_length is not given"),
        ("energy", "loads[1].force", "does not act: it is a function"),
        ("energy", ["rotations", "rotations"], "twice"),
        ("energy", "translations", "a load is given as a function of s"),
    ],
)
def test_wrong_names_are_reported(simple, of, wrt, message):
    with pytest.raises(ctr.DefinitionError) as error:
        simple.sensitivity(of, wrt)
    assert message in str(error.value)


def test_other_wrong_input(simple):
    with pytest.raises(ctr.DefinitionError, match="side = 0 must be 1 or -1"):
        simple.jacobian(side=0)
    with pytest.raises(ctr.DefinitionError, match="side = 5 must be 1 or -1"):
        simple.actuator_wrench(0, side=5)
    with pytest.raises(ctr.DefinitionError, match="order = 3 must be 1 or 2"):
        simple.sensitivity("energy", "rotations", order=3)
    made, actuation = flush()
    with pytest.raises(ctr.DefinitionError, match="second derivatives do not exist"):
        ctr.ForwardProblem(made).solve(actuation).sensitivity("energy", "translations", order=2)
    failed = ctr.ForwardProblem(made).guess(actuation)
    with pytest.raises(ctr.SolveError):
        failed.jacobian()


def test_a_load_given_as_a_function_is_a_constant_where_nothing_moves(simple):
    made, actuation, loads = simple.robot, simple.actuation, simple.loads
    at = solver(simple, made, actuation, loads)
    difference = central(lambda x: at("rotations", actuation.rotations + np.array([x, 0.0])).tip_position, 1e-3)
    close(simple.sensitivity("tip_position", "rotations")[:, 0], difference, 0.0)


def test_a_singular_equilibrium_has_no_derivatives():
    """A straight column at its buckling load."""
    made = rod()
    load = ctr.PointWrench([0.0, 0.0, -((np.pi / 2) ** 2) * EI / L**2])
    solved = ctr.ForwardProblem(made, method=ctr.Newton()).solve(held(), [load])
    with pytest.raises(ctr.SolveError, match="singular"):
        solved.jacobian()


def test_a_modulus_and_its_stiffness_exclude_each_other():
    made = robot(ctr.Tube("wire", 1e-3, 0.0, ctr.Arc(0.1, 5.0), youngs_modulus=60e9, poisson_ratio=0.3))
    solved = ctr.ForwardProblem(made).solve(held())
    with pytest.raises(ctr.DefinitionError, match="choose one of them"):
        solved.sensitivity("energy", ["tubes[0].bending_stiffness", "tubes[0].youngs_modulus"])
