"""What presses along the robot, as tissue does, and where?

A smooth force per length on the inner tube of robot B: a spline of twelve coefficients for each axis, as smooth as the
evidence says. `python examples/distributed_force.py figure.png` draws it with its band.
"""

import sys
from pathlib import Path

import numpy as np

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure

SIGMA = 0.1e-3  # m

# Made-up measurements: a soft contact, 15 N/m at its middle, 110 mm from the entry, and thirty points of the backbone.
robot = ctr.load_robot(Path(__file__).resolve().parent.parent / "problems" / "three_tubes" / "robot_b.toml")
pose = ctr.Actuation([0.0, 1.0, -1.0], [-0.3, -0.2, -0.1])
grid = np.linspace(0.0, 0.163, 200)
pressure = 15.0 * np.exp(-(((grid - 0.11) / 0.035) ** 2))
truth = np.outer(pressure, [0.8, 0.6, 0.0])
shape = ctr.ForwardProblem(robot).solve(pose, [ctr.DistributedLoad(force=(grid, truth))])
places = np.linspace(0.05, 1.0, 30) * shape.length
noise = SIGMA * np.random.default_rng(3).normal(size=(30, 3))
seen = ctr.PositionMeasurement(places, shape.position(places) + noise, SIGMA)

force = ctr.DistributedForce(coefficients=12, prior=(0.0, 10.0))
estimate = ctr.ForceEstimationProblem(robot, force).solve(pose, seen)
density, errors = estimate.density(grid)
total = np.trapezoid(truth, grid, axis=0)
print(f"in all {np.round(estimate.force, 3).tolist()} N, in truth {np.round(total, 3).tolist()} N")
for s in (0.03, 0.11, 0.15):
    k = int(np.argmin(abs(grid - s)))
    print(f"at {1e3 * s:3.0f} mm: {density[k, 0]:6.2f} +- {errors[k, 0]:.2f} N/m along x, in truth {truth[k, 0]:.2f}")
assert estimate.consistent
inside = np.abs(density - truth)[:, :2] < 2.0 * errors[:, :2]
assert inside.mean() > 0.9
off = (estimate.force - total) @ np.linalg.solve(estimate.force_covariance, estimate.force - total)
assert off < 16.3  # chi-square of three numbers, 99.9 %

if len(sys.argv) > 1:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    for ax, k in zip(figure.subplots(1, 2, sharey=True), (0, 1), strict=True):
        ax.plot(1e3 * grid, truth[:, k], "k--", label="truth")
        (line,) = ax.plot(1e3 * grid, density[:, k], label="estimate")
        low, high = density[:, k] - 1.96 * errors[:, k], density[:, k] + 1.96 * errors[:, k]
        ax.fill_between(1e3 * grid, low, high, color=line.get_color(), alpha=0.2, label="95 %")
        ax.set(xlabel="arc length [mm]", title=f"along {'xy'[k]}")
    figure.axes[0].set_ylabel("force per length [N/m]")
    figure.axes[0].legend(frameon=False)
    save_figure(figure, sys.argv[1])
