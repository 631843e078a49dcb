"""A tip follows a circle and, half-way, something pulls at it: what then?

The plan goes on to be right for the free robot only: the tip leaves the circle by millimetres. From the shape that the
load has made of the robot the rest is planned anew, without a jump and through stable shapes, on the circle again.
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

# ... and the plan anew: the current shape is loaded first, then led back to the circle.
anew = problem.solve_path(circle[24:], pull, initial=free.equilibria[half])
steps = np.abs(np.diff(anew.actuations, axis=0)).max(axis=0)

print(f"free: {len(free)} points, at most {1e9 * free.position_errors.max():.0f} nm off")
print(f"the old plan under the load: off by {1e3 * missed.min():.1f} to {1e3 * missed.max():.1f} mm")
print(f"planned anew: {len(anew)} points, at most {1e9 * anew.position_errors.max():.0f} nm off")
print(f"longest step of a joint: {np.rad2deg(steps[:3].max()):.1f} deg, {1e3 * steps[3:].max():.2f} mm")
assert missed.min() > 1e-3
assert max(free.position_errors.max(), anew.position_errors.max()) < 1e-6
assert steps[:3].max() <= 0.2
assert steps[3:].max() <= 5e-3
assert all(shape.is_stable for shape in anew.equilibria)

if len(sys.argv) > 1:
    import matplotlib.pyplot as plt

    figure, (top, joints) = plt.subplots(1, 2, figsize=(10.0, 4.2), layout="constrained")
    for positions, style in ((free.tip_positions, "C0-"), (under.tip_position, "C3--"), (anew.tip_positions, "C2.-")):
        top.plot(1e3 * positions[:, 0], 1e3 * positions[:, 1], style)
    top.legend(
        ["planned, free", "the old plan under the load", "planned anew"],
        loc="upper center",
        bbox_to_anchor=(0.46, 0.71),
        fontsize="small",
    )
    top.set(xlabel="x, mm", ylabel="y, mm", aspect="equal", title="the tip, from above")
    for k, color in enumerate(("C0", "C1", "C2")):
        joints.plot(np.rad2deg(free.actuations[:, k]), color, label=f"tube {k}")
        after = np.vstack((free.actuations[half], anew.actuations))
        joints.plot(half + np.arange(len(after)), np.rad2deg(after[:, k]), color + "--")
    joints.legend()
    joints.set(xlabel="point", ylabel="rotation, deg", title="rotations: planned, and anew (dashed)")
    save_figure(figure, sys.argv[1])
