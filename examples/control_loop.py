"""Can a controller steer the tip with exact Jacobians, and how often a second?

Resolved rates: at each tick the Jacobian converts the motion to the next point of the path into a step of the
actuators, while a load acts on the tip. Inverse kinematics follows the same path within the limits of the joints.
`python control_loop.py figure.png` draws docs/figures/control_loop.png. Without a compiler it runs slower.
"""

import sys
from contextlib import suppress
from pathlib import Path
from time import process_time

import numpy as np

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure

ROBOT = Path(__file__).resolve().parent.parent / "problems" / "three_tubes" / "robot_b.toml"
TICKS = 400

robot = ctr.load_robot(ROBOT)
problem = ctr.ForwardProblem(robot)
with suppress(ctr.CompilationError):
    problem.compile()
drag = [ctr.PointWrench(force=[0.02, 0.0, -0.01])]
start = problem.solve(ctr.Actuation([0.0, 1.0, -1.0], [-0.3, -0.2, -0.1]), drag)

# A figure of eight, 4 mm wide, around where the tip is.
t = np.linspace(0.0, 2.0 * np.pi, TICKS)
path = start.tip_position + 0.002 * np.column_stack((np.sin(t), 0.5 * np.sin(2.0 * t), np.zeros(TICKS)))

units = np.array([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])  # a radian costs as much as 20 mm
shape, tips, softest, begin = start, [], 0.0, process_time()
for point in path:
    steering = shape.jacobian()[:3] * units
    step = units * np.linalg.lstsq(steering, point - shape.tip_position, rcond=None)[0]
    rotations, translations = shape.actuation.rotations + step[:3], shape.actuation.translations + step[3:]
    shape = problem.solve(ctr.Actuation(rotations, np.minimum(translations, 0.0)), drag, initial=shape)
    softest = max(softest, np.linalg.norm(shape.compliance()[:3, :3], 2))
    tips.append(shape.tip_position)
tick = (process_time() - begin) / TICKS
misses = np.linalg.norm(tips - path, axis=1)

print(f"{TICKS} ticks, each of one solve, one Jacobian and one compliance: {1e3 * tick:.2f} ms of processor a tick")
print(f"the tip is off the path by {1e6 * np.mean(misses):.2f} um on average, at most {1e6 * max(misses):.2f} um")
print(f"largest compliance on the way: {softest:.4f} m/N")
assert max(misses) < 1e-5  # the square of a step of 0.03 mm, over a radius of curvature of some mm
assert shape.is_stable

# The same by inverse kinematics, every eighth point.
kinematics = ctr.InverseKinematicsProblem(robot)
here, answers = start, []
for point in path[::8]:
    answers.append(kinematics.solve(point, drag, initial=here))
    here = answers[-1].equilibrium
errors = np.array([answer.position_error for answer in answers])
times = 1e3 * np.array([answer.solve_time for answer in answers])
print(f"inverse kinematics: at most {1e9 * errors.max():.1f} nm off, {np.median(times):.2f} ms a point")
assert all(answer.converged and answer.starts == 1 for answer in answers)

if len(sys.argv) > 1:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.0), layout="constrained")
    above, off = figure.subplots(1, 2)
    above.plot(*1e3 * path[:, :2].T, color="#E69F00", lw=4.0, label="path")
    above.plot(*1e3 * np.array(tips)[:, :2].T, "--", color="#0072B2", label="tip")
    above.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    off.semilogy(np.arange(1, TICKS), 1e6 * misses[1:], color="#0072B2", label="resolved rates")
    off.semilogy(np.arange(8, TICKS, 8), 1e6 * errors[1:], ".", color="#009E73", label="inverse kinematics")
    off.set(xlabel="tick", ylabel="distance from the path [um]")
    for view in (above, off):
        view.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    save_figure(figure, sys.argv[1])
