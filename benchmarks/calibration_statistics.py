"""Are a calibration's standard errors right? ``python -m benchmarks.calibration_statistics``.

The results are in docs/evidence/calibration_statistics.md.

The problem is that of problems/rjw_s1/calibration.toml without its outlier. The true shapes are solved once. Every
repetition draws new noise, seeded by its number, and fits from nominal parameters.
"""

import argparse
from time import perf_counter

import attrs
import numpy as np
from scipy.stats import binom, chi2, norm

import ctr_opt as ctr
from ctr_opt.calibration.solution import REJECTED
from ctr_opt.estimation.losses import LOSSES
from ctr_opt.files.calibration import load_calibration
from ctr_opt.layout.ends import Ends
from ctr_opt.layout.observables import arc_length_of
from ctr_opt.robot.names import unit_of

from .calibration_data import FILE, PLACES

LEVEL = 0.95  # of the intervals, and of the chi-square of the residuals
BAND = 0.999  # probability of the bands


@attrs.frozen(eq=False)
class Repetitions:
    """Results of the fits: ``errors`` and reported ``deviations (repetitions, numbers)``, and the bound on them."""

    labels: list
    bound: np.ndarray
    errors: np.ndarray
    deviations: np.ndarray
    nees: np.ndarray
    """Normalized estimation error squared ``e^T C^-1 e`` of each repetition."""
    p_values: np.ndarray

    @property
    def coverage(self):
        """Share of the intervals that contain the truth, for each number."""
        return (np.abs(self.errors) < norm.ppf(0.5 + 0.5 * LEVEL) * self.deviations).mean(axis=0)

    @property
    def efficiency(self):
        """Root-mean-square errors over the Cramer-Rao bound."""
        return np.sqrt((self.errors**2).mean(axis=0)) / self.bound

    @property
    def bias(self):
        """Mean errors over the Cramer-Rao bound."""
        return self.errors.mean(axis=0) / self.bound


def central(distribution):
    """Band that contains a statistic of this distribution with a probability of 99.9 percent."""
    return distribution.ppf(0.5 - 0.5 * BAND), distribution.isf(0.5 - 0.5 * BAND)


def at_truth(calibration):
    """Evaluate the true parameters on the measurements: shapes, and information."""
    values = calibration.truth["values"]
    parameters = [ctr.Parameter(name, initial=values[name]) for name in calibration.parameters]
    return ctr.CalibrationProblem(calibration.robot, calibration.experiments, parameters, compiled=True).nominal()


def seen(experiment, shape):
    """True positions of the measured points, ``(places, 3)``, m."""
    ends = Ends.of_robot(shape.robot, experiment.actuation.translations)
    return shape.position([arc_length_of(place, ends) for place in PLACES])


def measured(experiments, exact, sigma, rng):
    """Measure the points of the experiments with new noise."""
    points = exact + sigma * rng.normal(size=exact.shape)
    return [
        attrs.evolve(experiment, measurements=[ctr.PositionMeasurement(list(PLACES), rows, sigma)])
        for experiment, rows in zip(experiments, points, strict=True)
    ]


def repeat(repetitions, loss="squared", seed=1):
    """Fit to this number of sets of noise."""
    calibration = load_calibration(FILE)
    truth = at_truth(calibration)
    exact = np.array([seen(*pair) for pair in zip(calibration.experiments, truth.equilibria, strict=True)])
    sigma = np.array(calibration.sigma["position"])
    errors, deviations, nees, p_values = [], [], [], []
    for k in range(repetitions):
        data = measured(calibration.experiments, exact, sigma, np.random.default_rng([seed, k]))
        fit = ctr.CalibrationProblem(calibration.robot, data, calibration.parameters, loss=loss, compiled=True).solve()
        error = fit.estimates - truth.estimates
        errors.append(error)
        deviations.append(fit.deviations)
        nees.append(error @ np.linalg.solve(fit.covariance, error))
        p_values.append(fit.p_value)
    samples = map(np.array, (errors, deviations, nees, p_values))
    return Repetitions(truth.labels, np.sqrt(np.diag(truth.covariance_assumed)), *samples)


def table(repetitions):
    """Lines of a table in Markdown, a row for each number."""
    yield "| parameter | Cramer-Rao bound | coverage | RMSE / bound | bias / bound |"
    yield "| --- | ---: | ---: | ---: | ---: |"
    rows = zip(
        repetitions.labels,
        repetitions.bound,
        repetitions.coverage,
        repetitions.efficiency,
        repetitions.bias,
        strict=True,
    )
    for label, bound, coverage, efficiency, bias in rows:
        factor, unit = unit_of(label)
        yield f"| `{label}` | {factor * bound:.3g} {unit} | {coverage:.1%} | {efficiency:.3f} | {bias:+.3f} |"


def joint(repetitions):
    """Summarize all numbers together in a line."""
    count, numbers = repetitions.errors.shape
    low, high = central(chi2(numbers * count))
    return f"joint NEES: {repetitions.nees.mean():.3f}, 99.9 % band {low / count:.3f} to {high / count:.3f}"


def rejections(repetitions):
    """Summarize the residuals' chi-square in lines."""
    count = len(repetitions.p_values)
    for level in (1.0 - LEVEL, REJECTED):
        low, high = central(binom(count, level))
        rejected = np.count_nonzero(repetitions.p_values < level)
        yield f"residuals rejected at {level:.3g}: {rejected} of {count}, 99.9 % band {low:.0f} to {high:.0f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=500)
    parser.add_argument("--loss", choices=LOSSES, default="squared")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    begin = perf_counter()
    repetitions = repeat(options.repetitions, options.loss, options.seed)
    seconds = perf_counter() - begin
    print(*table(repetitions), "", joint(repetitions), sep="\n")
    if options.loss == "squared":  # what other losses leave is not chi-square
        print(*rejections(repetitions), sep="\n")
    print(f"{seconds / options.repetitions:.3f} s a repetition")


if __name__ == "__main__":
    main()
