"""Calibration against Nelder and Mead's method, and how its time and memory grow: ``python -m benchmarks.calibration``.

The paper's problem on synthetic data: four stiffnesses and the base's pose from eighty shapes, by the sum of distances.
The paper used Nelder and Mead's method. Here it is SciPy's adaptive version in scaled parameters, from a simplex of
5 %. It uses this package's compiled forward solves, each from the previous equilibrium. It is timed until it comes
within 0.1 % of the least known objective, or for 20,000 evaluations.
"""

import argparse
import resource
from contextlib import suppress
from time import perf_counter

import numpy as np
from scipy.optimize import minimize

import ctr_opt as ctr
from ctr_opt.estimation.losses import Loss
from ctr_opt.files.calibration import load_calibration
from ctr_opt.layout.observables import Observable, Stacked
from ctr_opt.native.predictions import Predictions

from .calibration_data import FILE, PLACES

ENOUGH, MOST = 1.001, 20_000
SCALES = {"base.translation": 0.02, "base.rotation": 0.2}  # m, rad: 5 % of them are the paper's changes


class Objective:
    """The sum of distances by forward solves, as fast as we could make it."""

    def __init__(self, estimation):
        self.estimation = estimation
        unknowns = estimation.unknowns
        self.scale = np.concatenate(
            [np.full(e.size, SCALES[e.name]) if e.name in SCALES else e.scale for e in unknowns.entries]
        )
        self.cases = [(experiment.actuation, experiment.loads) for experiment in estimation.experiments]
        self.measured = np.array([experiment.measurements[0].position for experiment in estimation.experiments])
        self.weights = np.array([experiment.measurements[0].isotropic for experiment in estimation.experiments])
        self.loss = Loss("distance", 3)
        self.equilibria = estimation.equilibria(unknowns.initial)
        observables = [Observable("pose", place) for place in PLACES]
        self.model = Predictions(estimation.robot, [], self.cases, observables)
        self.joints = np.array([np.concatenate((a.rotations, a.translations)) for a, _ in self.cases])
        self.evaluations = 0

    def __call__(self, scaled):
        robot = self.estimation.unknowns.robot_at(scaled * self.scale)
        problem = ctr.ForwardProblem(robot, compiled=True)
        self.equilibria = [
            problem.solve(*case, initial=before) for case, before in zip(self.cases, self.equilibria, strict=True)
        ]
        values = self.model.moved(robot, self.joints).at([shape.unknowns for shape in self.equilibria])
        misfit = np.einsum("epij,epj->epi", self.weights, Stacked.of(values.observed).value[..., 3] - self.measured)
        self.evaluations += 1
        return float(self.loss.evaluate((misfit**2).sum(axis=-1))[0].sum())


class ReachedError(Exception):
    """The objective is good enough."""


def nelder_mead(estimation, target, **options):
    """Seconds, evaluations and objective of SciPy's method until the target is reached."""
    objective = Objective(estimation)
    start = estimation.unknowns.initial / objective.scale
    best = [np.inf]

    def watched(scaled):
        value = objective(scaled)
        best[0] = min(best[0], value)
        if value <= target:
            raise ReachedError
        return value

    begin = perf_counter()
    with suppress(ReachedError):
        minimize(watched, start, method="Nelder-Mead", options=options)
    return perf_counter() - begin, objective.evaluations, best[0]


def simplex(start):
    """The start and a vertex along each axis, 5 % away."""
    return np.vstack((start, start + 0.05 * np.eye(len(start))))


def ours(calibration, method, experiments=None):
    """Seconds and objective of a fit, compiled beforehand."""
    problem = ctr.CalibrationProblem(
        calibration.robot, experiments or calibration.experiments, calibration.parameters, loss="distance"
    )
    begin = perf_counter()
    fit = problem.solve(method=method)
    return perf_counter() - begin, fit.iterations, fit.objective


def compare(calibration, repeats):
    ours(calibration, "simultaneous")  # builds the library
    rows = {name: min(ours(calibration, name) for _ in range(repeats)) for name in ("simultaneous", "reduced")}
    least = min(row[2] for row in rows.values())
    estimation = ctr.CalibrationProblem(
        calibration.robot, calibration.experiments, calibration.parameters, loss="distance"
    )._estimation
    objective = Objective(estimation)
    start = simplex(estimation.unknowns.initial / objective.scale)
    limits = {"maxfev": MOST, "maxiter": MOST, "xatol": 1e-9, "fatol": 1e-9}
    rows["Nelder-Mead, adaptive"] = nelder_mead(
        estimation, ENOUGH * least, adaptive=True, initial_simplex=start, **limits
    )
    rows["Nelder-Mead, SciPy's defaults"] = nelder_mead(estimation, ENOUGH * least)
    return rows, least


def growth(calibration, counts):
    """Seconds of a fit and MB resident after it, for this number of experiments."""
    for count in counts:
        experiments = [calibration.experiments[k % len(calibration.experiments)] for k in range(count)]
        seconds, iterations, _ = ours(calibration, "simultaneous", experiments)
        yield count, seconds, iterations, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--most", type=int, default=5120, help="experiments at most")
    given_arguments = parser.parse_args()
    calibration = load_calibration(FILE)
    rows, least = compare(calibration, 5)
    first = rows["simultaneous"][0]
    head = ("method", "time", "iterations or evaluations", "relative excess of the objective")
    print(f"| {' | '.join(head)} | time relative to simultaneous |")
    print("| --- | ---: | ---: | ---: | ---: |")
    for name, (seconds, count, objective) in rows.items():
        print(f"| {name} | {seconds:.3f} s | {count} | {objective / least - 1.0:.1e} | {seconds / first:.1f} |")
    print("\n| experiments | time | iterations | time per experiment and iteration | peak memory |")
    print("| ---: | ---: | ---: | ---: | ---: |")
    counts = [c for c in (80, 320, 1280, 5120) if c <= given_arguments.most]
    for count, seconds, iterations, memory in growth(calibration, counts):
        microseconds = 1e6 * seconds / count / max(iterations, 1)
        print(f"| {count} | {seconds:.2f} s | {iterations} | {microseconds:.0f} us | {memory:.0f} MB |", flush=True)


if __name__ == "__main__":
    main()
