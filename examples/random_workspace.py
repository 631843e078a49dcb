"""Where can the tip of three tubes go: 20,000 random configurations, and a sweep on which the robot snaps.

`python random_workspace.py figure.png` draws docs/figures/random_workspace.png. Without a compiler a row takes a
hundred times as long; then fewer rows are solved.
"""

import sys
from contextlib import suppress
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure

THREE = Path(__file__).resolve().parent.parent / "problems" / "three_tubes"

problem = ctr.ForwardProblem(ctr.load_robot(THREE / "robot_b.toml"))
with suppress(ctr.CompilationError):
    problem.compile()
count = 20_000 if problem.compiles else 200

# Any rotations; translations that leave bases and tips in the order of the tubes.
rng = np.random.default_rng(1)
lengths = np.array([tube.length for tube in problem.robot.tubes])
translations = rng.uniform(-lengths, 0.0, (20 * count, 3))
ordered = (np.diff(translations) > 0.01).all(axis=1) & (np.diff(lengths + translations) < -0.01).all(axis=1)
translations = translations[ordered][:count]
rotations = rng.uniform(-np.pi, np.pi, (count, 3))
assert len(translations) == count

begin, started = perf_counter(), process_time()
batch = problem.solve_many((rotations, translations), chained=False)
seconds, processor = perf_counter() - begin, process_time() - started
tips = batch.tip_position
print(batch)
print(f"{seconds:.1f} s, of the processor {processor:.1f} s, {1e6 * processor / count:.0f} us a row")
print(f"tips are {1e3 * tips[:, 2].min():.0f} to {1e3 * tips[:, 2].max():.0f} mm from the entry along z,", end=" ")
print(f"up to {1e3 * np.hypot(tips[:, 0], tips[:, 1]).max():.0f} mm from the axis")
assert batch.converged.all()

# Rows of a path continue each other: the inner tube of robot A turns, and turns back.
curved = ctr.ForwardProblem(ctr.load_robot(THREE / "robot_a.toml"))
turn = np.deg2rad(np.arange(0.0, 361.0, 3.0))
turns = np.concatenate((turn, turn[-2::-1]))
path = np.column_stack((turns, np.zeros((len(turns), 2))))
sweep = curved.solve_many((path, np.tile([-0.10, -0.08, -0.05], (len(path), 1))))
(snaps,) = np.nonzero(sweep.snapped)
for k in snaps:
    jump = np.linalg.norm(sweep[k].tip_position - sweep[k - 1].tip_position)
    way = "turning" if k < len(turn) else "turning back"
    print(f"{way} it snaps before {np.rad2deg(turns[k]):.0f} deg: the tip jumps by {1e3 * jump:.0f} mm")
assert len(snaps) == 2

if len(sys.argv) > 1:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 2.7), layout="constrained")
    cloud, loop = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    cloud.plot(*1e3 * tips[:, [2, 0]].T, ",", color="#0072B2", alpha=0.5)
    cloud.set(xlabel="z [mm]", ylabel="x [mm]", aspect="equal", title=f"{count:,} tips, seen along y")
    xy, last = 1e3 * sweep.tip_position[:, :2], len(turn) - 1
    for begin, end, color, style, name in ((0, last, "#0072B2", "-", "turning"), (last, None, "#E69F00", ":", "back")):
        part = np.insert(xy, snaps, np.nan, axis=0)[begin : None if end is None else end + 2]
        loop.plot(*part.T, style, color=color, lw=2.2, label=name)
    for k in snaps:
        loop.annotate("", xy[k], xy[k - 1], arrowprops={"arrowstyle": "->", "color": "0.5", "ls": "--"})
    loop.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal", title="a tip that snaps, seen along z")
    loop.legend(loc="center", frameon=False, bbox_to_anchor=(0.5, 0.42))
    save_figure(figure, sys.argv[1])
