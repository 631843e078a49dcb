"""Are the errors of estimated forces right, and are wrong models detected? See docs/evidence/force_statistics.md.

``python -m benchmarks.force_statistics``: true shapes of three robots under a force or wrench at the tip, and points
along them with new noise in every trial, seeded by its number. With a prior, the truth is drawn from it. Robots with an
error of the model are estimated by the model without it. The error's sizes are detected in 30, 60 and 90 % of the
trials, to first order.
"""

import argparse
from pathlib import Path
from time import perf_counter

import attrs
import numpy as np
from scipy.stats import chi2, ncx2

import ctr_opt as ctr
from ctr_opt.force.systematic import CONSISTENT
from ctr_opt.robot.names import parameters, robot_with

from .calibration_statistics import central

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"
ROBOTS = {"A": "three_tubes/a1.toml", "B": "three_tubes/b1.toml", "RJW-S1": "rjw_s1/fig9_loaded.toml"}
POINTS = 20
FORCE = np.array([0.9, -1.1, 0.6])  # in characteristic forces: EI of the inner tube over the robot's length squared
MOMENT = np.array([0.1, 0.1, 0.05])  # in characteristic moments: EI over the length
POWERS = (0.3, 0.6, 0.9)
KINDS = ("shift", "tilt", "curvature", "stiffness")


@attrs.frozen
class Regime:
    """An unknown load; standard deviations of points, m, and of the prior, in characteristic forces and moments."""

    unknown: type
    sigma: float
    prior: float | None


REGIMES = {
    "tip force": Regime(ctr.TipForce, 1e-5, None),
    "tip force, prior": Regime(ctr.TipForce, 2e-4, 0.05),
    "tip wrench, prior": Regime(ctr.TipWrench, 2e-4, 0.05),
}


@attrs.frozen(eq=False)
class Trials:
    """Results: ``errors (trials, numbers)``, the Cramer-Rao ``bound`` of each number, and other results by trial."""

    bound: np.ndarray
    errors: np.ndarray
    nees: np.ndarray
    """Normalized estimation error squared ``e^T C^-1 e``."""
    p_values: np.ndarray

    @property
    def efficiency(self):
        """Root-mean-square errors over the bound."""
        return np.sqrt((self.errors**2).mean(axis=0)) / self.bound

    @property
    def band(self):
        """Range that contains the mean of ``nees`` with a probability of 99.9 percent."""
        return np.array(central(chi2(self.errors.size))) / len(self.errors)

    @property
    def rejected(self):
        """Share of the estimates that are not consistent."""
        return np.mean(self.p_values < CONSISTENT)


@attrs.frozen(eq=False)
class Wrong:
    """An error of the model of some ``size``: the ``force`` that it adds, in characteristic ones, and its detection.

    ``told`` by the estimate, to first order; ``exact``: by the misfit of exact points; and ``measured`` in trials.
    """

    description: str
    unit: str
    size: float
    force: float
    estimated: float
    exact: float
    measured: float


class Study:
    """A robot and what is estimated."""

    def __init__(self, setting, robot):
        regime = REGIMES[setting]
        self.stream = list(REGIMES).index(setting), list(ROBOTS).index(robot)
        problem = ctr.load_problem(PROBLEMS / ROBOTS[robot])
        self.robot, self.actuation = problem.robot, problem.actuation
        length = max(tube.length + t for tube, t in zip(self.robot.tubes, self.actuation.translations, strict=True))
        stiffness = self.robot.tubes[0].bending_stiffness
        size = 3 if regime.unknown is ctr.TipForce else 6
        self.unit = np.repeat([stiffness / length**2, stiffness / length], 3)[:size]
        self.mean = self.unit * np.concatenate((FORCE, MOMENT))[:size]
        self.places = np.linspace(1.0 / POINTS, 1.0, POINTS) * length
        self.sigma = regime.sigma
        self.spread = self.unit * (regime.prior or 0.0)
        unknown = regime.unknown(regime.prior and (self.mean, self.spread))
        self.problem = ctr.ForceEstimationProblem(self.robot, unknown, compiled=True)
        self.exact = self._seen(ctr.ForwardProblem(self.robot, compiled=True), self.mean)
        self.at_truth = self.problem.solve(self.actuation, self._measured(self.exact))

    def _seen(self, forward, truth):
        """True positions of the points."""
        moment = truth[3:] if len(truth) > 3 else np.zeros(3)
        return forward.solve(self.actuation, [ctr.PointWrench(truth[:3], moment)]).position(self.places)

    def _measured(self, points):
        return ctr.PositionMeasurement(self.places, points, self.sigma)

    def estimate(self, points):
        """Estimate the load from measured points."""
        return self.problem.solve(self.actuation, self._measured(points), initial=self.at_truth)

    def trials(self, count, seed=1, truly=None, case=0):
        """Estimate with new noise, seeded by a ``case``; ``truly`` is the real robot if it differs from the model."""
        forward = ctr.ForwardProblem(truly or self.robot, compiled=True)
        exact = self._seen(forward, self.mean)
        errors, nees, p_values = [], [], []
        for k in range(count):
            rng = np.random.default_rng([seed, *self.stream, case, k])
            truth = self.mean + self.spread * rng.normal(size=len(self.mean))
            points = self._seen(forward, truth) if self.spread.any() else exact
            estimate = self.estimate(points + self.sigma * rng.normal(size=points.shape))
            error = estimate.estimates - truth
            errors.append(error)
            nees.append(error @ np.linalg.solve(estimate.covariance, error))
            p_values.append(estimate.p_value)
        return Trials(self.at_truth.deviations, *map(np.array, (errors, nees, p_values)))

    def wrong(self, count, kind, seed=1):
        """The first error of a kind, along or about x or of the inner tube, at three sizes."""
        error = next(one for one in self.at_truth.systematic if one.kind == kind)
        known = parameters(self.robot, self.actuation)
        for case, power in enumerate(POWERS, 1 + len(POWERS) * KINDS.index(kind)):
            size = error.size_at(power)
            changed = {name: known[name].value + size * change for name, change in error.changes.items()}
            truly = robot_with(self.robot, changed)
            misfit = self.estimate(self._seen(ctr.ForwardProblem(truly, compiled=True), self.mean))
            freedom = misfit.degrees_of_freedom
            exact = ncx2.sf(chi2.isf(CONSISTENT, freedom), freedom, misfit.chi_squared)
            force = size * np.linalg.norm(error.force_rate) / self.unit[0]
            measured = self.trials(count, seed, truly, case).rejected
            yield Wrong(error.description, error.unit, size, force, power, exact, measured)


SHOWN = {"m": (1e3, "mm", 3), "rad": (np.degrees(1.0), "deg", 3), "1": (100.0, "%", 1)}


def row(*cells):
    return f"| {' | '.join(cells)} |"


def of_errors(setting, robot, study, trials):
    """A row of the first table."""
    worst = study.at_truth.axes[2].standard_deviation / study.unit[0]
    low, high = trials.band
    ratios = trials.efficiency
    nees = f"{trials.nees.mean():.3f} ({low:.2f} to {high:.2f})"
    return row(
        setting, robot, f"{worst:.1%}", f"{ratios.min():.3f} to {ratios.max():.3f}", nees, f"{trials.rejected:.1%}"
    )


def of_wrong(setting, robot, wrong):
    """A row of the second table, of the three sizes of an error."""
    factor, unit, digits = SHOWN[wrong[0].unit]
    sizes = " / ".join(f"{factor * each.size:.{digits}f}" for each in wrong)
    forces = " / ".join(f"{each.force:.2f}" for each in wrong)
    exact, measured = (" / ".join(f"{getattr(each, key):.1%}" for each in wrong) for key in ("exact", "measured"))
    return row(setting, robot, wrong[0].description, f"{sizes} {unit}", forces, exact, measured)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--wrong", type=int, default=1000, help="trials of each size of each error of the model")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    begin = perf_counter()
    studies = {(setting, robot): Study(setting, robot) for setting in REGIMES for robot in ROBOTS}
    print(row("estimated", "robot", "largest sd", "RMSE / bound", "NEES (99.9 % band)", "false alarms"))
    print(row("---", "---", *["---:"] * 4))
    for key, study in studies.items():
        print(of_errors(*key, study, study.trials(options.trials, options.seed)), flush=True)
    print()
    print(row("estimated", "robot", "error", "sizes", "force added", "exact", "measured"))
    print(row("---", "---", "---", *["---:"] * 4))
    for (setting, robot), study in studies.items():
        for kind in KINDS if REGIMES[setting].unknown is ctr.TipForce else ():
            print(of_wrong(setting, robot, list(study.wrong(options.wrong, kind, options.seed))), flush=True)
    print(f"{perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
