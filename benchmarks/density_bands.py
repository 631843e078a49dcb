"""Do the bands of distributed forces contain them? ``python -m benchmarks.density_bands``; see docs/how_to/contacts.md.

Robots A and B of problems/three_tubes and RJW-S1 are under random smooth forces per length, new in every trial, and are
measured at thirty points along the backbone. The unit of a density is the innermost tube's bending stiffness over the
cubed length.
"""

import argparse

import attrs
import numpy as np
from scipy.stats import chi2

import ctr_opt as ctr

from .contact_location import robots

SIGMA = 2e-4  # m, of every coordinate of a point
POINTS = 30
SIZES = 1.0, 4.0  # of the largest density, in units
WIDTHS = 0.08, 0.3  # of a bump, its standard deviation in lengths
PRIOR = 3.0  # standard deviation of densities, in units: of their size
PLACES = 101  # where bands are looked at
TOTAL = chi2.ppf(0.95, 3)


@attrs.frozen
class Trial:
    """Shares of the density inside the 95 % band, along each axis; and whether the total is inside its ellipsoid."""

    inside: np.ndarray
    total: bool


def bump(fractions, rng):
    """A soft contact: one bump, roughly across the backbone."""
    middle, width = rng.uniform(0.3, 0.95), rng.uniform(*WIDTHS)
    direction = rng.normal(size=3) * [1.0, 1.0, 0.2]
    return np.exp(-0.5 * ((fractions - middle) / width) ** 2)[:, None] * direction / np.linalg.norm(direction)


def waves(fractions, rng):
    """A bed: two waves along each axis, of half a length and more."""
    density = np.zeros((len(fractions), 3))
    for k in (0.0, 1.0, 2.0):
        density += np.cos(np.pi * k * fractions + rng.uniform(0.0, 2.0 * np.pi))[:, None] * rng.normal(size=3)
    return density * [1.0, 1.0, 0.2]


DENSITIES = {"bump": bump, "waves": waves}


def press(robot, actuation, free, kind, rng):
    """A stable shape under a force per length: arc lengths, densities and the shape."""
    unit = robot.tubes[0].bending_stiffness / free.length**3
    s = np.linspace(0.0, free.length, 161)
    while True:
        density = DENSITIES[kind](s / free.length, rng)
        density *= unit * rng.uniform(*SIZES) / np.linalg.norm(density, axis=1).max()
        try:
            shape = ctr.ForwardProblem(robot).solve(actuation, [ctr.DistributedLoad((s, density))], initial=free)
        except ctr.SolveError:
            continue
        if shape.is_stable:
            return s, density, shape


def trials(robot, actuation, kind, count, seed=1):
    """Estimate this number of densities from noisy points."""
    free = ctr.ForwardProblem(robot, compiled=True).solve(actuation)
    unit = robot.tubes[0].bending_stiffness / free.length**3
    problem = ctr.ForceEstimationProblem(robot, ctr.DistributedForce(prior=(0.0, PRIOR * unit)), compiled=True)
    places = np.linspace(0.05, 1.0, POINTS) * free.length
    results = []
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        s, density, shape = press(robot, actuation, free, kind, rng)
        points = shape.position(places) + SIGMA * rng.normal(size=(POINTS, 3))
        estimate = problem.solve(actuation, ctr.PositionMeasurement(places, points, SIGMA))
        at = np.linspace(0.0, free.length, PLACES)
        estimated, errors = estimate.density(at)
        off = np.abs(estimated - np.column_stack([np.interp(at, s, component) for component in density.T])) / errors
        gap = estimate.force - np.trapezoid(density, s, axis=0)
        total = gap @ np.linalg.solve(estimate.force_covariance, gap) < TOTAL
        results.append(Trial((off < 1.96).mean(axis=0), bool(total)))
    return results


def row(name, kind, results):
    """Format a row of the table in Markdown."""
    inside = np.array([trial.inside for trial in results])
    total = np.mean([trial.total for trial in results])
    worst = np.quantile(inside.mean(axis=1), 0.1)
    shares = " | ".join(f"{share:.1%}" for share in inside.mean(axis=0))
    return f"| {name} | {kind} | {shares} | {worst:.0%} | {total:.1%} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    print("| robot | density | inside along x | along y | along z | 10 % quantile | total inside |")
    print("| --- | --- | ---: | ---: | ---: | ---: | ---: |")
    for name, (robot, actuation) in robots().items():
        for kind in DENSITIES:
            print(row(name, kind, trials(robot, actuation, kind, options.trials, options.seed)), flush=True)


if __name__ == "__main__":
    main()
