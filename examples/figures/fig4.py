"""Transition points of a two-tube cannula, as in the paper's Fig. 4: `python examples/figures/fig4.py figure.png`.

RJW-S1, a synthetic robot, unloaded and with all rotations zero, seen along y; the tubes' diameters are drawn twice.
"""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure

ROBOT = Path(__file__).resolve().parents[2] / "problems" / "rjw_s1" / "robot.toml"
COLORS = ("#0072B2", "#E69F00")
BEHIND = -0.045  # m: where the inner tube is cut off
NAMES = ("entry point, $s = 0$", "outer tube begins to curve", "inner tube begins to curve", "outer tube ends", "tip")
PLACES = ((14, -26), (-4, 38), (6, -28), (-4, 32), (-2, -28))  # of the names beside their points, mm


def line(shape, start, end):
    """Points ``(k, 2)`` and normals of the backbone from above, mm; straight behind the entry point."""
    s = np.linspace(start, end, 200)
    poses = shape.pose(np.maximum(s, 0.0))
    points = poses[:, :3, 3] + np.minimum(s, 0.0)[:, None] * poses[:, :3, 2]
    tangents = poses[:, [2, 0], 2]
    normals = np.column_stack((-tangents[:, 1], tangents[:, 0])) / np.linalg.norm(tangents, axis=1)[:, None]
    return 1e3 * points[:, [2, 0]], normals


def main(path):
    """Solve, draw, save."""
    robot = ctr.load_robot(ROBOT)
    actuation = ctr.Actuation([0.0, 0.0], [-0.1547, -0.0307])
    shape = ctr.ForwardProblem(robot).solve(actuation)
    figure = Figure(figsize=(8.0, 4.0), layout="constrained")
    ax = figure.add_subplot(aspect="equal")
    ax.axvspan(-46, 0, color="0.93", zorder=0)
    ax.text(-44, -26, "held straight,\nfree to twist", fontsize=9, color="0.35", va="center")
    for i in (0, 1):
        start = max(BEHIND, actuation.translations[i])
        points, normals = line(shape, start, shape.configuration.tube_ends[i])
        aside = 2.0 * 1e3 * robot.tubes[i].outer_diameter / 2 * normals
        band = np.vstack((points + aside, (points - aside)[::-1]))
        ax.fill(*band.T, color=COLORS[i], lw=0, label=f"{robot.tubes[i].name} tube", zorder=2 + i)
    ax.plot(*line(shape, BEHIND, shape.length)[0].T, color=COLORS[0], lw=1.2, ls="--", zorder=4)
    transitions = shape.configuration.break_points
    for s, name, (right, up) in zip(transitions, NAMES, PLACES, strict=True):
        (point, *_), (normal, *_) = line(shape, s, s)
        across = np.array([point - 7 * normal, point + 7 * normal])
        ax.plot(*across.T, color="black", lw=1.3, zorder=5)
        ax.annotate(
            f"{name}\n$s = {1e3 * s:.1f}$ mm" if s else name,
            point + np.sign(up) * 7 * normal,
            np.add(point, (right, up)),
            ha="center",
            va="center",
            fontsize=9,
            arrowprops={"arrowstyle": "-", "lw": 0.7, "color": "0.4", "shrinkA": 2, "shrinkB": 0},
        )
    for number, (a, b) in enumerate(pairwise(transitions), start=1):
        (point, *_), (normal, *_) = line(shape, 0.5 * (a + b), b)
        ax.text(*(point + 7 * normal), f"{number}", ha="center", va="center", fontsize=9, color="0.35")
    ax.set(xlabel="z [mm]", ylabel="x [mm]", xlim=(-46, 185), ylim=(-38, 68))
    ax.legend(loc="upper left", frameon=False)
    save_figure(figure, path)


main(sys.argv[1])
