"""Springs to fixed points: against closed forms, an independent boundary-value problem, potentials, differences."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_bvp

import ctr_opt as ctr
from ctr_opt.files.problem import check_file, load_problem
from ctr_opt.layout.configuration import Configuration
from ctr_opt.native.calls import LoadRows
from ctr_opt.native.directions import supported
from tests.support.perturbed import TIGHT, central, changed, pose_vector
from tests.support.physics import held, random_problem, rod
from tests.support.slow import some_slow

EI, LENGTH = 0.02, 0.1


def solved(robot, actuation, loads, **options):
    return ctr.ForwardProblem(robot, tolerance=TIGHT, **options).solve(actuation, loads)


def as_potential(spring):
    """The same spring as a potential that a user writes."""
    anchor, half = ca.DM(spring.anchor), 0.5 * spring.stiffness
    place = {"arc_length": spring.arc_length, "tube": spring.tube}
    return ctr.PotentialLoad(lambda p: half * ca.sumsqr(p - anchor), **place)


def around(rng, shape, stiffness=1.0):
    """Springs on all tubes, two of them at one point, that pull at a robot about as much as its loads do."""
    tubes = shape.configuration.tube_ends
    size = stiffness * EI / shape.length**3
    places = [(None, 0), (None, 0), (0.4 * tubes[-1], len(tubes) - 1)]
    points = [shape.position(tubes[tube] if s is None else s) for s, tube in places]
    sizes = size * rng.uniform(0.5, 2.0, 3)
    return [
        ctr.Spring(float(k), p + 0.2 * shape.length * rng.normal(size=3), s, tube)
        for k, p, (s, tube) in zip(sizes, points, places, strict=True)
    ]


def problem(seed):
    """A random robot with dead loads, and springs."""
    rng = np.random.default_rng(seed)
    made, actuation, loads = random_problem(rng, 1 + seed % 3, pose=seed % 2 == 0, functions=False)
    shape = ctr.ForwardProblem(made).solve(actuation, loads)
    return made, actuation, [*loads, *around(rng, shape)]


# -- against other solutions -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("formulation", ["automatic", "energy", "equilibrium"])
def test_a_cantilever_deflects_as_beam_theory_says(formulation):
    """``w = d k / (k + 3 EI / L^3)`` where the anchor is aside by ``d``; off by the slope squared, ``(d / L)^2``."""
    stiffness, aside = 50.0, 2e-6
    problem = ctr.ForwardProblem(rod(LENGTH, EI), tolerance=1e-9, formulation=formulation)
    shape = problem.solve(held(), [ctr.Spring(stiffness, [aside, 0.0, LENGTH])])
    deflection = aside * stiffness / (stiffness + 3.0 * EI / LENGTH**3)
    np.testing.assert_allclose(shape.tip_position[0], deflection, rtol=1e-6)
    assert shape.is_stable
    energy = 0.5 * stiffness * (aside - deflection) ** 2 + 1.5 * EI / LENGTH**3 * deflection**2
    # the spring's axial stretch counts in the fourth power of d; the elastic energy is known to rounding of EI / L
    np.testing.assert_allclose(shape.potential_energy, energy, rtol=1e-6)


def test_a_cantilever_bends_far_as_an_elastica_does():
    """Against the planar elastica, its tip's force unknown, by SciPy's collocation to 1e-10."""
    stiffness, anchor = 400.0, np.array([0.09, 0.03])

    def rates(s, y, force):
        _, _, angle, moment = y
        across = force[0] * np.cos(angle) - force[1] * np.sin(angle)
        return np.array([np.sin(angle), np.cos(angle), moment / EI, -across])

    def conditions(start, end, force):
        pull = stiffness * (anchor - end[:2])
        return np.array([*start[:3], end[3], *(force - pull)])

    s = np.linspace(0.0, LENGTH, 41)
    guess = np.array([0.5 * s, 0.8 * s, 5.0 * s, np.zeros(41)])
    elastica = solve_bvp(rates, conditions, s, guess, p=np.array([5.0, -5.0]), tol=1e-10, max_nodes=20000)
    assert elastica.success
    shape = solved(rod(LENGTH, EI), held(), [ctr.Spring(stiffness, [anchor[0], 0.0, anchor[1]])])
    assert elastica.y[2, -1] > 1.0  # rad: far from small
    np.testing.assert_allclose(shape.tip_position[[0, 2]], elastica.y[:2, -1], atol=1e-10)
    np.testing.assert_allclose(shape.internal_force(0.0)[[0, 2]], elastica.p, atol=1e-7)


def test_a_stiff_spring_holds_the_tip():
    """With ten thousand times the rod's stiffness the tip is at the anchor, to a thousandth of how far it was drawn."""
    anchor = np.array([0.03, 0.02, 0.09])
    shape = ctr.ForwardProblem(rod(LENGTH, EI)).solve(held(), [ctr.Spring(3e4 * EI / LENGTH**3, anchor)])
    np.testing.assert_allclose(shape.tip_position, anchor, atol=1e-3 * np.linalg.norm(anchor - [0.0, 0.0, LENGTH]))


@pytest.mark.parametrize("seed", some_slow(range(6), [0, 3, 4]))
def test_springs_are_potentials(seed):
    """The same as potentials written out: shapes, energies, stability, forces on actuators, to the solves' accuracy."""
    made, actuation, loads = problem(seed)
    shape = solved(made, actuation, loads)
    written = [as_potential(load) if isinstance(load, ctr.Spring) else load for load in loads]
    other = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, written, initial=shape)
    np.testing.assert_allclose(shape.tip_pose, other.tip_pose, atol=1e-9)
    np.testing.assert_allclose(shape.unknowns, other.unknowns, rtol=1e-7, atol=1e-9 * np.abs(other.unknowns).max())
    for name in ("energy", "load_work", "potential_energy"):
        size = abs(other.energy) + abs(other.load_work)
        np.testing.assert_allclose(getattr(shape, name), getattr(other, name), rtol=0.0, atol=1e-8 * size)
    assert shape.is_stable == other.is_stable
    for tube in range(len(made.tubes)):
        np.testing.assert_allclose(shape.actuator_wrench(tube), other.actuator_wrench(tube), rtol=1e-5, atol=1e-7)


def test_energy_and_equilibrium_agree():
    """Newton's method, minimum energy, and equilibrium in a program, on a robot of three tubes."""
    made, actuation, loads = problem(2)
    loads = [load.conservative_part() for load in loads]
    shape = solved(made, actuation, loads)
    for formulation in ("energy", "equilibrium"):
        other = ctr.ForwardProblem(made, tolerance=1e-10, formulation=formulation).solve(actuation, loads)
        np.testing.assert_allclose(other.tip_pose, shape.tip_pose, atol=1e-8)


# -- derivatives -------------------------------------------------------------------------------------------------------


def test_compliance_is_symmetric():
    made, actuation, loads = problem(1)
    loads = [load.conservative_part() for load in loads]
    compliance = solved(made, actuation, loads).compliance()
    np.testing.assert_allclose(compliance, compliance.T, atol=1e-8 * np.abs(compliance).max())


@pytest.mark.parametrize("seed", some_slow([0, 1, 5], [0]))
def test_derivatives_are_differences(seed):
    """By stiffness, anchor and place, each of every spring, against differences of fourth order."""
    made, actuation, loads = problem(seed)
    shape = solved(made, actuation, loads)
    outputs = {
        "tip_pose": lambda e: pose_vector(e.tip_pose, shape.tip_pose),
        "potential_energy": lambda e: e.potential_energy,
    }
    for k, load in enumerate(loads):
        if not isinstance(load, ctr.Spring):
            continue
        steps = {"stiffness": 1e-3 * load.stiffness, "anchor": 1e-4 * shape.length * np.array([0.6, -0.5, 0.8])}
        if load.arc_length is not None:
            steps["arc_length"] = 1e-4 * shape.length
        for field, step in steps.items():
            name = f"loads[{k}].{field}"

            def value(x, name=name, field=field, step=step, load=load):
                moved = changed(made, actuation, loads, name, getattr(load, field) + x * step)
                other = ctr.ForwardProblem(moved[0], tolerance=TIGHT).solve(*moved[1:], initial=shape)
                return np.concatenate([np.atleast_1d(of(other)) for of in outputs.values()])

            exact = np.concatenate(
                [
                    np.atleast_1d(
                        shape.sensitivity(of, name) @ step if np.ndim(step) else shape.sensitivity(of, name) * step
                    )
                    for of in outputs
                ]
            )
            np.testing.assert_allclose(exact, central(value, 1.0), rtol=1e-4, atol=1e-4 * np.abs(exact).max())


def test_second_derivatives_are_differences_of_first():
    made, actuation, loads = problem(1)
    k = len(loads) - 1
    name, stiffness = f"loads[{k}].stiffness", loads[k].stiffness
    shape = solved(made, actuation, loads)

    def slope(x):
        moved = changed(made, actuation, loads, name, stiffness * (1.0 + x))
        return (
            ctr.ForwardProblem(made, tolerance=TIGHT).solve(*moved[1:], initial=shape).sensitivity("tip_position", name)
        )

    second = shape.sensitivity("tip_position", name, order=2)
    np.testing.assert_allclose(
        second * stiffness, central(slope, 1e-2), rtol=1e-4, atol=1e-4 * np.abs(second).max() * stiffness
    )


def test_the_solved_problem_is_a_function_of_springs():
    robot, spring = rod(LENGTH, EI), ctr.Spring(40.0, [0.03, 0.01, 0.08])
    shape = solved(robot, held(), [spring])
    forward = ctr.ForwardProblem(robot).function(shape, ["loads[0].stiffness", "loads[0].anchor"])
    anchor = np.array([0.02, -0.01, 0.09])
    tip = forward(loads_0_stiffness=60.0, loads_0_anchor=anchor, initial=shape.unknowns)["tip_position"].full()[:, 0]
    other = solved(robot, held(), [ctr.Spring(60.0, anchor)])
    np.testing.assert_allclose(tip, other.tip_position, atol=1e-8)


# -- in other problems -------------------------------------------------------------------------------------------------


def test_from_some_springs_to_others_and_back():
    """Continued from an equilibrium under other springs, which fade while these grow."""
    robot = rod(LENGTH, EI, curvature=4.0)
    few = [ctr.Spring(60.0, [0.03, 0.0, 0.08])]
    many = [ctr.Spring(30.0, [-0.03, 0.01, 0.07]), ctr.Spring(90.0, [0.0, 0.04, 0.06], arc_length=0.06)]
    problem = ctr.ForwardProblem(robot, tolerance=TIGHT)
    first, second = problem.solve(held(), few), problem.solve(held(), many)
    np.testing.assert_allclose(problem.solve(held(), many, initial=first).tip_pose, second.tip_pose, atol=1e-9)
    np.testing.assert_allclose(problem.solve(held(), few, initial=second).tip_pose, first.tip_pose, atol=1e-9)


def test_springs_of_other_numbers_share_their_equations():
    robot = rod(LENGTH, EI)
    kinds = [
        Configuration(robot, held(), loads).kind
        for loads in (
            [ctr.Spring(1.0, [0.0, 0.0, 0.1]), ctr.Spring(2.0, [0.0, 0.1, 0.1])],
            [ctr.Spring(3.0, [0.1, 0.0, 0.1], arc_length=0.05), ctr.Spring(9.0, [0.0, 0.0, 0.3])],
        )
    ]
    assert kinds[0] == kinds[1]
    assert len(kinds[0].fields) == 2


def test_compiled_code_leaves_springs_to_the_general_solver():
    robot, loads = rod(LENGTH, EI), [ctr.Spring(10.0, [0.0, 0.0, 0.1])]
    assert LoadRows.of(robot, loads) is None
    assert not supported("loads[0].stiffness", robot, loads)


def test_a_spring_without_stiffness_is_left_out():
    shape = solved(rod(LENGTH, EI), held(), [ctr.Spring(0.0, [0.0, 0.1, 0.1])])
    np.testing.assert_allclose(shape.tip_position, [0.0, 0.0, LENGTH], rtol=0.0, atol=1e-15)
    with pytest.raises(ctr.DefinitionError, match=r"does not act: stiffness = 0 leaves the spring out"):
        shape.sensitivity("tip_position", "loads[0].stiffness")


def measured(robot, loads, actuation, rng, sigma):
    shape = ctr.ForwardProblem(robot, tolerance=TIGHT).solve(actuation, loads)
    s = np.linspace(0.3, 1.0, 5) * shape.length
    return ctr.PositionMeasurement(s, shape.position(s) + sigma * rng.normal(size=(5, 3)), sigma)


@pytest.mark.parametrize(
    ("name", "truth", "nominal"),
    [
        ("loads[0].stiffness", 40.0, 25.0),
        ("loads[0].anchor", [0.03, 0.01, 0.08], [0.025, 0.0, 0.085]),
        ("experiments[0].loads[0].stiffness", 40.0, 25.0),
    ],
)
def test_a_spring_is_calibrated(name, truth, nominal):
    """From shapes with errors of 20 um under it, within four standard errors; one spring of all, or each its own."""
    rng, sigma, robot = np.random.default_rng(7), 2e-5, rod(LENGTH, EI, curvature=5.0)
    right = {"stiffness": 40.0, "anchor": [0.03, 0.01, 0.08]}
    field = name.rpartition(".")[2]
    wrong = ctr.Spring(**{**right, field: nominal})
    experiments = []
    for k, angle in enumerate([0.0, 1.5, 3.0]):
        actuation = ctr.Actuation([angle], [0.0])
        known = name.startswith("experiments") and k
        data = measured(robot, [ctr.Spring(**right)], actuation, rng, sigma)
        experiments.append(ctr.Experiment(actuation, [ctr.Spring(**right) if known else wrong], data))
    fit = ctr.CalibrationProblem(robot, experiments, [name]).solve()
    apart = (np.atleast_1d(fit.values[name]) - truth) / fit.deviations
    assert np.abs(apart).max() < 4.0
    assert (fit.deviations < 0.1 * np.abs(np.subtract(truth, nominal)).max()).all()
    assert fit.p_value > 1e-3
    assert ("N/m" if field == "stiffness" else "mm") in fit.report()


def test_a_spring_of_all_experiments_must_be_in_all():
    robot = rod(LENGTH, EI)
    data = ctr.PositionMeasurement(None, [0.0, 0.0, LENGTH], 1e-4)
    spring = ctr.Spring(10.0, [0.02, 0.0, 0.1])
    sprung, bare = ctr.Experiment(held(), [spring], data), ctr.Experiment(held(), [], data)
    with pytest.raises(ctr.DefinitionError, match=r"'loads\[0\].stiffness' must be .*; experiments\[1\] has no loads"):
        ctr.CalibrationProblem(robot, [sprung, bare], ["loads[0].stiffness"])
    twice = ["loads[0].stiffness", "experiments[1].loads[0].stiffness"]
    for names in (twice, twice[::-1]):
        with pytest.raises(ctr.DefinitionError, match=r"both set 'loads\[0\].stiffness'"):
            ctr.CalibrationProblem(robot, [sprung, sprung], names)


def test_a_force_is_estimated_beside_a_known_spring():
    rng, sigma, robot = np.random.default_rng(3), 2e-5, rod(LENGTH, EI, curvature=5.0)
    spring, force = ctr.Spring(40.0, [0.03, 0.01, 0.08], arc_length=0.07), np.array([0.3, -0.2, 0.1])
    data = measured(robot, [spring, ctr.PointWrench(force)], held(), rng, sigma)
    found = ctr.ForceEstimationProblem(robot, [ctr.TipForce()]).solve(held(), [data], [spring])
    apart = found.force - force
    assert apart @ np.linalg.solve(found.force_covariance, apart) < 16.3  # 99.9 % of chi-square with 3 degrees
    assert found.p_value > 1e-3


# -- what users see ----------------------------------------------------------------------------------------------------


def test_reports_and_figures_show_springs():
    shape = solved(rod(LENGTH, EI), held(), [ctr.Spring(40.0, [0.03, 0.01, 0.08])])
    assert "Spring at the end of tube 0: stiffness 40 N/m, anchor (30, 10, 80) mm" in shape.report()
    from matplotlib.figure import Figure

    ax = shape.plot(Figure().add_subplot(projection="3d"))
    ends = [np.array(line.get_data_3d())[:, -1] for line in ax.lines]
    assert any(np.allclose(end, [30.0, 10.0, 80.0]) for end in ends)  # mm


TABLE = 'kind = "spring"\nstiffness = "0.5 N/mm"\nanchor = ["30 mm", 0, 0.08]\narc_length = "6 cm"\ntube = "rod"\n'
PROBLEM = """title = "a spring"
robot = "straight_rod.toml"
source.text = "made up"
actuation = { rotations = [0.0], translations = [0.0] }
[[loads]]
"""


def problem_file(folder, table):
    robot = Path("problems/single_rod/straight_rod.toml")
    (folder / "straight_rod.toml").write_text(robot.read_text("utf-8"), "utf-8")
    (folder / "problem.toml").write_text(PROBLEM + table, "utf-8")
    return folder / "problem.toml"


def test_a_spring_is_read_from_a_file(tmp_path):
    path = problem_file(tmp_path, TABLE)
    assert load_problem(path).loads == (ctr.Spring(500.0, [0.03, 0.0, 0.08], arc_length=0.06),)
    assert "Spring on tube 0: stiffness 500 N/m, anchor (30, 0, 80) mm, arc_length 60 mm" in check_file(path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("stiffness", "stifness", r"loads\[0\]: unknown key 'stifness'; did you mean 'stiffness'\?"),
        ('anchor = ["30 mm", 0, 0.08]', "", r"loads\[0\]\.anchor is missing"),
        ("0.5 N/mm", "5 mm", r"loads\[0\]\.stiffness = '5 mm' must be .*like '2 N/m'"),
        ("0.5 N/mm", "-5 N/m", r"loads\[0\]: stiffness = -5 N/m must be a finite number in N/m, at least 0"),
        (", 0.08]", "]", r"loads\[0\]\.anchor has 2 entries, but must have 3"),
        ('"rod"', '"tube"', r"loads\[0\]\.tube = 'tube' must be a tube's name \(rod\) or index"),
        ("6 cm", "6 m", r"loads\[0\]: arc_length = 6 m is beyond the end of tube 0"),
    ],
)
def test_wrong_springs_in_files_are_refused(tmp_path, old, new, words):
    assert old in TABLE
    with pytest.raises(ctr.DefinitionError, match=words):
        load_problem(problem_file(tmp_path, TABLE.replace(old, new)))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"stiffness": -1.0, "anchor": [0, 0, 0]}, "stiffness = -1 N/m must be a finite number in N/m, at least 0"),
        ({"stiffness": 1.0, "anchor": [0, 0]}, r"anchor has shape \(2,\), but must have shape \(3,\)"),
        ({"stiffness": 1.0, "anchor": [0, 0, np.nan]}, r"anchor\[2\] = nan must be a finite number in m"),
        ({"stiffness": 1.0, "anchor": [0, 0, 0], "arc_length": -0.1}, "arc_length = -0.1 m must be"),
        ({"stiffness": 1.0, "anchor": [0, 0, 0], "tube": 0.5}, "tube = 0.5 must be the index of a tube"),
    ],
)
def test_wrong_springs_are_refused(arguments, words):
    with pytest.raises(ctr.DefinitionError, match=words):
        ctr.Spring(**arguments)


@pytest.mark.parametrize(
    ("place", "words"),
    [({"arc_length": 0.2}, "is beyond the end of tube 0"), ({"tube": 1}, r"tube = 1 does not exist")],
)
def test_springs_must_be_on_their_tubes(place, words):
    with pytest.raises(ctr.DefinitionError, match=words):
        ctr.ForwardProblem(rod(LENGTH, EI)).solve(held(), [ctr.Spring(1.0, [0, 0, 0], **place)])
