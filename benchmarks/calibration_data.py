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


def true(calibration, cases):
    """The parameters as unknowns whose initial values are the true ones."""
    values, named = (
        calibration.truth["values"],
        {getattr(parameter, "name", parameter): parameter for parameter in calibration.parameters},
    )
    tied = {name: getattr(parameter, "tied", ()) for name, parameter in named.items()}
    wanted = [ctr.Parameter(name, initial=value, tied=tied.get(name, ())) for name, value in values.items()]
    return Unknowns(calibration.robot, cases, wanted)


def true_robot(calibration):
    """The robot that the data are of."""
    unknowns = true(calibration, [])
    return unknowns.robot_at(unknowns.initial)


def experiments(calibration, plan):
    """The experiments of the plan, as measured, one of them with a mistyped angle."""
    cases = [(problem.actuation, problem.loads) for problem in plan.problems]
    k = calibration.truth["outlier"] - 1
    recorded = {k: cases[k][0]}
    stood = np.array([calibration.truth["rotation"], *cases[k][0].rotations[1:]])
    cases[k] = attrs.evolve(cases[k][0], rotations=stood), cases[k][1]
    sigma, seed = calibration.sigma["position"], calibration.truth["seed"]
    return synthetic_experiments(true_robot(calibration), cases, PLACES, sigma=sigma, seed=seed, recorded=recorded)


def tip_poses(calibration):
    """A sensor's positions and directions at the tip in random actuations, to a tenth of a mm and of a degree."""
    rng = np.random.default_rng([calibration.truth["seed"], 2])
    lengths = np.array([tube.length for tube in calibration.robot.tubes])
    shape = calibration.truth["rows"], len(lengths)
    ends = np.cumsum(rng.uniform(*BEYOND, shape)[:, ::-1], axis=1)[:, ::-1]
    translations = np.round(ends - lengths, 4)
    rotations = np.deg2rad(np.round(rng.uniform(-180.0, 180.0, shape), 1))
    recorded = [ctr.Actuation(*pair) for pair in zip(rotations, translations, strict=True)]
    unknowns = true(calibration, [(actuation, ()) for actuation in recorded])
    x = unknowns.initial
    return synthetic_tip_poses(
        unknowns.robot_at(x),
        [unknowns.experiment_at(x, k) for k in range(len(recorded))],
        calibration.sensor,
        unknowns.mounting(calibration.sensor, x),
        sigma=calibration.sigma["position"],
        direction_sigma=calibration.sigma["direction"],
        seed=calibration.truth["seed"],
        recorded=dict(enumerate(recorded)),
    )


def checks(calibration):
    """Tips of the problems that are measured but not fitted, m."""
    rng = np.random.default_rng([calibration.truth["seed"], 1])
    robot = true_robot(calibration)
    tips = []
    for check in calibration.checks:
        problem = check.problem
        tip = ctr.ForwardProblem(robot).solve(problem.actuation, problem.loads).tip_position
        tips.append(tip + np.array(calibration.sigma["position"]) * rng.normal(size=3))
    return tips


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", nargs="?", type=Path, default=FILE, help=f"{FILE.name} or {TIP_POSES.name}")
    calibration = load_calibration(parser.parse_args().file, measured=False)
    comment = f"Synthetic: see {calibration.path.name}. World frame"
    if calibration.sensor is not None:
        write_experiments(
            calibration.table, tip_poses(calibration), f"{comment}; tip and direction of a sensor.", decimals=3
        )
        print(f"{calibration.table} written")
        return
    made = experiments(calibration, ctr.load_plan(calibration.path.parent / "plan.toml"))
    write_experiments(calibration.table, made, f"{comment}; forces at the inner tube's tip.", decimals=4)
    print(f"{calibration.table} written; tips of the checks, m:")
    for check, tip in zip(calibration.checks, checks(calibration), strict=True):
        print(f"  {check.problem.path.name}: {np.round(tip, 7).tolist()}")


if __name__ == "__main__":
    main()
