"""Three-tube robots solved by an independent adaptive integrator; ``data/cases.json`` says how."""

import numpy as np
import pytest

import ctr_opt as ctr
from tests.support.physics import data, robot

CASES = {case["id"]: case for case in data("cases.json")["cases"]}
IDS = ["A1", "A4", "B1"]

# The reference integrates with a relative tolerance of 1e-11 and says so of its cross-check (3e-14 m). Ours is asked
# for 1e-11 of the length; together 1e-11 m.
POSITION = 1e-11
# Angles, frames and torsions come from the same integration: ten digits. u_z(0) ~ 1/m, amplified from the residual.
ANGLE = 1e-10
TORSION = 1e-9
# The package divides moments by max(EI)/length; the determinant of d(m, tau)(tip) / d(m, tau)(0) has no unit, so it
# does not depend on that. The reference differentiates numerically: eight digits.
DETERMINANT = 1e-8


def build(case):
    tubes = [
        ctr.Tube(
            f"tube {i}",
            t["OD"],
            t["ID"],
            [ctr.Straight(t["straight_length"]), ctr.Arc(t["curved_length"], [*t["precurvature"], 0.0])],
            youngs_modulus=t["E"],
            shear_modulus=t["G"],
        )
        for i, t in enumerate(case["tubes"])
    ]
    return robot(*tubes), ctr.Actuation(case["alpha"], case["beta"])


def start_at(problem, actuation, uz):
    """A start at the torsions ``uz`` in the transmissions; no bending moment, as nothing pulls."""
    stiffness = [t.torsional_stiffness for t in problem.robot.tubes]
    return problem.guess(actuation, torsional=np.multiply(uz, stiffness))


@pytest.fixture(scope="module")
def solved():
    """Every case's ``reference`` equilibrium, reached from one percent beside it."""
    results = {}
    for name in IDS:
        made, actuation = build(CASES[name])
        problem = ctr.ForwardProblem(made, tolerance=1e-11)
        uz = 1.01 * np.array(CASES[name]["reference"]["uz_at_base"])
        results[name] = problem.solve(actuation, initial=start_at(problem, actuation, uz))
    return results


@pytest.mark.parametrize("name", IDS)
def test_tip(solved, name):
    expected, result = CASES[name]["reference"], solved[name]
    np.testing.assert_allclose(result.tip_position, expected["tip_position"], atol=POSITION)
    np.testing.assert_allclose(result.tip_pose[:3, :3], expected["tip_R_tube1"], atol=ANGLE)
    assert result.determinant == pytest.approx(expected["det_shooting_jacobian_dead_load"], rel=DETERMINANT)


@pytest.mark.parametrize("name", IDS)
def test_base(solved, name):
    expected, result = CASES[name]["reference"], solved[name]
    for i in range(3):
        assert result.torsion(i, 0.0) == pytest.approx(expected["uz_at_base"][i], abs=TORSION)
        assert result.tube_angle(i, 0.0) == pytest.approx(expected["psi_at_0"][i], abs=ANGLE)
    np.testing.assert_allclose(result.last_iterate.bending, 0.0, atol=1e-12)


@pytest.mark.parametrize("name", IDS)
def test_along_the_backbone(solved, name):
    """Past its own end a tube has no torsion to ask for; the reference carries the last values on to the tip."""
    expected, result = CASES[name]["reference"], solved[name]
    s = np.array(expected["s"])
    np.testing.assert_allclose(result.position(s), expected["backbone"], atol=POSITION)
    ends = np.array([t.length for t in result.robot.tubes]) + result.actuation.translations
    for i in range(3):
        there = s <= ends[i] + 1e-12
        np.testing.assert_allclose(result.torsion(i, s[there]), np.array(expected["uz"])[there, i], atol=TORSION)
        theta = result.tube_angle(i, s[there]) - result.tube_angle(0, s[there])
        np.testing.assert_allclose(theta, np.array(expected["theta"])[there, i], atol=ANGLE)
        at_end = result.tube_angle(i, ends[i]) - result.tube_angle(0, ends[i])
        assert at_end == pytest.approx(expected["theta_tip"][i], abs=ANGLE)
        assert result.torsion(i, ends[i]) == pytest.approx(expected["uz_tip_state"][i], abs=TORSION)


@pytest.mark.parametrize("name", ["A1", "B1"])
@pytest.mark.parametrize(
    "options",
    [{}, {"formulation": "energy"}, {"formulation": "equilibrium", "method": ctr.Newton()}],
    ids=["automatic", "energy", "newton"],
)
def test_every_formulation_finds_the_only_equilibrium(name, options):
    made, actuation = build(CASES[name])
    result = ctr.ForwardProblem(made, **options).solve(actuation)
    error = np.linalg.norm(result.tip_position - CASES[name]["reference"]["tip_position"])
    assert error <= 1e-7 * result.length  # what the default tolerance promises
    assert error <= result.discretization_error + POSITION


# -- three equilibria --------------------------------------------------------------------------------------------------


ALL = CASES["A4"]["all_equilibria_found_30_random_starts"]
STABLE = [found for found in ALL if found["det"] > 0.0]


@pytest.mark.parametrize("expected", ALL, ids=lambda found: f"det {found['det']:.2f}")
def test_each_equilibrium_is_found_from_nearby(expected):
    made, actuation = build(CASES["A4"])
    problem = ctr.ForwardProblem(made, tolerance=1e-11)
    result = problem.solve(actuation, initial=start_at(problem, actuation, 1.02 * np.array(expected["uz_at_base"])))
    np.testing.assert_allclose(result.tip_position, expected["tip_position"], atol=POSITION)
    np.testing.assert_allclose([result.torsion(i, 0.0) for i in range(3)], expected["uz_at_base"], atol=TORSION)
    assert result.determinant == pytest.approx(expected["det"], rel=DETERMINANT)
    assert result.unstable_directions == (0 if expected["det"] > 0.0 else 1)
    assert result.is_stable is (expected["det"] > 0.0)


@pytest.mark.parametrize("formulation", ["automatic", "equilibrium", "energy"])
def test_a_cold_start_ends_at_a_stable_equilibrium(formulation):
    made, actuation = build(CASES["A4"])
    result = ctr.ForwardProblem(made, formulation=formulation).solve(actuation)
    distance = [np.linalg.norm(result.tip_position - found["tip_position"]) for found in STABLE]
    assert min(distance) <= 1e-7 * result.length  # the default tolerance
    assert result.determinant > 0.0
    assert result.is_stable


def test_cold_newton_finds_an_equilibrium_be_it_the_unstable_one():
    made, actuation = build(CASES["A4"])
    problem = ctr.ForwardProblem(made, formulation="equilibrium", method=ctr.Newton())
    result = problem.solve(actuation)
    distance = [np.linalg.norm(result.tip_position - found["tip_position"]) for found in ALL]
    assert min(distance) <= 1e-7 * result.length
    assert result.is_stable is (result.determinant > 0.0)


def test_the_stable_equilibria_have_less_energy_than_the_saddle_between_them():
    made, actuation = build(CASES["A4"])
    problem = ctr.ForwardProblem(made)
    energies = [
        problem.solve(actuation, initial=start_at(problem, actuation, found["uz_at_base"])).potential_energy
        for found in ALL
    ]
    signs = [found["det"] > 0.0 for found in ALL]
    assert max(e for e, stable in zip(energies, signs, strict=True) if stable) < energies[signs.index(False)]
