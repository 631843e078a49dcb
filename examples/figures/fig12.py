"""Tips before and after calibration, as in the paper's Fig. 12: `python examples/figures/fig12.py figure.png`.

RJW-S1, a synthetic robot and synthetic data; and what the fit says of two stiffnesses that it hardly tells apart.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import ctr_opt as ctr
from ctr_opt.calibration.plot import plot_ellipse
from ctr_opt.calibration.report import sizes_by_place
from ctr_opt.estimation.measurements.kind import POINTS
from ctr_opt.files.figures import save_figure

RJW = Path(__file__).resolve().parents[2] / "problems" / "rjw_s1"
PAIR = ("tubes[1].bending_stiffness", "tubes[1].torsional_stiffness")


def main(path):
    """Fit, draw, save."""
    robot = ctr.load_robot(RJW / "robot.toml")
    experiments = ctr.read_experiments(RJW / "calibration.csv", 2, sigma=[0.63e-3, 0.15e-3, 0.19e-3])
    names = [f"tubes[{i}].{kind}_stiffness" for kind in ("bending", "torsional") for i in (0, 1)]
    problem = ctr.CalibrationProblem(robot, experiments, [*names, "base.translation", "base.rotation"], loss="distance")
    nominal, fit = problem.nominal(), problem.solve()

    figure = Figure(figsize=(10.5, 3.6), layout="constrained")
    before, after, ellipse = figure.subplots(1, 3)
    after.sharey(before)
    errors = [1e3 * sizes_by_place(result, POINTS)["tip"] for result in (nominal, fit)]
    bins = np.arange(0.0, 17.0, 0.5)
    for ax, sizes, title in zip((before, after), errors, ("nominal", "calibrated, sum of distances"), strict=True):
        ax.hist(sizes, bins, color="#0072B2", edgecolor="white")
        ax.axvline(sizes.mean(), color="black", ls="--", lw=1.0, label=f"mean {sizes.mean():.2f} mm")
        ax.set(title=title, xlabel="error of the tip [mm]")
        ax.legend(frameon=False)
    before.set_ylabel("experiments")
    after.annotate("the mistyped one", (errors[1].max(), 1.5), (9.5, 8.0), arrowprops={"arrowstyle": "->", "lw": 1.0})
    plot_ellipse(fit, ellipse, pair=PAIR)
    ellipse.set_title("two stiffnesses")
    save_figure(figure, path)


if __name__ == "__main__":
    main(sys.argv[1])
