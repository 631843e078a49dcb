"""Do the sets of a contact's place contain it? ``python -m benchmarks.contact_location``; see docs/how_to/contacts.md.

Robots A and B of problems/three_tubes and RJW-S1 are pressed at random places by random forces, new in every trial, and
measured at twelve points along the backbone.
"""

import argparse
from time import perf_counter

import attrs
import numpy as np

import ctr_opt as ctr

SIGMA = 2e-4  # m, of every coordinate of a point
POINTS = 12
FROM = 0.2  # of the length: contacts are between there and the tip
SIZES = 0.5, 2.0  # of the force, times the bending stiffness over the squared arc length of the contact


@attrs.frozen
class Pressed:
    """A contact, and the result of the search for it."""

    arc_length: float
    estimate: float
    sets: list

    @property
    def covered(self):
        return any(start <= self.arc_length <= end for start, end in self.sets)


def robots():
    """Robots and their actuations by name."""
    robots = {}
    for name in ("a", "b"):
        problem = ctr.load_problem(f"problems/three_tubes/{name}1.toml")
        robots[name.upper()] = problem.robot, problem.actuation
    robots["RJW-S1"] = ctr.load_robot("problems/rjw_s1/robot.toml"), ctr.Actuation([2.356, 0.0], [-0.1547, -0.0307])
    return robots


def press(robot, free, actuation, rng):
    """A contact across the backbone of a robot that stays stable, and the shape under it."""
    while True:
        s = rng.uniform(FROM, 1.0) * free.length
        across = free.pose(s)[:3, :2] @ rng.normal(size=2)
        size = rng.uniform(*SIZES) * robot.tubes[0].bending_stiffness / s**2
        load = ctr.PointWrench(size * across / np.linalg.norm(across), arc_length=s)
        try:
            shape = ctr.ForwardProblem(robot, tolerance=1e-9, compiled=True).solve(actuation, [load], initial=free)
        except ctr.SolveError:
            continue
        if shape.is_stable:
            return load, shape


def trials(robot, actuation, count, seed=1):
    """Estimate this number of contacts from noisy points."""
    free = ctr.ForwardProblem(robot, compiled=True).solve(actuation)
    problem = ctr.ForceEstimationProblem(robot, ctr.PointForce(), compiled=True)
    places = np.linspace(0.1, 1.0, POINTS) * free.length
    presses = []
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        load, shape = press(robot, free, actuation, rng)
        points = shape.position(places) + SIGMA * rng.normal(size=(POINTS, 3))
        estimate = problem.solve(actuation, ctr.PositionMeasurement(places, points, SIGMA))
        presses.append(Pressed(load.arc_length, estimate.arc_length, estimate.arc_length_set))
    return presses


def row(name, presses):
    """Format a row of the table in Markdown."""
    covered = np.mean([press.covered for press in presses])
    length = np.median([sum(end - start for start, end in press.sets) for press in presses])
    parted = np.mean([len(press.sets) > 1 for press in presses])
    error = np.median([abs(press.estimate - press.arc_length) for press in presses])
    return f"| {name} | {covered:.1%} | {1e3 * length:.1f} mm | {parted:.1%} | {1e3 * error:.1f} mm |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    head = ("robot", "sets that contain the place", "median length of the set", "in several intervals")
    print(f"| {' | '.join(head)} | median error of the estimate |")
    print("| --- | ---: | ---: | ---: | ---: |")
    for name, (robot, actuation) in robots().items():
        begin = perf_counter()
        print(row(name, trials(robot, actuation, options.trials, options.seed)), flush=True)
        print(f"{(perf_counter() - begin) / options.trials:.3f} s a trial", flush=True)


if __name__ == "__main__":
    main()
