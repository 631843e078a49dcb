"""How well shape tells a force at the tip, over the workspace: `python examples/figures/force_map.py figure.png`.

RJW-S1, a synthetic robot, unloaded, its outer tube held: standard deviations from twenty points of 0.2 mm.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure

ROBOT = Path(__file__).resolve().parents[2] / "problems" / "rjw_s1" / "robot.toml"
SIGMA, POINTS = 0.2e-3, 20
TURNS = np.linspace(0.0, np.pi, 13)  # of the inner tube against the outer one
TRANSLATIONS = np.linspace(-0.2, -0.12, 9)  # of the inner tube, m
PANELS = {
    "across the chord": (1, [1, 1.5, 2, 3, 4, 5, 6, 7, 8]),
    "along the chord": (2, [40, 60, 80, 120, 200, 300, 500, 800, 1300]),
}


def estimate(robot, actuation):
    """Of a force at the tip where there is none."""
    shape = ctr.ForwardProblem(robot).solve(actuation)
    s = np.linspace(1.0 / POINTS, 1.0, POINTS) * shape.length
    measured = ctr.PositionMeasurement(s, shape.position(s), SIGMA)
    return ctr.ForceEstimationProblem(robot, ctr.TipForce()).solve(actuation, measured)


def main(path):
    """Estimate, draw, save."""
    robot = ctr.load_robot(ROBOT)
    grid = [[estimate(robot, ctr.Actuation([turn, 0.0], [t, -0.0307])) for turn in TURNS] for t in TRANSLATIONS]
    tips = 1e3 * np.array([[estimate.shape.tip_position for estimate in row] for row in grid])
    radius, height = np.hypot(tips[..., 0], tips[..., 1]), tips[..., 2]

    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    for ax, (title, (k, levels)) in zip(figure.subplots(1, 2, sharey=True), PANELS.items(), strict=True):
        values = 1e3 * np.array([[estimate.axes[k].standard_deviation for estimate in row] for row in grid])
        drawn = ax.contourf(radius, height, values, levels, norm=LogNorm(), cmap="viridis", extend="both")
        ax.set(title=f"force {title}", xlabel="distance of the tip from the axis [mm]", aspect="equal")
        bar = figure.colorbar(drawn, ax=ax, label="standard deviation [mN]", ticks=levels, format="%g")
        bar.minorticks_off()
    figure.axes[0].set_ylabel("z of the tip [mm]")
    save_figure(figure, path)


if __name__ == "__main__":
    main(sys.argv[1])
