"""How far does a rod bend?

A straight rod is clamped at the entry point and pulled sideways at its tip. The force keeps its direction however far
the rod bends, so the answer is Euler's elastica and known in elliptic functions.
"""

import numpy as np
from scipy.special import ellipk, ellipkinc

import ctr_opt as ctr

length, stiffness = 0.1, 0.02  # m, N m^2
rod = ctr.Tube(
    "rod",
    outer_diameter=1.5e-3,
    inner_diameter=0.0,
    precurvature=ctr.Straight(length),
    bending_stiffness=stiffness,
    torsional_stiffness=0.015,
)
problem = ctr.ForwardProblem(ctr.Robot([rod]))
held = ctr.Actuation(rotations=[0.0], translations=[0.0])  # its base is held at the entry point, unturned

for force in (2.0, 5.0, 20.0):  # N
    bent = problem.solve(held, [ctr.PointWrench(force=[force, 0.0, 0.0])])
    x, _, z = bent.tip_position
    angle = np.arccos(bent.tip_pose[2, 2])  # the tip's tangent is the third column of its pose
    print(f"{force:4.0f} N: tip {1e3 * x:7.4f} mm aside, {1e3 * (length - z):7.4f} mm lower", end=", ")
    print(f"leaning by {np.degrees(angle):6.3f} degrees")

# Elastica: with k^2 = (1 + sin(angle)) / 2 and F(phi) the incomplete integral, sin(phi) = 1 / (k sqrt(2)),
#     sqrt(force / stiffness) length = K(k) - F(phi, k).
m = (1.0 + np.sin(angle)) / 2.0
elastica = stiffness / length**2 * (ellipk(m) - ellipkinc(np.arcsin(1.0 / np.sqrt(2.0 * m)), m)) ** 2
print(f"the force that bends it by that last angle, from elliptic functions: {elastica:.7f} N")

# The default tolerance is 1e-7 of the length in position, here 1e-8 m. An angle has no tolerance of its own; a tip that
# is 1e-7 lengths off turns by about as much, and the elastica's force grows by 90 N per radian there.
assert abs(elastica - 20.0) < 90.0 * 1e-7
