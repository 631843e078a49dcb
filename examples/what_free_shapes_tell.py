"""What do shapes without load reveal about stiffness?

Tubes that bend each other show only the ratios of their stiffnesses. The fit reports this instead of giving numbers.
One known stiffness, for example from a three-point bending test, determines the others.
"""

from pathlib import Path

import numpy as np

import ctr_opt as ctr

RJW = Path(__file__).resolve().parent.parent / "problems" / "rjw_s1"
SIGMA = 0.2e-3  # m

# Made-up measurements: five points along each of twelve shapes.
robot = ctr.load_robot(RJW / "robot.toml")
rng = np.random.default_rng(1)
experiments = []
for turn in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False):
    actuation = ctr.Actuation([turn, 0.0], [-0.2, -0.03])
    shape = ctr.ForwardProblem(robot).solve(actuation)
    places = np.linspace(0.2, 1.0, 5) * shape.length
    points = shape.position(places) + SIGMA * rng.normal(size=(5, 3))
    experiments.append(ctr.Experiment(actuation, [], [ctr.PositionMeasurement(places, points, SIGMA)]))

stiffnesses = [f"tubes[{i}].{kind}_stiffness" for kind in ("bending", "torsional") for i in (0, 1)]
fit = ctr.CalibrationProblem(robot, experiments, stiffnesses).solve()
print(fit.report())
assert [str(direction) for direction in fit.undetermined] == ["EI_0 : EI_1 : GJ_0 : GJ_1 may be scaled together"]
assert all(np.isnan(value) for value in fit.values.values())
ratio, error = fit.ratios["EI_1 / EI_0"]
assert abs(ratio - robot.tubes[1].bending_stiffness / robot.tubes[0].bending_stiffness) < 3.0 * error

known = ctr.Parameter(stiffnesses[0], prior=(robot.tubes[0].bending_stiffness, 2e-4))
fit = ctr.CalibrationProblem(robot, experiments, [known, *stiffnesses[1:]]).solve()
print("\nWith the inner tube's bending stiffness known to 1 %:\n" + fit.report())
assert not fit.undetermined
