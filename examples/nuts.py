"""How many nuts make a distributed load?

The paper (Figs. 10 and 11) hangs 56.96 g of nuts on its cannula to load it all along. N equal masses in the middles of
N equal parts are the midpoint rule for an even load, so the tip they give differs by the order of 1 / N^2. The robot,
RJW-S1, is a synthetic stand-in: no number here is a result of the paper.
"""

from pathlib import Path

import numpy as np

import ctr_opt as ctr

RJW = Path(__file__).resolve().parent.parent / "problems" / "rjw_s1"
MASS = 0.05696  # kg

even = ctr.load_problem(RJW / "nuts_distributed.toml")
gravity = even.loads[0]
problem = ctr.ForwardProblem(even.robot, tolerance=1e-9)
free = problem.solve(even.actuation)
spread = problem.solve(even.actuation, even.loads)
sag = spread.tip_position - free.tip_position
print(f"{1e3 * MASS:.2f} g on {1e3 * free.length:.1f} mm, spread evenly", end=" ")
print(f"move the tip by {1e3 * np.linalg.norm(sag):.3f} mm")


def hung(count):
    """The robot with so many nuts."""
    middles = (np.arange(count) + 0.5) * free.length / count
    nuts = [ctr.PointMass(MASS / count, arc_length=s) for s in middles]
    return problem.solve(even.actuation, [gravity, *nuts], initial=spread)


counts = np.array([3, 6, 12, 24, 48, 96])
errors = np.array([np.linalg.norm(hung(count).tip_position - spread.tip_position) for count in counts])
for count, error in zip(counts, errors, strict=True):
    print(f"{count:3} nuts: {1e6 * error:9.3f} um from the even load, times N^2: {1e3 * error * count**2:.3f} mm")

# Second order: four times as near with twice as many. With few nuts it also matters where the tubes' ends lie between
# them; from 24 on the ratio is 4 to half a percent.
ratios = errors[:-1] / errors[1:]
np.testing.assert_allclose(ratios[3:], 4.0, rtol=5e-3)

# And not noise: every tip is known to 1e-9 of the length.
assert errors[-1] > 100.0 * 1e-9 * free.length
