"""Can a controller steer the tip with exact Jacobians, and how often a second?

Resolved rates: at each tick the Jacobian turns the way to the next point of the path into a step of the actuators,
while a load drags at the tip. The solver is compiled beforehand; without a compiler the same runs slower.
"""

from contextlib import suppress
from pathlib import Path
from time import perf_counter

import numpy as np

import ctr_opt as ctr

ROBOT = Path(__file__).resolve().parent.parent / "problems" / "three_tubes" / "robot_b.toml"
TICKS = 400

robot = ctr.load_robot(ROBOT)
problem = ctr.ForwardProblem(robot)
with suppress(ctr.CompilationError):
    problem.compile()
drag = [ctr.PointWrench(force=[0.02, 0.0, -0.01])]
shape = problem.solve(ctr.Actuation([0.0, 1.0, -1.0], [-0.3, -0.2, -0.1]), drag)

# A figure of eight, 4 mm wide, around where the tip is.
t = np.linspace(0.0, 2.0 * np.pi, TICKS)
path = shape.tip_position + 0.002 * np.column_stack((np.sin(t), 0.5 * np.sin(2.0 * t), np.zeros(TICKS)))

units = np.array([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])  # a radian costs as much as 20 mm
misses, softest, begin = [], 0.0, perf_counter()
for point in path:
    steering = shape.jacobian()[:3] * units
    step = units * np.linalg.lstsq(steering, point - shape.tip_position, rcond=None)[0]
    rotations, translations = shape.actuation.rotations + step[:3], shape.actuation.translations + step[3:]
    shape = problem.solve(ctr.Actuation(rotations, np.minimum(translations, 0.0)), drag, initial=shape)
    softest = max(softest, np.linalg.norm(shape.compliance()[:3, :3], 2))
    misses.append(np.linalg.norm(shape.tip_position - point))
tick = (perf_counter() - begin) / TICKS

print(f"{TICKS} ticks, each of one solve, one Jacobian and one compliance: {1e3 * tick:.2f} ms a tick")
print(f"the tip is off the path by {1e6 * np.mean(misses):.2f} um on average, at most {1e6 * max(misses):.2f} um")
print(f"largest compliance on the way: {softest:.4f} m/N")
assert max(misses) < 1e-5  # the square of a step of 0.03 mm, over a radius of curvature of some mm
assert shape.is_stable
