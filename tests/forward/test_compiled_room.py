"""Room for answers of compiled solves, which threads share."""

import pytest

import ctr_opt as ctr
from ctr_opt.native.compiler import compiler


@pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
def test_room_is_announced_as_large_as_it_is(monkeypatch):
    """Though another thread makes more of it, just when it is taken: else C would write beyond its end."""
    problem = ctr.ForwardProblem(ctr.load_robot("problems/three_tubes/robot_b.toml"), compiled=True)
    compiled = problem.solver.compiled_for(())
    size, room = compiled._room
    announced = []

    def taken_while_more_is_made():
        compiled._make_room(4 * size)
        return room()

    def cold(*arguments, solve=compiled.native.cold):
        announced.append(arguments[-1])
        return solve(*arguments)

    monkeypatch.setattr(compiled, "_room", (size, taken_while_more_is_made))
    monkeypatch.setattr(compiled.native, "cold", cold)
    assert problem.solve(ctr.Actuation([0.0, 1.0, -1.0], [-0.3, -0.2, -0.1])).converged
    assert announced == [size]
