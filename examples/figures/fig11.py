"""Nuts along the cannula, as in the paper's Figs. 10 and 11: `python examples/figures/fig11.py figure.png`.

RJW-S1, a synthetic robot: unloaded, under 24 nuts, and under the same mass spread evenly; and how far the tip under N
nuts is from that under the even load.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure

RJW = Path(__file__).resolve().parents[2] / "problems" / "rjw_s1"
MASS = 0.05696  # kg
COUNTS = np.array([3, 6, 12, 24, 48, 96])


def main(path):
    """Solve, draw, save."""
    strung, even = (ctr.load_problem(RJW / f"nuts_{name}.toml") for name in ("discrete", "distributed"))
    problem = ctr.ForwardProblem(even.robot, tolerance=1e-9)
    free, hung, spread = (problem.solve(even.actuation, loads) for loads in ((), strung.loads, even.loads))
    figure = Figure(figsize=(10.5, 5.0), layout="constrained")
    shapes, errors = figure.subplots(1, 2, width_ratios=(1.0, 1.1))

    nuts = np.array([load.arc_length for load in strung.loads if isinstance(load, ctr.PointMass)])
    for shape, label, style in (
        (free, "unloaded", {"color": "0.6", "ls": "--", "lw": 1.5}),
        (spread, "56.96 g spread evenly", {"color": "#0072B2", "lw": 1.5}),
    ):
        shapes.plot(*1e3 * shape.position(shape.arc_length)[:, [0, 2]].T, label=label, **style)
    shapes.plot(*1e3 * hung.position(nuts)[:, [0, 2]].T, "o", color="#D55E00", ms=5, label=f"{len(nuts)} nuts")
    shapes.annotate("gravity", (-38, 165), (-14, 165), arrowprops={"arrowstyle": "->", "lw": 1.2}, va="center")
    shapes.set(aspect="equal", xlabel="x [mm]", ylabel="z [mm]", xlim=(-45, 145), ylim=(-5, 212))
    shapes.legend(loc="lower right", frameon=False)

    apart = []
    for count in COUNTS:
        middles = (np.arange(count) + 0.5) * free.length / count
        masses = [ctr.PointMass(MASS / count, arc_length=s) for s in middles]
        shape = problem.solve(even.actuation, [even.loads[0], *masses], initial=spread)
        apart.append(1e6 * np.linalg.norm(shape.tip_position - spread.tip_position))
    errors.loglog(COUNTS, apart, "o-", color="#D55E00")
    errors.loglog(COUNTS, apart[-1] * (COUNTS[-1] / COUNTS) ** 2.0, "k:", lw=1.2, label=r"$\propto N^{-2}$")
    errors.set(xlabel="number of nuts N", ylabel="distance of the tip from that under the even load [µm]")
    errors.set_xticks(COUNTS, [str(count) for count in COUNTS], minor=False)
    errors.set_xticks([], minor=True)
    errors.grid(color="0.9", lw=0.7)
    errors.legend(frameon=False)
    save_figure(figure, path)


main(sys.argv[1])
