"""What is the precurvature of a tube that two cameras see, and how well is it known?

Points along a tube, 2 mm apart and with noise of 0.1 mm, become its precurvature with standard errors, and with it a
tube. The tube is the inner one of RJW-S1, a synthetic stand-in: no number here is a result of the paper. With a path,
`python precurvature_of_a_tube.py figure.png`, it draws what the paper's Fig. 5 shows.
"""

import sys
from pathlib import Path

import attrs
import numpy as np

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure
from ctr_opt.sensing import identify_precurvature

RJW = Path(__file__).resolve().parent.parent / "problems" / "rjw_s1"
NOISE = 1e-4  # m, in each coordinate

tube = ctr.load_robot(RJW / "robot.toml").tubes[0]
straight, curved = tube.precurvature
alone = ctr.ForwardProblem(ctr.Robot([attrs.evolve(tube, precurvature=curved)])).solve(ctr.Actuation([0.0], [0.0]))
s = np.linspace(0.0, curved.length, 51)
points = alone.position(s) + NOISE * np.random.default_rng(5).normal(size=(51, 3))

free = identify_precurvature(points, straight=straight.length)
fit = identify_precurvature(points, straight=straight.length, tangent=[0.0, 0.0, 1.0])
print(fit.report())

# A preset twist would not be seen in the shape of one tube; this tube has none, so Bishop's frame is its own.
q = fit.arc_length / curved.length
truth = sum(row * q[:, None] ** k for k, row in enumerate(curved.coefficients))[:, :2]
worst = np.abs((fit.curvature[:, :2] - truth) / fit.standard_errors).max()
print(f"\nfarthest from the truth: {worst:.2f} standard errors")
assert worst < 4.0
assert abs(fit.sigma / NOISE - 1.0) < 0.25  # estimated from some 90 residuals: 1 / sqrt(2 * 90) = 7 percent

# A tube of the measured precurvature ends near the true one's tip, if the direction of the straight part is known.
pose = ctr.Actuation([0.0], [-straight.length])
tip = {}
for name, pieces in (("true", tube.precurvature), ("free", free.pieces), ("clamped", fit.pieces)):
    robot = ctr.Robot([attrs.evolve(tube, precurvature=pieces)])
    tip[name] = ctr.ForwardProblem(robot).solve(pose).tip_position
apart = {name: np.linalg.norm(tip[name] - tip["true"]) for name in ("free", "clamped")}
print(f"its tip is {1e3 * apart['clamped']:.3f} mm from the true tube's", end=", ")
print(f"{1e3 * apart['free']:.3f} mm if the direction of the base is not given")
assert apart["clamped"] < 10.0 * NOISE

if len(sys.argv) > 1:
    axes = fit.plot()
    for values, color in zip(truth.T, ("#0072B2", "#D55E00"), strict=True):
        axes.plot(1e3 * (straight.length + fit.arc_length), values, color=color, lw=0.9, ls=":")
    save_figure(axes.figure, sys.argv[1])
