"""How hard is the tip pushed, and in which direction, seen from the shape alone?

Cameras give twenty points along the backbone of three tubes, with 0.2 mm of noise. The force across the chord from
entry point to tip is known to a few millinewtons, the force along it hardly. If that matters, give prior knowledge of
the force.
`python examples/force_at_the_tip.py figure.png` draws it.
"""

import sys
from pathlib import Path

import numpy as np

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure

SIGMA = 0.2e-3  # m

# Made-up measurements: robot B pushed by half a newton.
robot = ctr.load_robot(Path(__file__).resolve().parent.parent / "problems" / "three_tubes" / "robot_b.toml")
pose = ctr.Actuation([0.0, 1.0, -1.0], [-0.3, -0.2, -0.1])
truth = np.array([0.24, -0.30, 0.15])
shape = ctr.ForwardProblem(robot).solve(pose, [ctr.PointWrench(truth)])
places = np.linspace(0.1, 1.0, 20) * shape.length
noise = SIGMA * np.random.default_rng(1).normal(size=(20, 3))
seen = ctr.PositionMeasurement(places, shape.position(places) + noise, SIGMA)

estimate = ctr.ForceEstimationProblem(robot, [ctr.TipForce()]).solve(pose, seen)
print(estimate.report())
off = estimate.force - truth
assert off @ np.linalg.solve(estimate.covariance, off) < 16.3  # chi-square of three numbers, 99.9 %
assert estimate.consistent
assert estimate.axes[2].standard_deviation > 20.0 * estimate.axes[0].standard_deviation

# Nothing here pushes harder than some 0.3 N: that is a prior, and it tells most where the shape tells least.
known = ctr.ForceEstimationProblem(robot, [ctr.TipForce(prior=(0.0, 0.3))]).solve(pose, seen)
along, before = known.axes[2], estimate.axes[2]
print(f"\nwith a prior: sd {along.standard_deviation:.3f} N along the chord, {before.standard_deviation:.3f} N without")
assert along.standard_deviation < estimate.axes[2].standard_deviation

# The tubes' actuators turn to a degree or so and their encoders drift: that is an error of the force, too.
loose = ctr.ForceEstimationProblem(robot, [ctr.TipForce()], rotation_sigma=0.01, translation_sigma=0.2e-3)
drifted = loose.solve(pose, seen)
print(f"with loose joints: sd {1e3 * drifted.axes[0].standard_deviation:.1f} mN across the chord,", end=" ")
print(f"{1e3 * estimate.axes[0].standard_deviation:.1f} mN with exact ones")
assert drifted.axes[0].standard_deviation > estimate.axes[0].standard_deviation

if len(sys.argv) > 1:
    save_figure(estimate.plot(), sys.argv[1])
