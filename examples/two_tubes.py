"""How do two tubes share one shape?

Each tube would like its own curve, but one is inside the other. Their common curvature is the mean of what they want,
weighted by stiffness; and as each may twist, they turn toward each other on the way to the tip.
"""

from pathlib import Path

import numpy as np

import ctr_opt as ctr

PROBLEMS = Path(__file__).resolve().parent.parent / "problems" / "two_tubes"

# In one plane nothing twists. The tubes bend alike (aligned) or against each other (opposed).
planar = ctr.load_robot(PROBLEMS / "robot_planar.toml")
stiffness = np.array([tube.bending_stiffness for tube in planar.tubes])
wanted = np.array([5.0, 8.0])  # 1/m
for name, signs in (("aligned", [1.0, 1.0]), ("opposed", [1.0, -1.0])):
    shape = ctr.load_problem(PROBLEMS / f"{name}.toml").solve()
    shared = shape.curvature(0.05)[1]
    mean = stiffness @ (wanted * signs) / stiffness.sum()
    print(f"{name}: curvature {shared:+.6f} 1/m, the weighted mean is {mean:+.6f} 1/m")
    # Without load or torsion this is one linear equation at each place: right to rounding.
    assert abs(shared - mean) < 1e-12

# Turned by 120 degrees at their bases, two equal arcs unwind.
twisted = ctr.load_problem(PROBLEMS / "torsion.toml").solve()
length = twisted.length
for s in (0.0, 0.5 * length, length):
    angle = np.degrees(twisted.tube_angle(1, s) - twisted.tube_angle(0, s))
    rates = [twisted.torsion(i, s) for i in (0, 1)]
    print(f"s = {1e3 * s:5.1f} mm: {angle:7.3f} degrees apart, torsions {rates[0]:+.4f} and {rates[1]:+.4f} 1/m")

# The angle a between them is a pendulum's, a'' = (2 / L^2) sin(a), with a first integral: a'^2 / 2 + (2 / L^2) cos(a)
# is the same at both ends, and at the tip, where nothing holds the tubes, a' = 0.
first, last = (twisted.tube_angle(1, s) - twisted.tube_angle(0, s) for s in (0.0, length))
rate = twisted.torsion(1, 0.0) - twisted.torsion(0, 0.0)
change = 0.5 * (rate * length) ** 2 - 2.0 * (np.cos(last) - np.cos(first))
print(f"the first integral is off by {change:.1e} between base and tip")
assert abs(change) < 1e-6  # the default tolerance of 1e-7, ten times for a sum of terms of order one
