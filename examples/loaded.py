"""What does a force at the tip do to a concentric-tube robot?

The actuation and the size of the force are those of the paper's Fig. 9. The robot, RJW-S1, is a synthetic stand-in: no
number here is a result of the paper. `python loaded.py figure.png` draws docs/figures/fig9.png.
"""

import sys
from pathlib import Path

import numpy as np

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure
from ctr_opt.forward.plot import figure_equilibrium

RJW = Path(__file__).resolve().parent.parent / "problems" / "rjw_s1"

robot = ctr.load_robot(RJW / "robot.toml")
problem = ctr.ForwardProblem(robot)
pose = ctr.Actuation(rotations=np.deg2rad([135.0, 0.0]), translations=[-0.1547, -0.0307])
force = 0.981 * np.array([-0.48, 0.64, -0.60])  # N

free = problem.solve(pose)
pushed = problem.solve(pose, [ctr.PointWrench(force=force)], initial=free)
print(pushed.report())
moved = pushed.tip_position - free.tip_position
print(f"\nthe tip moves by {1e3 * np.linalg.norm(moved):.2f} mm, {1e3 * moved @ force / 0.981:.2f} mm along the force")

# The force pulls on every cross section alike, and turns the base with its lever.
np.testing.assert_allclose(pushed.internal_force(0.0), force, atol=1e-12)  # rounding
np.testing.assert_allclose(pushed.internal_moment(0.0), np.cross(pushed.tip_position, force), atol=1e-7)

# Twice integrated: by the solver to its tolerance of 1e-7 of the length, and anew, adaptively, by SciPy.
assert pushed.verify() < 1e-7 * pushed.length

# The file of this problem holds the tip from a third, independent computation, with a tolerance of its own.
for name, (deviation, allowed) in ctr.load_problem(RJW / "fig9_loaded.toml").deviations(pushed).items():
    print(f"{name}: {deviation:.1e} from the expected value, {allowed:.0e} allowed")
    assert deviation <= allowed

if len(sys.argv) > 1:
    figure = figure_equilibrium(pushed, free)
    figure.set_size_inches(11.0, 7.2)
    save_figure(figure, sys.argv[1])
