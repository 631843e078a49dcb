"""Where does something press on the robot, and how hard?

From raw points to "0.50 +- 0.13 N at 129.6 +- 2.3 mm": a table has thirty points of RJW-S1's backbone at unknown arc
lengths; the robot is known. `python examples/unknown_contact.py figure.png` draws it.
"""

import sys
from pathlib import Path

import numpy as np

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure

PROBLEMS = Path(__file__).resolve().parent.parent / "problems"

robot = ctr.load_robot(PROBLEMS / "rjw_s1" / "robot.toml")
pose = ctr.Actuation(np.deg2rad([90.0, 0.0]), [-0.150, -0.0307])
points = 1e-3 * np.loadtxt(PROBLEMS / "force_contact" / "points.csv", delimiter=",", skiprows=2)
seen = ctr.BackboneMeasurement(points, sigma=0.2e-3, ordered=True)

# Is it pushed at all? Without a force the shape does not fit.
free = ctr.ForwardProblem(robot).solve(pose)
gaps = np.linalg.norm(free.position(np.linspace(0.0, free.length, 400))[:, None] - points, axis=2).min(axis=0)
print(f"without a force the points are up to {1e3 * gaps.max():.1f} mm off the backbone, the noise is 0.2 mm")
assert gaps.max() > 1e-3

# One contact, somewhere; forces here are of the size of a newton.
contact = ctr.PointForce(prior=(0.0, 1.0))
estimate = ctr.ForceEstimationProblem(robot, [contact]).solve(pose, seen)
print(estimate.report())
size = np.linalg.norm(estimate.force)
unit = estimate.force / size
error = np.sqrt(unit @ estimate.force_covariance @ unit)
place, doubt = 1e3 * estimate.arc_length, 1e3 * estimate.arc_length_error
print(f"\n{size:.2f} +- {error:.2f} N at {place:.1f} +- {doubt:.1f} mm")
assert estimate.consistent
assert abs(place - 131.0) < 3.0 * doubt  # the truth of these made-up data

# What pushes across the robot bends it and is known well; what pushes along it is not.
across, _, along = (axis.standard_deviation for axis in estimate.axes)
assert along > 20.0 * across

# The loads are ready for a forward problem: how far does the tip move when the contact is gone?
moved = np.linalg.norm(estimate.shape.tip_position - free.tip_position)
print(f"the contact holds the tip {1e3 * moved:.1f} mm from where it would be")
assert estimate.loads

if len(sys.argv) > 1:
    save_figure(estimate.plot(), sys.argv[1])
