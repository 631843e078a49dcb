"""Which parameters explain measured shapes, and how far can they be trusted?

The paper's section III on synthetic data: three points on each of eighty shapes of RJW-S1, half of them loaded, give
four stiffnesses and the pose of the base. One line of the table was mistyped.
"""

from pathlib import Path

import numpy as np

import ctr_opt as ctr

RJW = Path(__file__).resolve().parent.parent / "problems" / "rjw_s1"

robot = ctr.load_robot(RJW / "robot.toml")
experiments = ctr.read_experiments(RJW / "calibration.csv", 2, sigma=[0.63e-3, 0.15e-3, 0.19e-3])
stiffnesses = [f"tubes[{i}].{kind}_stiffness" for kind in ("bending", "torsional") for i in (0, 1)]
parameters = [*stiffnesses, "base.translation", "base.rotation"]

# Squares believe every number: the noise level they leave rejects the one that was given, and a case stands out.
squares = ctr.CalibrationProblem(robot, experiments, parameters).solve()
assert squares.p_value < 1e-3
worst = int(np.argmax(squares.influence))
print(f"{experiments[worst].name} pulls most, {worst in squares.outliers = }")

# A loss that counts large misfits less finds the same without being pulled.
robust = ctr.CalibrationProblem(robot, experiments, parameters, loss="huber").solve()
print(robust.report())
assert robust.outliers == [worst]

# Looked up and found wrong, the case is left out: now the noise is as given.
fit = squares.without(worst)
print(f"\nwithout it: p = {fit.p_value:.2f}")
assert fit.noise_accepted
assert not fit.undetermined

# How well would shapes be predicted that were not fitted? Every fourth in turn.
held_out = [error for k in range(4) for error in fit.errors_without(range(k, len(experiments) - 1, 4))]
tips = 1e3 * np.array([error.size for error in held_out if error.block == 2])
print(f"tips held out: {tips.mean():.2f} mm in the mean, {tips.max():.2f} mm at most")
assert len(tips) == 79
assert tips.max() < 2.0

# The least known stiffness: is its likelihood that of a normal distribution?
values, excess = fit.profile("tubes[1].torsional_stiffness", count=5, width=2.0)
error = fit.standard_errors["tubes[1].torsional_stiffness"]
for value, cost in zip(values, excess, strict=True):
    expected = 0.5 * ((value - fit.values["tubes[1].torsional_stiffness"]) / error) ** 2
    print(f"GJ_1 = {value:.4f} N m^2: log-likelihood less by {cost:.3f}, {expected:.3f} if it were normal")
assert abs(excess[[0, -1]] - 2.0).max() < 0.6
