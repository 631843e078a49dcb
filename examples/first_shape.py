"""What shape do my own two tubes take, and how well is it known?

Two superelastic tubes are defined, turned, pushed and loaded. `python first_shape.py figure.png` draws
docs/figures/first_shape.png: the free and the loaded shape.
"""

import sys

import numpy as np

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure

nitinol = {"youngs_modulus": 60e9, "poisson_ratio": 0.3}  # Pa
inner = ctr.Tube("inner", 1.2e-3, 0.9e-3, [ctr.Straight(0.12), ctr.Arc(0.08, 12.0)], **nitinol)
outer = ctr.Tube("outer", 1.8e-3, 1.4e-3, [ctr.Straight(0.06), ctr.Arc(0.04, 8.0)], **nitinol)
robot = ctr.Robot([inner, outer])  # from the innermost to the outermost

problem = ctr.ForwardProblem(robot)
pose = ctr.Actuation(rotations=np.deg2rad([90.0, 0.0]), translations=[-0.06, -0.02])
free = problem.solve(pose)
print(f"{1e3 * free.length:.0f} mm long, tip at", (1e3 * free.tip_position).round(3).tolist(), "mm")

# A force at the tip; the search starts from the free shape.
loaded = problem.solve(pose, [ctr.PointWrench(force=[0.15, 0.15, 0.0])], initial=free)
moved = loaded.tip_position - free.tip_position
print("the force moves the tip by", (1e3 * moved).round(3).tolist(), "mm")
print(f"found by: {free.path}, then {loaded.path}; stable: {loaded.is_stable}")

# Three measures of the error: the solver's estimate, an independent integrator, a solve to a tighter tolerance.
tight = ctr.ForwardProblem(robot, tolerance=1e-10).solve(pose, loaded.loads)
off = np.linalg.norm(loaded.tip_position - tight.tip_position)
print(f"error: {loaded.discretization_error:.0e} m estimated, {loaded.verify():.0e} m by SciPy's integrator,", end=" ")
print(f"{off:.0e} m from a solve to 1e-10")
assert loaded.discretization_error <= 1e-7 * loaded.length  # the default tolerance
assert loaded.verify() <= loaded.discretization_error
assert off <= 1e-7 * loaded.length
assert loaded.is_stable

if len(sys.argv) > 1:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 5.2), layout="constrained")
    for view, (k, axis) in zip(figure.subplots(1, 2, sharey=True), enumerate("xy"), strict=True):
        for shape, name, style in ((free, "free", ":"), (loaded, "loaded", "-")):
            starts = (shape.configuration.tube_ends[1], 0.0)  # the inner tube shows where the outer one has ended
            for i, color in enumerate(("#0072B2", "#E69F00")):
                points = 1e3 * shape.position(np.linspace(starts[i], shape.configuration.tube_ends[i], 100))
                label = f"{robot.tubes[i].name}, {name}"
                view.plot(points[:, k], points[:, 2], style, color=color, lw=1.8 + 1.6 * i, label=label)
        tip, push = 1e3 * loaded.tip_position, 100.0 * np.array(loaded.loads[0].force)  # mm; 10 mm for 0.1 N
        view.annotate(
            "", (tip + push)[[k, 2]], tip[[k, 2]], arrowprops={"arrowstyle": "->", "color": "#D55E00", "lw": 1.8}
        )
        view.plot([], [], color="#D55E00", lw=1.8, label="force")
        view.set(xlabel=f"{axis} [mm]")
        view.set_aspect("equal", adjustable="datalim")
    figure.get_layout_engine().set(wspace=0.08)
    figure.axes[0].set_ylabel("z [mm]")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    save_figure(figure, sys.argv[1])
