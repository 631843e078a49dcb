"""Generate the synthetic data of a calibration from its ``[truth]``: ``python -m benchmarks.calibration_data``."""

import argparse
from pathlib import Path

import attrs
import numpy as np

import ctr_opt as ctr
from benchmarks.synthetic import synthetic_experiments, synthetic_tip_poses
from ctr_opt.calibration.unknowns import Unknowns
from ctr_opt.files.calibration import load_calibration
from ctr_opt.files.experiments import write_experiments

from .work import ROOT

FILE = ROOT / "problems" / "rjw_s1" / "calibration.toml"
TIP_POSES = ROOT / "problems" / "three_tubes" / "tip_poses.toml"
PLACES = (0.0, ctr.Distal(1), None)
BEYOND = (0.012, 0.045)  # m: how far tubes of the three end beyond the next outer one, and the outermost


def true(given, cases):
    """The parameters as unknowns whose initial values are the true ones."""
    values, named = given.truth["values"], {getattr(each, "name", each): each for each in given.parameters}
    tied = {name: getattr(each, "tied", ()) for name, each in named.items()}
    wanted = [ctr.Parameter(name, initial=value, tied=tied.get(name, ())) for name, value in values.items()]
    return Unknowns(given.robot, cases, wanted)


def true_robot(given):
    """The robot that the data are of."""
    unknowns = true(given, [])
    return unknowns.robot_at(unknowns.initial)


def experiments(given, plan):
    """The experiments of the plan, as measured, one of them with a mistyped angle."""
    cases = [(problem.actuation, problem.loads) for problem in plan.problems]
    k = given.truth["outlier"] - 1
    recorded = {k: cases[k][0]}
    stood = np.array([given.truth["rotation"], *cases[k][0].rotations[1:]])
    cases[k] = attrs.evolve(cases[k][0], rotations=stood), cases[k][1]
    sigma, seed = given.sigma["position"], given.truth["seed"]
    return synthetic_experiments(true_robot(given), cases, PLACES, sigma=sigma, seed=seed, recorded=recorded)


def tip_poses(given):
    """A sensor's positions and directions at the tip in random actuations, to a tenth of a mm and of a degree."""
    rng = np.random.default_rng([given.truth["seed"], 2])
    lengths = np.array([tube.length for tube in given.robot.tubes])
    shape = given.truth["rows"], len(lengths)
    ends = np.cumsum(rng.uniform(*BEYOND, shape)[:, ::-1], axis=1)[:, ::-1]
    translations = np.round(ends - lengths, 4)
    rotations = np.deg2rad(np.round(rng.uniform(-180.0, 180.0, shape), 1))
    recorded = [ctr.Actuation(*each) for each in zip(rotations, translations, strict=True)]
    unknowns = true(given, [(each, ()) for each in recorded])
    x = unknowns.initial
    return synthetic_tip_poses(
        unknowns.robot_at(x),
        [unknowns.experiment_at(x, k) for k in range(len(recorded))],
        given.sensor,
        unknowns.mounting(given.sensor, x),
        sigma=given.sigma["position"],
        direction_sigma=given.sigma["direction"],
        seed=given.truth["seed"],
        recorded=dict(enumerate(recorded)),
    )


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
    parser.add_argument("file", nargs="?", type=Path, default=FILE, help=f"{FILE.name} or {TIP_POSES.name}")
    given = load_calibration(parser.parse_args().file, measured=False)
    comment = f"Synthetic: see {given.path.name}. World frame"
    if given.sensor is not None:
        write_experiments(given.table, tip_poses(given), f"{comment}; tip and direction of a sensor.", decimals=3)
        print(f"{given.table} written")
        return
    made = experiments(given, ctr.load_plan(given.path.parent / "plan.toml"))
    write_experiments(given.table, made, f"{comment}; forces at the inner tube's tip.")
    print(f"{given.table} written; tips of the checks, m:")
    for check, tip in zip(given.checks, checks(given), strict=True):
        print(f"  {check.problem.path.name}: {np.round(tip, 7).tolist()}")


if __name__ == "__main__":
    main()
