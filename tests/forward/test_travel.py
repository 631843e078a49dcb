"""Far steps from an equilibrium: compiled code follows the branch as the virtual machine does, to the same end."""

import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.forward.compiled import CompiledRecord
from ctr_opt.native.compile import compiler
from ctr_opt.solvers.status import SolveStatus
from tests.support.slow import some_slow

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
BASES = {"a": np.array([-0.1, -0.08, -0.05]), "b": np.array([-0.3, -0.2, -0.1])}


def problem(name, compiled):
    return ctr.ForwardProblem(ctr.load_robot(f"problems/three_tubes/robot_{name}.toml"), compiled=compiled)


def step(name, seed):
    """An equilibrium, and an actuation and loads up to a full turn of the tubes against each other away."""
    rng, fast = np.random.default_rng([seed, ord(name)]), problem(name, True)
    turns = rng.uniform(-1.0, 1.0, 3)
    turns *= rng.choice([0.5, 1.0, 2.0]) * np.pi / np.ptp(turns)
    forces = [[ctr.PointWrench(0.05 * rng.normal(size=3), arc_length=place)] for place in (None, 0.1)]
    there = np.minimum(BASES[name] + 0.01 * rng.normal(size=3), 0.0)
    begin = ctr.Actuation(rng.uniform(-np.pi, np.pi, 3), BASES[name])
    loads = [forces[0], forces[seed % 2]]
    return fast, fast.solve(begin, loads[0]), ctr.Actuation(begin.rotations + turns, there), loads[1]


@pytest.mark.parametrize("name", "ab")
@pytest.mark.parametrize("seed", some_slow(range(100), range(8)))
def test_far_steps_are_those_of_the_virtual_machine(name, seed):
    """Both solves are good to 1e-7 of the length. A path that ends is known to its smallest step, 1e-5 of the way."""
    fast, start, actuation, loads = step(name, seed)
    shape = fast.solve(actuation, loads, initial=start, throw=False)
    other = problem(name, False).solve(actuation, loads, initial=start, throw=False)
    assert shape.status is other.status
    if shape.converged:
        assert isinstance(shape.record, CompiledRecord)
        assert np.linalg.norm(shape.tip_position - other.tip_position) < 2e-7 * shape.length
    else:
        assert shape.reached == pytest.approx(other.reached, abs=3e-5)
        assert shape.last_equilibrium.converged
        off = shape.last_equilibrium.tip_position - other.last_equilibrium.tip_position
        assert np.linalg.norm(off) < 0.02 * shape.length  # the shape changes as the root of the distance to a fold


def test_far_steps_stay_in_compiled_code(monkeypatch):
    fast, start, *_ = step("b", 0)
    folding = problem("a", True)
    straight = folding.solve(ctr.Actuation([0.0, 0.0, 0.0], BASES["a"]))

    def general(*_, **__):
        raise AssertionError("the virtual machine")

    monkeypatch.setattr("ctr_opt.forward.solver.solve_configuration", general)
    for turn in (0.5 * np.pi, np.pi, 3.0 * np.pi):
        goal = ctr.Actuation(start.actuation.rotations + np.array([turn, 0.0, 0.0]), start.actuation.translations)
        shape = fast.solve(goal, start.loads, initial=start)
        assert shape.path in ("newton from initial", "continuation from initial")
    turned = ctr.Actuation([2.0 * np.pi, 0.0, 0.0], BASES["a"])
    ended = folding.solve(turned, initial=straight, throw=False)
    assert ended.status is SolveStatus.FOLD
    assert 0.5 < ended.reached < 0.6  # it snaps at 208 degrees: docs/how_to/workspaces_and_batches.md
    assert "a fold" in ended.message or "fold" in ended.status.description
    with pytest.raises(ctr.SolveError, match="of the way"):
        folding.solve(turned, initial=straight)
