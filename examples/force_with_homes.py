"""Where are the homes of the actuators, and what does a force estimate make of them?

An encoder's zero is not exactly the joint's. A calibration estimates the offsets, and a force estimate must add them to
the joints: otherwise it explains them by a force. Everything is synthetic: robot B of simulation studies.
"""

from pathlib import Path

import numpy as np

import ctr_opt as ctr

SIGMA = 0.2e-3  # m
OFFSETS = np.array([[0.05, -0.03, 0.04], [1.2e-3, -0.8e-3, -1.0e-3]])  # rad, m: unknown to the calibration

robot = ctr.load_robot(Path(__file__).resolve().parent.parent / "problems" / "three_tubes" / "robot_b.toml")
problem, rng = ctr.ForwardProblem(robot), np.random.default_rng(3)


def seen(rotations, translations, loads=()):
    """Noisy points of the robot, whose joints are off what they read."""
    joints = np.array([rotations, translations]) + OFFSETS
    shape = problem.solve(ctr.Actuation(*joints), loads)
    places = np.linspace(0.02, 0.95, 12) * (robot.tubes[0].length + translations[0])
    return ctr.PositionMeasurement(places, shape.position(places) + SIGMA * rng.normal(size=(12, 3)), SIGMA)


# Thirty shapes without load determine the homes.
experiments = []
for _ in range(30):
    rotations, translations = rng.uniform(-np.pi, np.pi, 3), rng.uniform(-0.02, 0.02, 3) - [0.3, 0.2, 0.1]
    measured = seen(rotations, translations)
    experiments.append(ctr.Experiment(ctr.Actuation(rotations, translations), [], [measured]))
homes = [f"tubes[{i}].{kind}_offset" for kind in ("rotation", "translation") for i in range(3)]
fit = ctr.CalibrationProblem(robot, experiments, homes).solve()
print(fit.report())

# A force at the tip. fit.actuation adds the homes to the joint readings, and fit= counts the errors of the homes.
force, rotations, translations = np.array([0.1, -0.05, 0.05]), [0.0, 1.0, -1.0], [-0.3, -0.2, -0.1]
points = seen(rotations, translations, [ctr.PointWrench(force)])
touch = ctr.ForceEstimationProblem(fit.robot, ctr.TipForce())
estimate = touch.solve(fit.actuation(rotations, translations), points, fit=fit)
print("\n" + estimate.report())

# Joint readings are refused beside the fit. Without the fit they are accepted: wrong forces that look right.
read = ctr.Actuation(rotations, translations)
try:
    touch.solve(read, points, fit=fit)
except ctr.DefinitionError as error:
    print(f"\nrefused: {error}")
wrong = touch.solve(read, points)


def squared(estimate):
    """Squared error over the covariance: 3 in the mean where both are right."""
    return (estimate.force - force) @ np.linalg.solve(estimate.covariance, estimate.force - force)


print(f"\nsquared error over covariance: {squared(estimate):.1f} with the homes, {squared(wrong):.0f} without")
print("consistent:", estimate.consistent, "with the homes,", wrong.consistent, "without")
assert squared(estimate) < 11.3  # 99 % of a chi-square of three
assert squared(wrong) > 50.0
assert wrong.consistent
