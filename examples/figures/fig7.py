"""All shapes of the plan, as in the paper's Fig. 7, and the workspace: `python examples/figures/fig7.py figure.png`.

RJW-S1, a synthetic robot, unloaded. Turned rigidly about z a tip draws a circle, so its height and its distance from
the axis tell the workspace; between the five translations it is interpolated.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure
from ctr_opt.forward.plot import plot_equilibrium

PLAN = Path(__file__).resolve().parents[2] / "problems" / "rjw_s1" / "plan.toml"
COLORS = ("#440154", "#3B528B", "#21918C", "#5EC962", "#E69F00")
FINE = np.deg2rad(np.arange(0.0, 361.0, 7.5))


def main(path):
    """Solve, draw, save."""
    plan = ctr.load_plan(PLAN)
    problem = ctr.ForwardProblem(plan.robot)
    unloaded = [case for case in plan.problems if not case.loads]
    figure = Figure(figsize=(10.5, 6.2), layout="constrained")
    space = figure.add_subplot(121, projection="3d")
    space.set_proj_type("ortho")
    space.view_init(elev=20.0, azim=-60.0)
    side = figure.add_subplot(122, aspect="equal")
    curves = []
    for row, color in enumerate(COLORS):
        cases = unloaded[8 * row : 8 * row + 8]
        label = f"$D_1$ = {-1e3 * cases[0].actuation.translations[0]:.1f} mm"
        for case in cases:
            shape = problem.solve(case.actuation)
            plot_equilibrium(shape, space, tubes=False, loads=False, frames=False, color=color, label=label)
            side.plot(*place(shape), "o", color=color, ms=5)
        along = [ctr.Actuation([angle, 0.0], cases[0].actuation.translations) for angle in FINE]
        curves.append(np.array([place(problem.solve(pose)) for pose in along]))
        side.plot(*curves[-1].T, color=color, lw=1.2)
    near = [curve[curve[:, 0].argmin()] for curve in curves]
    far = [curve[0] for curve in curves]
    side.fill(*np.vstack((near, curves[-1][24::-1], far[::-1], curves[0][:25])).T, color="0.92", zorder=0)
    space.set_box_aspect(np.ptp([space.get_xlim(), space.get_ylim(), space.get_zlim()], axis=1), zoom=0.9)
    space.get_legend().remove()
    lines = space.get_legend_handles_labels()
    names = dict(zip(lines[1], lines[0], strict=True))
    figure.legend(names.values(), names.keys(), loc="outside upper center", ncols=5, frameon=False)
    side.set(xlabel="distance of the tip from the z axis [mm]", ylabel="z [mm]", xlim=(0, 80), ylim=(90, 200))
    side.grid(color="0.85", lw=0.7)
    save_figure(figure, path)


def place(shape):
    """The tip's distance from the axis, and its height, mm."""
    x, y, z = 1e3 * shape.tip_position
    return np.hypot(x, y), z


main(sys.argv[1])
