"""What force is at the tip, seen by a fibre in the inner tube?

Strains of the cores of an optical fibre give curvatures with covariances, curvatures give the force with an error bar.
The strains are synthetic: true strains with noise of two microstrain and a drift of temperature.
`python strains_to_force.py figure.png` draws docs/figures/strains_to_force.png.
"""

import sys
from pathlib import Path

import numpy as np

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure
from ctr_opt.sensing import core_ring, curvature_from_strains

ROBOT = Path(__file__).resolve().parent.parent / "problems" / "three_tubes" / "robot_b.toml"
FORCE = np.array([0.15, -0.10, 0.05])  # N, the truth

robot = ctr.load_robot(ROBOT)
pose = ctr.Actuation([0.0, 1.0, -1.0], [-0.3, -0.2, -0.1])
forward = ctr.ForwardProblem(robot)
truth = forward.solve(pose, [ctr.PointWrench(FORCE)])

# The fibre: a core on the axis and three around it; gratings every 8 mm along the inner tube.
cores = np.vstack((core_ring(35e-6, np.deg2rad([90.0, 210.0, 330.0])), [[0.0, 0.0]]))
places = np.arange(0.006, truth.length, 0.008)


def along_tube(shape, s=places):
    """Curvatures in the inner tube's own frame, as a fibre in it sees them, 1/m."""
    angle, (x, y, _) = shape.tube_angle(0, s), shape.curvature(s).T
    return np.column_stack((np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x))


rng = np.random.default_rng(7)
ux, uy = along_tube(truth).T[:, :, None]
strains = ux * cores[:, 1] - uy * cores[:, 0] + 40e-6 + 2e-6 * rng.normal(size=(len(places), 4))

# Strains to curvatures, curvatures to the force.
fibre = curvature_from_strains(strains, cores, sigma=2e-6)
print(fibre.report(), end="\n\n")
seen = fibre.measurement(places, tube=0)
estimate = ctr.ForceEstimationProblem(robot, ctr.TipForce()).solve(pose, seen)
print(estimate.report())

error = estimate.force - FORCE
assert estimate.consistent
assert error @ np.linalg.solve(estimate.force_covariance, error) < 16.0  # four standard deviations, any direction
assert np.abs(fibre.common_strain - 40e-6).max() < 4e-6  # four standard deviations of a mean of four

if len(sys.argv) > 1:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.4), layout="constrained")
    at_rest, s = forward.solve(pose), np.linspace(0.0, truth.length, 800)
    measured, known = fibre.curvature - along_tube(at_rest), 1.96 * fibre.standard_deviations
    fitted = along_tube(estimate.shape, s) - along_tube(at_rest, s)
    for k, view in enumerate(figure.subplots(2, 1, sharex=True, sharey=True)):
        view.errorbar(1e3 * places, measured[:, k], known[k], fmt="k.", ms=4, capsize=2, label="measured, 95 %")
        view.plot(1e3 * s, fitted[:, k], color="#0072B2", label="under the estimated force")
        view.axhline(0.0, color="0.8", lw=0.8, zorder=0)
        view.set_ylabel(f"change of $u_{'xy'[k]}$ [1/m]")
    figure.axes[1].set_xlabel("arc length [mm]")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2, frameon=False)
    save_figure(figure, sys.argv[1])
