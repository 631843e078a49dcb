"""Where can the tip go?

The paper's plan turns the inner tube to eight angles at each of five translations (Fig. 7). That is enough: turning
both tubes by the same angle turns the whole robot about the z axis, so its tips, turned, fill the workspace. The robot,
RJW-S1, is a synthetic stand-in: no number here is a result of the paper.
"""

from pathlib import Path

import numpy as np

import ctr_opt as ctr

RJW = Path(__file__).resolve().parent.parent / "problems" / "rjw_s1"

plan = ctr.load_plan(RJW / "plan.toml")
problem = ctr.ForwardProblem(plan.robot)
shapes = [problem.solve(case.actuation) for case in plan.problems if not case.loads]
tips = np.array([shape.tip_position for shape in shapes]).reshape(5, 8, 3)

print("length [mm]   distance of the tip from the axis [mm]   height [mm]")
for row, first in zip(tips, shapes[::8], strict=True):
    distance, height = 1e3 * np.hypot(*row.T[:2]), 1e3 * row[:, 2]
    print(f"{1e3 * first.length:11.1f}   {distance.min():14.2f} to {distance.max():6.2f}", end="")
    print(f"   {height.min():17.2f} to {height.max():6.2f}")

# Turned rigidly: the same robot with both bases turned by 40 degrees more.
turn = np.deg2rad(40.0)
pose = plan.problems[0].actuation
turned = problem.solve(ctr.Actuation(pose.rotations + turn, pose.translations))
about_z = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
difference = np.linalg.norm(turned.tip_position - about_z @ shapes[0].tip_position)
print(f"turning both tubes by 40 degrees turns the tip about z, to {difference:.1e} m")
assert difference < 2.0 * 1e-7 * turned.length  # two solves, each to the default tolerance

# The tip comes closest to the axis where the tubes' curves oppose each other, and farthest where they are aligned.
distances = np.hypot(tips[..., 0], tips[..., 1])
assert np.all(distances.argmax(axis=1) == 0)
assert np.all(distances.argmin(axis=1) == 4)
