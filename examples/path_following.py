"""How is a tip steered along a path?

`ForwardProblem.function` is the solved robot as a differentiable CasADi function. Here it stands in a nonlinear program
of its own: at each point of a path, the smallest motion of the actuators that takes the tip there while a weight hangs
from it. IPOPT has exact first and second derivatives through the equilibrium, and the tubes may pass each other.
"""

from pathlib import Path

import casadi as ca
import numpy as np

import ctr_opt as ctr

RJW = Path(__file__).resolve().parent.parent / "problems" / "rjw_s1"

# RJW-S1, a synthetic stand-in for the paper's robot.
robot = ctr.load_robot(RJW / "robot.toml")
weight = ctr.PointWrench(force=[0.0, -0.05, 0.0])
problem = ctr.ForwardProblem(robot)
start = problem.solve(ctr.Actuation([0.6, 0.0], [-0.15, -0.03]), [weight])

forward = problem.function(start, ["rotations", "translations"])
q, before, target = ca.MX.sym("q", 4), ca.MX.sym("before", 4), ca.MX.sym("target", 3)
unknowns = ca.MX.sym("unknowns", len(start.unknowns))
tip = forward(rotations=q[:2], translations=q[2:], initial=unknowns)["tip_position"]
units = np.array([1.0, 1.0, 0.02, 0.02])  # a radian costs as much as 20 mm
program = {
    "x": q,
    "p": ca.vertcat(before, target, unknowns),
    "f": ca.sumsqr((q - before) / units),
    "g": 100.0 * (tip - target),
}
options = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False, "ipopt.tol": 1e-7}
solver = ca.nlpsol("steer", "ipopt", program, options)
reach = -np.array([tube.length for tube in robot.tubes])

# A circle of 10 mm radius around the axis through the tip, in the plane at the height of the tip.
angles = np.linspace(0.0, 2.0 * np.pi, 13)[1:]
center = start.tip_position - [0.010, 0.0, 0.0]
path = center + 0.010 * np.column_stack((np.cos(angles), np.sin(angles), np.zeros(len(angles))))

joints = np.concatenate((start.actuation.rotations, start.actuation.translations))
moments, misses = start.unknowns, []
print("point   rotations [deg]       translations [mm]    off the path [m]")
for k, point in enumerate(path):
    bounds = {"lbx": [-np.inf, -np.inf, *(0.95 * reach)], "ubx": [np.inf, np.inf, 0.0, 0.0], "lbg": 0.0, "ubg": 0.0}
    answer = solver(x0=joints, p=np.concatenate((joints, point, moments)), **bounds)
    assert solver.stats()["success"]
    joints = answer["x"].full()[:, 0]
    shape = problem.solve(ctr.Actuation(joints[:2], joints[2:]), [weight], initial=start)  # the answer, solved anew
    moments, start = shape.unknowns, shape
    misses.append(np.linalg.norm(shape.tip_position - point))
    print(f"{k:5d}   {np.rad2deg(joints[0]):8.2f} {np.rad2deg(joints[1]):8.2f}", end="")
    print(f"     {1e3 * joints[2]:8.2f} {1e3 * joints[3]:8.2f}     {misses[-1]:.1e}")
assert max(misses) < 1e-7  # ten nanometres and more are left to the tolerances of both solvers
