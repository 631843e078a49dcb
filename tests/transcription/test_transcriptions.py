"""Transcriptions: one answer from all of them, with errors that fall at the order the theory says."""

from itertools import pairwise

import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.layout.configuration import Configuration
from ctr_opt.solvers.ipopt import Ipopt, IpoptSolver
from ctr_opt.solvers.newton import newton
from ctr_opt.transcription.energy import EnergyProblem
from ctr_opt.transcription.equilibrium_program import EquilibriumProblem
from ctr_opt.transcription.shooting import Shooting
from tests.support.physics import random_problem, robot, tube
from tests.support.slow import some_slow

FORCES = [ctr.PointWrench([0.3, 0.5, -0.4]), ctr.DistributedLoad([3.0, -2.0, 1.0], tube=1)]
REST = [
    ctr.PointWrench(moment=[0.01, 0.02, 0.015]),
    ctr.DistributedLoad(moment=[0.05, 0.0, 0.1], tube=1),
    ctr.PointWrench([0.2, 0.0, 0.1], frame="body", arc_length=0.1),
]


def smooth():
    """Two coupled tubes of one smooth piece each."""
    made = robot(
        tube("inner", ctr.PolynomialCurvature(0.2, [[9.0, 2.0, 3.0], [4.0, -6.0, 0.0]]), 0.01, 0.008),
        tube("outer", ctr.PolynomialCurvature(0.2, [[3.0, 7.0, -2.0], [2.0, 0.0, 5.0]]), 0.02, 0.015),
    )
    return made, ctr.Actuation([0.0, 1.2], [0.0, 0.0])


def stepped():
    """Two tubes whose precurvature steps, and which end apart."""
    made = robot(
        tube("inner", [ctr.Straight(0.05), ctr.Arc(0.1, [9, 2, 3.0]), ctr.Arc(0.08, [-3, 4, 0.0])], 0.01, 0.008),
        tube("outer", [ctr.Arc(0.07, [3, 7, -2.0]), ctr.Straight(0.04)], 0.02, 0.015),
    )
    return made, ctr.Actuation([0.0, 1.2], [-0.03, 0.0])


def mesh(configuration, parts):
    """Every section in so many equal steps."""
    edges = [np.linspace(a, b, parts + 1) for a, b in pairwise(configuration.break_points)]
    return np.concatenate([np.column_stack((e[:-1], e[1:])) for e in edges])


def tips(make, loads, transcription, integrator, problem, parts):
    """Errors of the tip over the length on meshes of so many steps a section."""
    made, actuation = make()
    exact = ctr.ForwardProblem(made, tolerance=1e-11).solve(actuation, loads)
    configuration = Configuration(made, actuation, loads)
    errors = []
    for count in parts:
        steps = mesh(configuration, count)
        if problem is Shooting:
            shooting = Shooting(configuration, steps, integrator)
            start = exact.last_iterate.unknowns(configuration.scales, configuration.kind.live)
            solution = newton(shooting, start, 1e-13)
            assert solution.residual_norm < 1e-11
            tip = shooting.sweep(solution.z)[0].tip[:3]
        else:
            program = problem(configuration, steps, transcription, integrator)
            point = IpoptSolver(program.program.nlp, Ipopt()).solve(program.guess(exact.shape), program.parameters)
            assert point.converged
            given = (point.x, point.multipliers) if problem is EnergyProblem else (point.x,)
            tip = program.recover(*given)[0].tip[:3]
        errors.append(np.linalg.norm(tip - exact.tip_position / exact.length))
    return np.array(errors)


CASES = [
    (Shooting, None, "RK4", 4, (2, 4, 8, 16)),
    (Shooting, None, "RK5", 5, (1, 2, 4, 8)),
    (Shooting, None, "RK8", 8, (1, 2)),
    (EquilibriumProblem, ctr.MultipleShooting(), "RK4", 4, (2, 4, 8, 16)),
    (EquilibriumProblem, ctr.MultipleShooting(), "RK5", 5, (1, 2, 4, 8)),
    (EquilibriumProblem, ctr.MultipleShooting(), "RK8", 8, (1, 2)),
    (EnergyProblem, ctr.MultipleShooting(), "RK4", 4, (2, 4, 8, 16)),
    (EnergyProblem, ctr.MultipleShooting(), "RK5", 5, (2, 4, 8)),
    (EnergyProblem, ctr.MultipleShooting(), "RK8", 8, (1, 2, 4)),
    (EnergyProblem, ctr.MultipleShooting(degree=2), "RK8", 4, (2, 4, 8)),
]
for problem in (EquilibriumProblem, EnergyProblem):
    CASES += [(problem, ctr.Collocation(d), "RK8", 2 * d, (2, 4, 8) if d < 4 else (1, 2)) for d in (1, 2, 3, 4)]
    for d in (1, 2, 3, 4):
        CASES += [(problem, ctr.Collocation(d, "radau"), "RK8", 2 * d - 1, (4, 8, 16) if d < 4 else (1, 2, 4, 8))]


QUICK = [  # every scheme once
    (Shooting, None, "RK4", stepped),
    (Shooting, None, "RK5", smooth),
    (Shooting, None, "RK8", stepped),
    (EquilibriumProblem, ctr.MultipleShooting(), "RK4", smooth),
    (EquilibriumProblem, ctr.Collocation(2), "RK8", smooth),
    (EquilibriumProblem, ctr.Collocation(1, "radau"), "RK8", stepped),
    (EnergyProblem, ctr.MultipleShooting(), "RK5", smooth),
    (EnergyProblem, ctr.MultipleShooting(degree=2), "RK8", smooth),
    (EnergyProblem, ctr.Collocation(3), "RK8", stepped),
    (EnergyProblem, ctr.Collocation(4, "radau"), "RK8", smooth),
]
ALL = [(*case, make) for make in (smooth, stepped) for case in CASES]


@pytest.mark.parametrize(
    ("problem", "transcription", "integrator", "order", "parts", "make"),
    some_slow(ALL, [case for case in ALL if (*case[:3], case[-1]) in QUICK]),
    ids=lambda value: getattr(value, "__name__", str(value)),
)
def test_observed_order(problem, transcription, integrator, order, parts, make):
    loads = FORCES if problem is EnergyProblem else FORCES + REST
    errors = tips(make, loads, transcription, integrator, problem, parts)
    errors = errors[errors > 3e-11]  # IPOPT's tolerance is 1e-10, that of the exact answer 1e-11
    assert len(errors) >= 2
    orders = np.log2(errors[:-1] / errors[1:])
    # High orders meet rounding before they meet their limit; better is no fault on the longest steps.
    assert orders[-1] > order - (0.5 if order < 6 else 1.0)
    assert orders[-1] < order + 2.0


def test_a_transcription_says_its_order():
    assert [ctr.Collocation(d).order for d in (1, 3)] == [2, 6]
    assert [ctr.Collocation(d, "radau").order for d in (1, 3)] == [1, 5]


# -- one answer --------------------------------------------------------------------------------------------------------


def largest_error(shape, exact):
    return np.linalg.norm(shape.position(exact.arc_length) - exact.position(exact.arc_length), axis=1).max()


@pytest.mark.parametrize("seed", some_slow(range(6), [0, 1, 4]))
def test_formulations_and_transcriptions_agree(seed):
    rng = np.random.default_rng(300 + seed)
    # Gently bent, so that there is one equilibrium only.
    made, actuation, loads = random_problem(rng, 1 + seed % 4, moments=False, load=0.5)
    automatic = ctr.ForwardProblem(made).solve(actuation, loads)
    for options in (
        {"formulation": "equilibrium"},
        {"formulation": "energy"},
        {"formulation": "energy", "transcription": ctr.Collocation(3, "radau")},
        {"formulation": "energy", "transcription": ctr.MultipleShooting(), "integrator": "RK5"},
        {"formulation": "equilibrium", "transcription": ctr.Collocation()},
        {"formulation": "equilibrium", "transcription": ctr.Collocation(5, "radau")},
        {"formulation": "equilibrium", "transcription": ctr.MultipleShooting()},
        {"integrator": "RK5"},
    ):
        other = ctr.ForwardProblem(made, **options).solve(actuation, loads)
        # Both within 1e-7 of the length.
        assert largest_error(other, automatic) <= 2e-7 * automatic.length
        assert other.energy == pytest.approx(automatic.energy, rel=1e-6)


@pytest.mark.parametrize("transcription", [ctr.MultipleShooting(), ctr.Collocation(4), ctr.Collocation(4, "radau")])
def test_moments_and_body_loads_in_every_transcription(transcription):
    made, actuation = stepped()
    automatic = ctr.ForwardProblem(made).solve(actuation, FORCES + REST)
    problem = ctr.ForwardProblem(made, formulation="equilibrium", transcription=transcription)
    other = problem.solve(actuation, FORCES + REST)
    assert other.path.startswith("homotopy -> ipopt")
    assert largest_error(other, automatic) <= 2e-7 * automatic.length
    assert other.verify() <= 1e-7 * other.length
    moved = problem.solve(ctr.Actuation([0.1, 1.25], [-0.031, 0.0]), FORCES + REST, initial=other)
    assert moved.path.startswith("newton from initial")
    straight = ctr.ForwardProblem(made, method=ctr.Ipopt(start="straight"), formulation="equilibrium")
    assert straight.solve(actuation, FORCES).path.startswith("ipopt")


def test_energy_may_start_from_homotopy():
    made, actuation = stepped()
    result = ctr.ForwardProblem(made, method=ctr.Ipopt(start="homotopy")).solve(actuation, FORCES)
    assert result.path == "homotopy -> energy"
    assert result.stability_checked
    assert result.iterations < 15


def test_a_coarse_scheme_refines_until_it_is_good_enough():
    made, actuation = smooth()
    exact = ctr.ForwardProblem(made, tolerance=1e-11).solve(actuation, FORCES)
    for formulation in ("energy", "equilibrium"):
        for transcription in (ctr.Collocation(1), ctr.Collocation(2, "radau"), ctr.MultipleShooting(degree=1)):
            problem = ctr.ForwardProblem(made, formulation=formulation, transcription=transcription, tolerance=1e-4)
            result = problem.solve(actuation, FORCES)
            assert largest_error(result, exact) <= 1e-4 * exact.length


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"transcription": "radau"}, "transcription = 'radau' must be a Collocation or a MultipleShooting"),
        (
            {"formulation": "equilibrium", "method": "newton", "transcription": ctr.Collocation()},
            "method is Newton, which shoots",
        ),
    ],
)
def test_wrong_combinations_are_reported(options, words):
    with pytest.raises(ctr.DefinitionError, match=words):
        ctr.ForwardProblem(stepped()[0], **options)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ctr.Collocation(0), "Collocation.degree = 0 must be a whole number from 1 to 9"),
        (lambda: ctr.Collocation(3, scheme="gauss"), "Collocation.scheme = 'gauss' must be 'legendre' or 'radau'"),
        (lambda: ctr.MultipleShooting(degree=2.5), "MultipleShooting.degree = 2.5 must be a whole number"),
        (lambda: ctr.Ipopt(start="energy"), "Ipopt.start = 'energy' must be 'straight' or 'homotopy'"),
    ],
)
def test_wrong_transcriptions_are_reported(make, words):
    with pytest.raises(ctr.DefinitionError, match=words):
        make()
