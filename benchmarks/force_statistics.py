"""Do a force's errors hold, and is a wrong model noticed? ``python -m benchmarks.force_statistics``.

See docs/force_statistics.md. Every trial draws new noise, and where there is a prior a new truth from it, seeded by its
number; wrong models have errors of the sizes that the linearized problem detects with some probability.
"""

import argparse
from pathlib import Path
from time import perf_counter

import attrs
import numpy as np
from scipy.stats import binom, chi2

import ctr_opt as ctr
from ctr_opt.inverse.force_errors import CONSISTENT
from ctr_opt.robot.parameters import parameters
from ctr_opt.robot.replacing import robot_with

from .calibration_statistics import central

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"
ROBOTS = {"A": "three_tubes/a1.toml", "B": "three_tubes/b1.toml", "RJW-S1": "rjw_s1/fig9_loaded.toml"}
POINTS = 20
FORCE = np.array([0.9, -1.1, 0.6])  # characteristic forces, EI of the inner tube over the robot's length squared
MOMENT = np.array([0.1, 0.1, 0.05])  # characteristic moments, EI over the length
POWERS = (0.3, 0.6, 0.9)
KINDS = ("shift", "tilt", "curvature", "stiffness")


@attrs.frozen
class Regime:
    """What is sought, the standard deviation of points, m, and that of a prior in characteristic forces, moments."""

    unknown: type
    sigma: float
    prior: float | None


REGIMES = {
    "tip force": Regime(ctr.TipForce, 3e-5, None),
    "tip force, prior": Regime(ctr.TipForce, 2e-4, 0.05),
    "tip wrench, prior": Regime(ctr.TipWrench, 2e-4, 0.05),
}


@attrs.frozen(eq=False)
class Trials:
    """What was found: ``errors (trials, numbers)``, their squares by the covariances told, and of the residuals."""

    bound: np.ndarray
    """Of Cramer and Rao, at the mean of the truths."""
    errors: np.ndarray
    nees: np.ndarray
    p_values: np.ndarray

    @property
    def efficiency(self):
        """Root-mean-square errors over the bound."""
        return np.sqrt((self.errors**2).mean(axis=0)) / self.bound

    @property
    def rejected(self):
        """How many were not consistent."""
        return int(np.count_nonzero(self.p_values < CONSISTENT))


class Study:
    """A robot and a regime."""

    def __init__(self, robot, regime):
        given = ctr.load_problem(PROBLEMS / ROBOTS[robot])
        self.robot, self.actuation = given.robot, given.actuation
        self.length = float(max(tube.length + t for tube, t in zip(self.robot.tubes, self.actuation.translations)))
        stiffness = self.robot.tubes[0].bending_stiffness
        self.unit = np.repeat([stiffness / self.length**2, stiffness / self.length], 3)
        self.mean = self.unit * np.concatenate((FORCE, MOMENT))
        if regime.unknown is ctr.TipForce:
            self.unit, self.mean = self.unit[:3], self.mean[:3]
        self.sigma = regime.sigma
        self.spread = 0.0 * self.unit if regime.prior is None else regime.prior * self.unit
        unknown = regime.unknown(None if regime.prior is None else (self.mean, self.spread))
        self.problem = ctr.ForceEstimationProblem(self.robot, unknown, compiled=True)
        self.places = np.linspace(1.0 / POINTS, 1.0, POINTS) * self.length
        exact = self.seen(ctr.ForwardProblem(self.robot, compiled=True), self.mean)
        self.nominal = self.problem.solve(self.actuation, ctr.PositionMeasurement(self.places, exact, self.sigma))

    def seen(self, forward, truth):
        """Where the points truly are."""
        moment = truth[3:] if len(truth) > 3 else np.zeros(3)
        return forward.solve(self.actuation, [ctr.PointWrench(truth[:3], moment)]).position(self.places)

    def trials(self, count, wrong=None, seed=1):
        """Estimates by the nominal model; the truth is of the ``wrong`` one, the robot's parameters by name."""
        forward = ctr.ForwardProblem(robot_with(self.robot, wrong or {}), compiled=True)
        errors, nees, p_values = [], [], []
        for k in range(count):
            rng = np.random.default_rng([seed, k])
            truth = self.mean + self.spread * rng.normal(size=len(self.mean))
            points = self.seen(forward, truth) + self.sigma * rng.normal(size=(POINTS, 3))
            measured = ctr.PositionMeasurement(self.places, points, self.sigma)
            found = self.problem.solve(self.actuation, measured, initial=self.nominal)
            error = found.estimates - truth
            errors.append(error)
            nees.append(error @ np.linalg.solve(found.covariance, error))
            p_values.append(found.p_value)
        return Trials(self.nominal.deviations, *map(np.array, (errors, nees, p_values)))

    def wrong(self, error, size):
        """The numbers of a robot with a systematic error of a size."""
        known = parameters(self.robot, self.actuation)
        return {name: known[name].value + size * change for name, change in error.changes.items()}


def errors_of_model(study):
    """Of each kind the first, along or about x or of the inner tube."""
    return [next(each for each in study.nominal.systematic if each.kind == kind) for kind in KINDS]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    begin = perf_counter()
    for name, regime in REGIMES.items():
        for robot in ROBOTS:
            study = Study(robot, regime)
            found = study.trials(given.trials, seed=given.seed)
            n, k = found.errors.shape
            worst = max(axis.standard_deviation for axis in study.nominal.axes) / study.unit[0]
            print(
                name,
                robot,
                worst,
                found.efficiency,
                found.nees.mean(),
                np.array(central(chi2(n * k))) / n,
                found.rejected / n,
                f"{perf_counter() - begin:.1f}",
            )
            for error in errors_of_model(study):
                sizes = [error.size_at(p) for p in POWERS]
                powers = [
                    study.trials(given.trials, study.wrong(error, s), seed=given.seed).rejected / n for s in sizes
                ]
                print(
                    "    ",
                    error.description,
                    sizes,
                    [np.linalg.norm(error.force_rate) * s / study.unit[0] for s in sizes],
                    powers,
                )


if __name__ == "__main__":
    main()
