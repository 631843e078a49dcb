"""What presses on the tip, while the robot moves and samples are lost? Followed live.

A wall is touched after one second and left after two. Run with a file name, say ``stream.gif``, for an animation.
"""

import sys
from pathlib import Path

import numpy as np

import ctr_opt as ctr

ROBOT = Path(__file__).resolve().parent.parent / "problems" / "three_tubes" / "robot_b.toml"
RATE, SIGMA, TOUCH = 30.0, 2e-4, np.array([0.15, -0.1, -0.05])  # Hz, m, N

rng = np.random.default_rng(0)
robot = ctr.load_robot(ROBOT)
problem, shape = ctr.ForwardProblem(robot), None
stream = ctr.ForceEstimator(robot, ctr.TipForce(), rate=RATE, drift=0.3)
times, rows = np.arange(90) / RATE, []
for t in times:
    actuation = ctr.Actuation([0.5 * np.sin(t), 1.0, -1.0 + 0.3 * t], [-0.3, -0.2, -0.1])
    force = TOUCH * np.interp(t, [1.0, 1.2, 1.9, 2.1], [0.0, 1.0, 1.0, 0.0])
    shape = problem.solve(actuation, [ctr.PointWrench(force)], initial=shape)
    places = np.linspace(0.15, 1.0, 20) * shape.length
    seen = ctr.PositionMeasurement(places, shape.position(places) + SIGMA * rng.normal(size=(20, 3)), SIGMA)
    estimate = stream.update(actuation, None if rng.random() < 0.1 else seen)
    rows.append((force, estimate.force, estimate.deviations, shape.position(np.linspace(0.0, shape.length, 60))))

truths, estimates, deviations, points = (np.array(column) for column in zip(*rows, strict=True))
error = np.sqrt((((estimates - truths) / deviations) ** 2).mean())
print(f"{len(times)} samples, {stream.counts['dropped']} of them lost")
print(f"standard deviations {', '.join(f'{x:.3f}' for x in deviations.mean(axis=0))} N, across and along the chord")
print(f"errors over standard deviations: {error:.2f} (root mean square)")
assert stream.counts["left out"] == 0
assert 0.7 < error < 1.5

if len(sys.argv) > 1:
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation, PillowWriter

    figure, (side, plot) = plt.subplots(1, 2, figsize=(8.0, 3.2), layout="constrained")

    def draw(k):
        """Shape and forces up to a sample."""
        side.clear()
        side.plot(1e3 * points[k][:, 0], 1e3 * points[k][:, 2], "k")
        side.set(xlim=(-60, 60), ylim=(0, 160), xlabel="x [mm]", ylabel="z [mm]", aspect="equal")
        plot.clear()
        for i, axis in enumerate("xyz"):
            plot.plot(times[: k + 1], estimates[: k + 1, i], f"C{i}", label=f"force.{axis}")
            band = 2.0 * deviations[: k + 1, i]
            plot.fill_between(times[: k + 1], estimates[: k + 1, i] - band, estimates[: k + 1, i] + band, alpha=0.2)
            plot.plot(times[: k + 1], truths[: k + 1, i], f"C{i}:")
        plot.set(xlim=(0.0, times[-1]), ylim=(-0.5, 0.5), xlabel="time (s)", ylabel="force (N), dotted: the truth")
        plot.legend(loc="upper right")

    FuncAnimation(figure, draw, len(times)).save(sys.argv[1], PillowWriter(fps=RATE))
