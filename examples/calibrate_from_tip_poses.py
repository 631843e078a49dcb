"""Which parameters of a robot follow from a table of tip poses, and how well are other poses predicted?

The table has joint values and the readings of an electromagnetic sensor at the tip, without any load. It gives the
homes of three tubes, stiffnesses relative to the inner tube's, precurvatures, and the sensor's pose on the tube. The
thousand rows are synthetic, of a robot of simulation studies; replace robot and table by yours.
"""

from pathlib import Path

import numpy as np

import ctr_opt as ctr

FOLDER = Path(__file__).resolve().parent.parent / "problems" / "three_tubes"

robot = ctr.load_robot(FOLDER / "robot_b.toml")
poses = ctr.read_experiments(FOLDER / "tip_poses.csv", 3, sigma=0.5e-3, direction_sigma=0.01, sensor="coil")

homes = [f"tubes[{i}].{kind}_offset" for kind in ("rotation", "translation") for i in range(3)]
stiffnesses = [f"tubes[{i}].bending_stiffness" for i in (1, 2)]
stiffnesses += [f"tubes[{i}].torsional_stiffness" for i in range(3)]
curved = [ctr.Parameter(f"precurvature of tube {i}", tied=f"tubes[{i}].precurvature[1].curvature") for i in range(3)]
parameters = [*homes, *stiffnesses, *curved, "sensors.coil.translation", "sensors.coil.rotation"]

# A fifth, drawn at random, is not fitted. Without a C compiler: compiled=False, and minutes in the place of seconds.
held = np.random.default_rng(7).permutation(len(poses))[: len(poses) // 5]
fitted = [pose for k, pose in enumerate(poses) if k not in held]
fit = ctr.CalibrationProblem(robot, fitted, parameters, compiled=True).solve()
print(fit.report())

# The sensor shows its position and axis. Its turn about that axis is not determined, and no prediction needs it.
assert [str(direction) for direction in fit.undetermined] == ["sensors.coil.rotation.z is not determined"]
assert fit.noise_accepted
print(f"\nprecurvature of the inner tube: {fit.robot.tubes[0].precurvature[1].curvature[0]:.3f} 1/m")

# How well are the others predicted? Position by position, and axis by axis.
tested = fit.tested([poses[k] for k in held])
errors = 1e3 * np.array([residual.value for residual in tested.residuals if residual.measurement == 0])
sizes = np.linalg.norm(errors, axis=1)
angles = np.rad2deg([residual.angle for residual in tested.residuals if residual.measurement == 1])
print(
    f"{len(sizes)} held out: {sizes.mean():.2f} mm in the mean, sd {sizes.std():.2f} mm, at most {sizes.max():.2f} mm"
)
print("along x, y, z:", ", ".join(f"{e.mean():+.2f} +- {e.std():.2f} mm" for e in errors.T))
print(f"directions: {angles.mean():.2f} deg in the mean, sd {angles.std():.2f} deg, at most {angles.max():.2f} deg")
assert abs(errors.std() / 0.5 - 1.0) < 0.1  # the noise of the data: of 600 numbers within 3 percent, and some
