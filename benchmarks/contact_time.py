"""How long do contacts and distributed forces take, relative to warm forward solves of the same robot?

Run: ``python -m benchmarks.contact_time``, or ``--seconds 1``. Estimates start without an initial guess.
"""

import argparse

import numpy as np

import ctr_opt as ctr

from .table import time as show
from .timing import Effort, fastest
from .work import SEED, three_tubes

SIGMA = 2e-4  # m, of a point along an axis
POINTS = 20
PLACE = 0.6  # of the length
SIZE = 1.5  # of a contact's force, times the bending stiffness over its squared arc length
DENSITY = 2.0  # at most, times the bending stiffness over the cubed length
PRIOR = 10.0  # standard deviation of densities, in the same unit


def seconds(name, effort):
    """Seconds of a warm forward solve, a contact's place and force, and a distributed force, by name."""
    work = three_tubes(name, "none", 1)
    robot, actuation, free = work.robot, work.actuation, work.start
    stiffness, rng = robot.tubes[0].bending_stiffness, np.random.default_rng(SEED)
    forward = ctr.ForwardProblem(robot, compiled=True)
    s = PLACE * free.length
    contact = ctr.PointWrench(SIZE * stiffness / s**2 * free.pose(s)[:3, 0], arc_length=s)
    along = np.linspace(0.0, free.length, 41)
    unit = stiffness / free.length**3
    bump = DENSITY * unit * np.sin(np.pi * along / free.length)[:, None] ** 2 * free.pose(s)[:3, 0]
    places = np.linspace(0.1, 1.0, POINTS) * free.length

    def estimation(unknown, load):
        shape = ctr.ForwardProblem(robot).solve(actuation, [load], initial=free)
        points = shape.position(places) + SIGMA * rng.normal(size=(POINTS, 3))
        problem = ctr.ForceEstimationProblem(robot, unknown, compiled=True)
        return lambda: problem.solve(actuation, ctr.PositionMeasurement(places, points, SIGMA))

    spread = ctr.DistributedForce(prior=(0.0, PRIOR * unit))
    work_done = {
        "warm forward solve": lambda: forward.solve(work.targets[0], initial=free),
        "a contact's place and force": estimation(ctr.PointForce(), contact),
        "a distributed force, 12 coefficients x 3": estimation(spread, ctr.DistributedLoad((along, bump))),
    }
    return dict(zip(work_done, fastest(list(work_done.values()), effort), strict=True))


def lines(effort):
    """A table: times, and ratios to the warm forward solve."""
    yield "| robot | task | time | relative to a warm forward solve |"
    yield "| --- | --- | ---: | ---: |"
    for name in "AB":
        times = seconds(name, effort)
        unit = next(iter(times.values()))
        for what, taken in times.items():
            yield f"| {name} | {what} | {show(taken)} | {taken / unit:.0f} |"


def main(arguments=None):
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.contact_time", description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    for line in lines(Effort(parser.parse_args(arguments).seconds, 3, 1)):
        print(line, flush=True)


if __name__ == "__main__":
    main()
