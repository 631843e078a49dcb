"""Cliffs: what a call costs where it used to cost a hundred times its neighbour, over the price of that neighbour.

``python -m benchmarks cliffs``. Both are measured in one run, in turns: ratios do not depend on the machine.
"""

import attrs
import numpy as np

import ctr_opt as ctr

from .table import time as show
from .timing import Effort, fastest
from .work import ROOT

EFFORT = Effort(0.5, 5, 50)
QUICK = Effort(0.0, 1, 2)
HELD = np.array([-0.3, -0.2, -0.1])


@attrs.frozen
class Row:
    """A call on the cliff, its neighbour, and how many times the neighbour's price is allowed."""

    name: str
    cliff: object
    beside: object
    allowed: float


def rows():
    """The cliffs, each with its neighbour."""
    robot = ctr.load_robot(ROOT / "problems" / "three_tubes" / "robot_b.toml")
    problem, load = ctr.ForwardProblem(robot), [ctr.PointWrench([0.02, 0.0, -0.01])]
    problem.compile()
    turned = np.array([0.0, 1.0, -1.0])
    apart = problem.solve(ctr.Actuation(turned, HELD), load)
    flush = problem.solve(ctr.Actuation(turned, 0.14 - np.array([tube.length for tube in robot.tubes])), load)
    assert flush.one_sided
    assert not apart.one_sided

    def again(start, call):
        def solve():
            return call(problem.solve(start.actuation, load, initial=start))

        return solve

    def far(turn):
        goal = ctr.Actuation(turned + np.array([turn, 0.0, 0.0]), HELD)
        return lambda: problem.solve(goal, load, initial=apart)

    def cold():
        return problem.solve(apart.actuation, load)

    warm = again(apart, lambda shape: shape)
    places = np.linspace(0.0, apart.length, 61)
    calls = {
        "jacobian()": lambda shape: shape.jacobian(),
        "jacobian(side=-1)": lambda shape: shape.jacobian(side=-1),
        "compliance()": lambda shape: shape.compliance(),
        "actuator_wrench(0)": lambda shape: shape.actuator_wrench(0),
        "kinks": lambda shape: shape.kinks,
    }
    for name, call in calls.items():
        yield Row(f"solve and {name}, three flush tubes; beside: apart", again(flush, call), again(apart, call), 3.0)
    along, at_tip = again(apart, lambda shape: shape.jacobian(0.05)), again(apart, calls["jacobian()"])
    yield Row("solve and jacobian(s); beside: at the tip", along, at_tip, 3.0)
    yield Row("position(s) of 61 places; beside: a warm solve", lambda: apart.position(places), warm, 2.0)
    yield Row("sample(s) of 61 places; beside: a warm solve", lambda: apart.sample(places), warm, 2.0)
    for name, turn, allowed in (("a quarter", 0.5, 2.0), ("half a", 1.0, 4.0), ("a whole", 2.0, 8.0)):
        yield Row(f"warm solve over {name} turn; beside: a cold solve", far(turn * np.pi), cold, allowed)
    coil = ctr.Tube("coil", 2e-3, 0.0, ctr.Arc(2.0, [30.0, 0.0, 5.0]), youngs_modulus=60e9, poisson_ratio=0.3)
    soft = ctr.ForwardProblem(ctr.Robot([coil]))
    soft.compile()
    held, pulls = ctr.Actuation([0.0], [0.0]), [[ctr.PointWrench([0.3 * f, 0.0, f])] for f in (0.5, 0.01)]
    yield Row(
        "a spring of 2 m under 0.5 N, a path of many steps; beside: under 0.01 N",
        *(lambda pull=pull: soft.solve(held, pull) for pull in pulls),
        10.0,
    )


def table(effort):
    """Lines of a table in Markdown."""
    yield "| call | time | neighbour | ratio | allowed |"
    yield "| --- | ---: | ---: | ---: | ---: |"
    for row in rows():
        cliff, beside = fastest([row.cliff, row.beside], effort)
        yield f"| {row.name} | {show(cliff)} | {show(beside)} | {cliff / beside:.2f} | {row.allowed:g} |"


def main(quick=False):
    """Print the table."""
    for line in table(QUICK if quick else EFFORT):
        print(line, flush=True)
