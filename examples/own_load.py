"""How is a user-defined load described?

It is given as CasADi expressions of arc length, position and orientation. This example is a magnet at the tip: in the
field B(p), a dipole of moment m along the tangent has the torque m x B and the force (dB/dp)^T m. CasADi computes the
derivatives, so the solver has them exactly.
"""

import casadi as ca
import numpy as np

import ctr_opt as ctr

MAGNET = 0.08  # A m^2
SOURCE = ca.DM([0.12, 0.0, 0.10])  # where a dipole of 15 A m^2 along x stands, m
STRENGTH = ca.DM([15.0, 0.0, 0.0])


def field(p):
    """The flux density of the dipole, T."""
    r = p - SOURCE
    distance = ca.norm_2(r)
    n = r / distance
    return 1e-7 * (3.0 * n * ca.dot(n, STRENGTH) - STRENGTH) / distance**3


def pull(s, p, R):
    """Force (N) and moment (N m) on the magnet, world frame."""
    m = MAGNET * R[:, 2]
    x = ca.SX.sym("x", 3)
    slope = ca.Function("slope", [x], [ca.jacobian(field(x), x)])
    return slope(p).T @ m, ca.cross(m, field(p))


tube = ctr.Tube("catheter", 1.0e-3, 0.6e-3, ctr.Arc(0.12, 4.0), youngs_modulus=2e9, poisson_ratio=0.4)
robot = ctr.Robot([tube])
problem = ctr.ForwardProblem(robot)
straight_in = ctr.Actuation([0.0], [0.0])
magnet = ctr.ExpressionLoad(pull)

free = problem.solve(straight_in)
pulled = problem.solve(straight_in, [magnet])
force, moment = (
    np.array(part).ravel() for part in pull(0.0, ca.DM(pulled.tip_position), ca.DM(pulled.tip_pose[:3, :3]))
)
moved = np.linalg.norm(pulled.tip_position - free.tip_position)
print(
    f"the magnet pulls with {1e3 * np.linalg.norm(force):.2f} mN and turns with {1e3 * np.linalg.norm(moment):.3f} N mm"
)
print(f"and moves the tip by {1e3 * moved:.2f} mm ({pulled.path}, {pulled.iterations} iterations)")

# Held as they are where the robot came to rest, force and moment must hold it there.
dead = problem.solve(straight_in, [ctr.PointWrench(force, moment)], initial=pulled)
difference = np.linalg.norm(dead.tip_position - pulled.tip_position)
print(f"the same wrench, dead: {difference:.1e} m away")
assert difference < 2e-7 * pulled.length  # two solves, each to the default tolerance
assert moved > 1e-3
