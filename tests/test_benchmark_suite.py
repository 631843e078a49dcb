"""The benchmarks run and tell the truth: their reference solver has the digits, and so has all that they time."""

import re

import numpy as np
import pytest

import ctr_opt as ctr
from benchmarks import against, reference
from benchmarks.__main__ import MODES, REFERENCES, main
from benchmarks.work import nested, plain, three_tubes
from tests.support.physics import data

RATES = [reference.printed, reference.expanded]
CASES = {case["id"]: case for case in data("cases.json")["cases"]}
UNLOADED = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
BOUND = 1e-5  # mm


def solved(name, rtol, rates=reference.printed):
    """A case, from nothing, by the reference solver."""
    case, given = CASES[name], three_tubes(name[0], "none", 0)
    return reference.solve(given.reference[0], (case["alpha"], case["beta"]), UNLOADED, None, rates, rtol)


def apart(tip, expected):
    return 1e3 * np.linalg.norm(tip - np.asarray(expected))


@pytest.mark.parametrize("rates", RATES)
@pytest.mark.parametrize("name", ["A1", "B1"])
def test_the_reference_solver_finds_the_tips_of_the_cases(name, rates):
    expected = CASES[name]["reference"]["tip_position"]
    assert apart(solved(name, reference.RTOL, rates).tip_position, expected) < BOUND
    # At a tolerance of 1e-10 what Newton's method may leave, 3e-12 EI / length, moves the tip by some 1e-12 lengths.
    assert apart(solved(name, 1e-10, rates).tip_position, expected) < 1e-8


def test_the_reference_solver_ends_at_a_stable_branch():
    measured = CASES["A4"]["all_equilibria_found_30_random_starts"]
    tip = solved("A4", reference.RTOL).tip_position
    assert min(apart(tip, each["tip_position"]) for each in measured if each["det"] > 0.0) < BOUND


@pytest.mark.parametrize("tubes", [1, 2, 4, 6])
def test_the_reference_solver_agrees_under_loads(tubes):
    """Cold and warm, with the package: other equations, another integrator."""
    work = nested(tubes, "force and moment", 1)
    given, load = work.reference
    cold = reference.solve(given, plain(work.actuation), load)
    warm = reference.solve(given, plain(work.targets[0]), load, cold)
    assert apart(cold.tip_position, work.start.tip_position) < BOUND
    assert apart(warm.tip_position, work.tips[0]) < BOUND
    assert warm.integrations < cold.integrations


def test_both_right_hand_sides_are_one():
    rng = np.random.default_rng(0)
    for count in (1, 2, 5):
        bending, torsional = rng.uniform(0.5, 2.0, (2, count)).tolist()
        given = bending, torsional, rng.normal(size=(count, 2)).tolist(), rng.normal(size=3).tolist()
        y = rng.normal(size=14 + 2 * count)
        np.testing.assert_allclose(reference.expanded(*given)(0.0, y), reference.printed(*given)(0.0, y), atol=1e-13)


def test_the_reference_solver_refuses_what_it_cannot_do():
    tubes = reference.Tubes((1.0, 1.0), (1.0, 1.0), (0.1, 0.1), (0.1, 0.2), ((1.0, 0.0), (1.0, 0.0)))
    with pytest.raises(ValueError, match="reaches further"):
        reference.solve(tubes, ([0.0, 0.0], [0.0, 0.0]), UNLOADED)


@pytest.mark.slow
def test_the_suite_runs_and_all_that_it_times_is_exact(capsys, tmp_path):
    rows = main(["--quick", "--figure", str(tmp_path / "figure.png")])
    printed = capsys.readouterr().out
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
    for word in ("sections^a tubes^b", "(load points)^c", "resident after 10 warm solves"):
        assert word in printed
    for mode in (*REFERENCES, *MODES):
        measured = [row.measured[mode.name] for row in rows if mode.name in row.measured]
        errors = np.array([each.error for each in measured])
        assert len(measured) >= 2 * 4 + 4 * 3
        assert all(each.seconds > 0.0 for each in measured)
        assert errors[~np.isnan(errors)].max() < BOUND


def test_the_neighbours_are_what_the_docs_say():
    work = three_tubes("B", "force", 20)
    for target in work.targets:
        turned = np.abs(target.rotations - work.actuation.rotations)
        assert np.all((turned >= 0.01) & (turned <= 0.03))
        np.testing.assert_allclose(np.abs(target.translations - work.actuation.translations), 2e-4, atol=1e-15)
    assert isinstance(work.loads[0], ctr.PointWrench)
    assert not work.loads[0].nonconservative


@pytest.mark.slow
def test_two_trees_take_turns(capsys):
    """A tree beside itself: the median of paired ratios between its quartiles."""
    against.main([str(against.ROOT), "--only", "import of the package", "--turns", "2"])
    (line,) = capsys.readouterr().out.splitlines()
    middle, low, high, microseconds = (float(number) for number in re.findall(r"\d+\.\d+", line))
    assert 0.0 < low <= middle <= high
    assert microseconds > 0.0


@pytest.mark.slow
def test_the_table_of_cliffs_has_all_rows(capsys):
    main(["cliffs", "--quick"])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 10
    assert all(line.count("|") == 6 for line in lines)
