"""How does a robot lie against a soft wall under its own weight?

A wall that pushes back in proportion to how deep it is pressed is a potential, V(p) = k d(p)^2 / 2 per arc length;
gravity acts on the tubes by their density. Both are conservative, so the shape is a minimum of the energy: found by
`formulation="energy"` it is known to be stable. The two solves against the wall take some twenty seconds each.
"""

from pathlib import Path

import attrs
import casadi as ca
import numpy as np

import ctr_opt as ctr

STIFFNESS, PLACE = 5e3, 0.050  # of the wall, N/m per m of robot; where its face is, x in m

RJW = Path(__file__).resolve().parent.parent / "problems" / "rjw_s1"
# RJW-S1, a synthetic stand-in for the paper's robot, of Nitinol.
tubes = [attrs.evolve(tube, density=6450.0) for tube in ctr.load_robot(RJW / "robot.toml").tubes]
robot = ctr.Robot(tubes)
actuation = ctr.Actuation(rotations=[0.0, 0.0], translations=[-0.1547, -0.0307])
gravity = ctr.Gravity([9.81, 0.0, 0.0])
wall = ctr.PotentialLoad(lambda p: 0.5 * STIFFNESS * ca.fmax(p[0] - PLACE, 0) ** 2, start=0.0)

problem = ctr.ForwardProblem(robot)
free = problem.solve(actuation, [gravity])
held = problem.solve(actuation, [gravity, wall])
stable = ctr.ForwardProblem(robot, formulation="energy").solve(actuation, [gravity, wall])

depth = held.position(held.arc_length)[:, 0] - PLACE
touching = held.arc_length[depth > 0.0]
print(f"without the wall the tip is at x = {1e3 * free.tip_position[0]:.2f} mm")
print(f"with it, the robot lies on it from s = {1e3 * touching[0]:.0f} to {1e3 * touching[-1]:.0f} mm")
print(f"at most {1e3 * depth.max():.1f} mm deep, stable: {held.is_stable}")

# The base holds what weight and wall leave: the wall's push is the base force less the weight.
weight = sum(t.mass_per_length * end for t, end in zip(tubes, held.configuration.tube_ends, strict=True)) * 9.81
s = np.linspace(0.0, held.length, 4001)
push = np.trapezoid(STIFFNESS * np.maximum(held.position(s)[:, 0] - PLACE, 0.0), s)
print(f"weight {weight:.4f} N, push of the wall {push:.4f} N")
np.testing.assert_allclose(held.internal_force(0.0)[0], weight - push, atol=1e-5)

# Shooting and minimum energy agree, each to the default tolerance of 1e-7 of the length.
assert np.linalg.norm(stable.tip_position - held.tip_position) < 2e-7 * held.length
