"""How stiff is what the tip presses on?

A robot palpates: it presses with planned forces, based on an assumed stiffness, and its shape is measured. The shape
gives the force across the chord from entry point to tip. The tip's position gives the depth. Together they give the
stiffness, with an error. `python examples/palpation.py figure.png` draws it.
"""

import sys
from pathlib import Path

import numpy as np

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure

SIGMA = 0.1e-3  # m, of the points
BELIEVED, TRUE = 100.0, 150.0  # N/m
WANTED = np.linspace(0.08, 0.4, 5)  # N

robot = ctr.load_robot(Path(__file__).resolve().parent.parent / "problems" / "three_tubes" / "robot_b.toml")
problem = ctr.InverseKinematicsProblem(robot, limits=ctr.JointLimits(base_gap=0.01, tip_gap=0.005))
touch = np.array([0.02, -0.02, 0.15])  # where the tip first touches
outward = np.array([-1.0, 0.0, 0.0])  # out of the tissue, which lies towards +x

# Press with a wanted force: go as deep as it takes by the stiffness believed in, under the force that then pushes back.
forward = ctr.ForwardProblem(robot)
tissue = ctr.PotentialLoad(lambda p: 0.5 * TRUE * (p[0] - touch[0]) ** 2)  # what is there
answer = problem.solve(touch)
before, real = answer.equilibrium, []
for force in WANTED:
    deep = touch - force / BELIEVED * outward
    answer = problem.solve(deep, [ctr.PointWrench(force * outward)], before)
    assert answer.converged
    before = answer.equilibrium
    real.append(forward.solve(answer.actuation, [tissue], before))  # and what comes of it

# What is seen: twelve points of each shape. Only the force along the normal is estimated, and it is well known.
rng = np.random.default_rng(7)
sensing = ctr.ForceEstimationProblem(robot, [ctr.TipForce(prior=(0.0, 0.2))])
depths, forces, errors = [], [], []
for shape in real:
    places = np.linspace(0.2, 1.0, 12) * shape.length
    points = ctr.PositionMeasurement(places, shape.position(places) + SIGMA * rng.normal(size=(12, 3)), SIGMA)
    estimate = sensing.solve(shape.actuation, points)
    forces.append(estimate.force @ outward)
    errors.append(np.sqrt(outward @ estimate.covariance @ outward))
    depths.append((touch - estimate.shape.tip_position) @ outward)
    print(f"{1e3 * depths[-1]:5.2f} mm deep: {1e3 * forces[-1]:5.1f} +- {1e3 * errors[-1]:.1f} mN")

# The stiffness, by weighted least squares: force = stiffness * depth.
depths, forces, weights = np.array(depths), np.array(forces), 1.0 / np.array(errors) ** 2
spread = 1.0 / np.sum(weights * depths**2)
stiffness = spread * np.sum(weights * depths * forces)
print(f"stiffness {stiffness:.1f} +- {np.sqrt(spread):.1f} N/m, believed {BELIEVED:g}, in truth {TRUE:g}")
assert abs(stiffness - TRUE) < 3.0 * np.sqrt(spread)
assert abs(stiffness - BELIEVED) > 3.0 * np.sqrt(spread)

# Pressed again with what was learned, the last force is what was wanted.
deep = touch - WANTED[-1] / stiffness * outward
answer = problem.solve(deep, [ctr.PointWrench(WANTED[-1] * outward)], before)
pressed = TRUE * (forward.solve(answer.actuation, [tissue], answer.equilibrium).tip_position[0] - touch[0])
print(f"wanted {1e3 * WANTED[-1]:.1f} mN, pressed with {1e3 * pressed:.1f} mN")
assert abs(pressed - WANTED[-1]) < 0.1 * WANTED[-1]

if len(sys.argv) > 1:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.0, 3.6), layout="constrained")
    ax = figure.subplots()
    ax.errorbar(1e3 * depths, 1e3 * forces, 1e3 * np.array(errors), fmt="o", capsize=3, label="from the shape")
    ax.plot([0, 1e3 * depths.max()], [0, 1e3 * stiffness * depths.max()], label=f"{stiffness:.0f} N/m")
    ax.set(xlabel="depth [mm]", ylabel="force [mN]")
    ax.legend(frameon=False)
    save_figure(figure, sys.argv[1])
