"""From which directions can a tip come to one point, while a load pulls at it?

Three tubes have six joints. A position leaves three of them free: the answer nearest to the start is returned. A
position and an axis leave one. A target out of reach is reported, with the nearest shape.
`python inverse_kinematics.py figure.png` draws docs/figures/inverse_kinematics.png.
"""

import sys
from pathlib import Path

import numpy as np

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure

ROBOT = Path(__file__).resolve().parent.parent / "problems" / "three_tubes" / "robot_b.toml"

robot = ctr.load_robot(ROBOT)
limits = ctr.JointLimits(rotations=[[-2.0 * np.pi, 2.0 * np.pi]] * 3, base_gap=0.01, tip_gap=0.005)
problem = ctr.InverseKinematicsProblem(robot, limits=limits)
pull = [ctr.PointWrench(force=[0.02, 0.0, 0.0])]
point = np.array([0.02, -0.02, 0.15])

answer = problem.solve(point, pull)
print(answer.report(), "\n")
assert answer.converged

# The same point, its axis turned away from the one that came out, in the plane of the entry's axis.
axis = answer.equilibrium.tip_pose[:3, 2]
across = np.cross([0.0, 0.0, 1.0], axis) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], axis))
answers = {}
for degrees in (-15, -10, -5, 0, 5, 10, 15, 60):
    turn = np.deg2rad(degrees)
    wanted = np.cos(turn) * axis + np.sin(turn) * np.cross(across, axis)
    turned = answers[degrees] = problem.solve(point, pull, answer.equilibrium, target_axis=wanted)
    print(f"axis turned by {degrees:4d} deg: {turned.status.description}, {1e3 * turned.solve_time:5.1f} ms", end="")
    print("" if turned.converged else f"; {turned.message}")

reached = [answer for answer in answers.values() if answer.converged]
exact = ctr.ForwardProblem(robot, tolerance=1e-10)
for answer in reached:  # check every answer with a tighter forward solve
    shape = exact.solve(answer.actuation, pull, answer.equilibrium)
    assert np.linalg.norm(shape.tip_position - point) < 1e-6
    assert shape.is_stable
assert len(reached) >= 3
assert not answers[60].converged

if len(sys.argv) > 1:
    import matplotlib.pyplot as plt

    figure, views = plt.subplots(2, 1, figsize=(8.0, 3.1), sharex=True, layout="constrained")
    for view, k in zip(views, (0, 1), strict=True):
        for degrees, answer in answers.items():
            if answer.converged:
                shape = answer.equilibrium
                along = 1e3 * shape.position(np.linspace(0.0, shape.length, 200))
                view.plot(along[:, 2], along[:, k], label=f"{degrees} deg")
        view.plot(*(1e3 * point[[2, k]]), "ko")
        view.set(ylabel=f"{'xy'[k]} [mm]", aspect="equal")
    views[1].set(xlabel="z [mm]")
    figure.legend(*views[0].get_legend_handles_labels(), loc="outside right center", title="axis turned by")
    figure.suptitle("Backbones that reach one point from several directions")
    save_figure(figure, sys.argv[1])
