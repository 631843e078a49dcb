"""How long does it take to estimate forces, relative to warm forward solves of the same robot?

Run: ``python -m benchmarks.force_time``, or ``--seconds 1``.
"""

import argparse

import attrs
import numpy as np

import ctr_opt as ctr

from .table import time
from .timing import Effort, fastest
from .work import SEED, three_tubes

SIGMA = 2e-4  # m, of a point along an axis
NOISE = 0.05  # 1/m, of a curvature
PLACES = 20
NEIGHBOURS = 10
WARM = "warm forward solve"


def tip_force(effort):
    """Names, and seconds of each: a warm forward solve, and the tip force from points or a fibre, warm and cold.

    Each goes to and fro between neighbours of robot B's actuation; measurements are new each time. Medians over pairs.
    """
    work = three_tubes("B", "force", effort.neighbours)
    forward = ctr.ForwardProblem(work.robot, compiled=True)
    problem = ctr.ForceEstimationProblem(work.robot, ctr.TipForce(), compiled=True)
    rng, places = np.random.default_rng(SEED), np.linspace(0.15, 0.95, PLACES) * work.start.length
    shapes = [forward.solve(target, work.loads, initial=work.start) for target in work.targets]
    points = [shape.position(places) + SIGMA * rng.normal(size=(PLACES, 3)) for shape in shapes]
    fibres = [_curvatures(shape, places) + NOISE * rng.normal(size=(PLACES, 2)) for shape in shapes]

    def from_points(k, initial=None):
        return problem.solve(work.targets[k], ctr.PositionMeasurement(places, points[k], SIGMA), initial=initial)

    def from_fibre(k, initial=None):
        return problem.solve(work.targets[k], ctr.CurvatureMeasurement(places, fibres[k], NOISE), initial=initial)

    def to_and_fro(pair, equilibria, solve):
        there, back = pair
        return lambda: [solve(there, equilibria[back]), solve(back, equilibria[there])]

    ways = {WARM: (shapes, lambda k, initial: forward.solve(work.targets[k], work.loads, initial=initial))}
    for what, solve in (("points", from_points), ("curvatures", from_fibre)):
        ways[f"tip force from {PLACES} {what}, warm"] = [solve(k) for k in range(len(shapes))], solve
        ways[f"tip force from {PLACES} {what}, cold"] = [None] * len(shapes), solve
    pairs = [(k - 1, k) for k in range(1, len(shapes))]
    share = attrs.evolve(effort, seconds=effort.seconds / len(pairs))
    seconds = [fastest([to_and_fro(pair, *way) for way in ways.values()], share) / 2.0 for pair in pairs]
    return dict(zip(ways, np.median(seconds, axis=0), strict=True))


def _curvatures(shape, places):
    """Curvatures of the innermost tube, in its material frame."""
    x, y, _ = shape.curvature(places).T
    c, s = np.cos(shape.tube_angle(0, places)), np.sin(shape.tube_angle(0, places))
    return np.column_stack((c * x + s * y, c * y - s * x))


def lines(effort):
    """A table: times, and ratios to the warm forward solve."""
    times = tip_force(effort)
    yield "| robot B | time | relative to a warm forward solve |"
    yield "| --- | ---: | ---: |"
    for name, seconds in times.items():
        yield f"| {name} | {time(seconds)} | {seconds / times[WARM]:.1f} |"


def main(arguments=None):
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.force_time", description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    for line in lines(Effort(parser.parse_args(arguments).seconds, 5, NEIGHBOURS)):
        print(line, flush=True)


if __name__ == "__main__":
    main()
