"""A tip follows a circle and, half-way, something pulls at it: what then?

The first plan is right for the free robot only: under the load the tip leaves the circle by millimetres. A second plan
starts from the loaded shape. It returns to the circle without a jump, through stable shapes only.
`python load_appears.py figure.png` draws docs/figures/load_appears.png.
"""

import sys
from pathlib import Path

import numpy as np

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure

ROBOT = Path(__file__).resolve().parent.parent / "problems" / "three_tubes" / "robot_b.toml"

robot = ctr.load_robot(ROBOT)
problem = ctr.InverseKinematicsProblem(robot)
start = problem.forward.solve(ctr.Actuation([0.0, 1.0, -1.0], [-0.3, -0.2, -0.1]))
pull = [ctr.PointWrench(force=[0.08, 0.04, 0.0])]

angles = np.linspace(0.0, 2.0 * np.pi, 49)
circle = start.tip_position + 0.008 * np.column_stack((np.cos(angles) - 1.0, np.sin(angles), np.zeros(49)))
free = problem.solve_path(circle, initial=start)
half = free.waypoints[24]

# What the old plan does under the load ...
under = problem.forward.solve_many(
    [ctr.Actuation(*np.split(joints, 2)) for joints in free.actuations[half:]], pull, initial=free.equilibria[half]
)
missed = np.linalg.norm(under.tip_position - free.tip_positions[half:], axis=1)

# ... and the second plan: the current shape is loaded first, then led back to the circle.
replanned = problem.solve_path(circle[24:], pull, initial=free.equilibria[half])
steps = np.abs(np.diff(replanned.actuations, axis=0)).max(axis=0)

print(f"free: {len(free)} points, at most {1e9 * free.position_errors.max():.0f} nm off")
print(f"the old plan under the load: off by {1e3 * missed.min():.1f} to {1e3 * missed.max():.1f} mm")
print(f"planned again: {len(replanned)} points, at most {1e9 * replanned.position_errors.max():.0f} nm off")
print(f"longest step of a joint: {np.rad2deg(steps[:3].max()):.1f} deg, {1e3 * steps[3:].max():.2f} mm")
assert missed.min() > 1e-3
assert max(free.position_errors.max(), replanned.position_errors.max()) < 1e-6
assert steps[:3].max() <= 0.2
assert steps[3:].max() <= 5e-3
assert all(shape.is_stable for shape in replanned.equilibria)

if len(sys.argv) > 1:
    import matplotlib.pyplot as plt

    figure, (top, joints) = plt.subplots(1, 2, figsize=(10.0, 4.8), layout="constrained")
    paths = {
        "planned for the free robot": (free.tip_positions, "C0-"),
        "the same joints under the load": (under.tip_position, "C3--"),
        "planned again under the load": (replanned.tip_positions, "C2.-"),
    }
    for label, (positions, style) in paths.items():
        top.plot(1e3 * positions[:, 0], 1e3 * positions[:, 1], style, label=label)
    top.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal", title="Tip, seen along z")
    top.locator_params(axis="x", nbins=6)
    top.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), frameon=False)
    after = np.vstack((free.actuations[half], replanned.actuations))
    for k, tube in enumerate(robot.tubes):
        joints.plot(np.rad2deg(free.actuations[:, k]), f"C{k}", label=tube.name)
        joints.plot(half + np.arange(len(after)), np.rad2deg(after[:, k]), f"C{k}--")
    joints.set(xlabel="point of the path", ylabel="rotation [deg]", title="Rotations: first plan, and second (dashed)")
    joints.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), frameon=False, ncols=3)
    save_figure(figure, sys.argv[1])
