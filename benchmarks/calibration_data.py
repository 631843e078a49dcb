"""Makes the synthetic data of a calibration anew from its ``[truth]``: ``python -m benchmarks.calibration_data``."""

import argparse
from pathlib import Path

import attrs
import numpy as np

import ctr_opt as ctr
from ctr_opt.calibration_files import load_calibration
from ctr_opt.experiment_tables import write_experiments
from ctr_opt.inverse.synthetic import synthetic_experiments
from ctr_opt.robot.replacing import robot_with

from .work import ROOT

FILE = ROOT / "problems" / "rjw_s1" / "calibration.toml"
PLACES = (0.0, ctr.Distal(1), None)
COMMENT = "Synthetic: see calibration.toml. World frame; forces at the inner tube's tip."


def true_robot(given):
    """The robot that the data are of."""
    return robot_with(given.robot, given.truth["values"])


def experiments(given, plan):
    """The experiments of the plan, as measured, one of them with a mistyped angle."""
    cases = [(problem.actuation, problem.loads) for problem in plan.problems]
    k = given.truth["outlier"] - 1
    recorded = {k: cases[k][0]}
    stood = np.array([given.truth["rotation"], *cases[k][0].rotations[1:]])
    cases[k] = attrs.evolve(cases[k][0], rotations=stood), cases[k][1]
    sigma, seed = given.sigma["position"], given.truth["seed"]
    return synthetic_experiments(true_robot(given), cases, PLACES, sigma=sigma, seed=seed, recorded=recorded)


def checks(given):
    """Tips of the problems that are measured but not fitted, m."""
    rng = np.random.default_rng([given.truth["seed"], 1])
    robot = true_robot(given)
    tips = []
    for check in given.checks:
        problem = check.problem
        tip = ctr.ForwardProblem(robot).solve(problem.actuation, problem.loads).tip_position
        tips.append(tip + np.array(given.sigma["position"]) * rng.normal(size=3))
    return tips


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", nargs="?", type=Path, default=FILE)
    given = load_calibration(parser.parse_args().file, measured=False)
    plan = ctr.load_plan(given.path.parent / "plan.toml")
    write_experiments(given.table, experiments(given, plan), COMMENT)
    print(f"{given.table} written; tips of the checks, m:")
    for check, tip in zip(given.checks, checks(given), strict=True):
        print(f"  {check.problem.path.name}: {np.round(tip, 7).tolist()}")


if __name__ == "__main__":
    main()
