"""Which precurvatures does a robot need to reach given places while it carries a load?

Design is the calibration of a robot that does not exist yet. The wanted tips replace measured ones, precurvatures and
all actuations are unknown, and the tolerance of each place is its standard deviation. One program solves both.
"""

import numpy as np

import ctr_opt as ctr

TOLERANCE = 0.5e-3  # m


def robot(inner, outer):
    """Two superelastic tubes with so much curvature at their ends, 1/m."""
    material = {"youngs_modulus": 60e9, "poisson_ratio": 0.3}
    return ctr.Robot(
        [
            ctr.Tube("inner", 1.2e-3, 0.9e-3, [ctr.Straight(0.10), ctr.Arc(0.06, inner)], **material),
            ctr.Tube("outer", 1.8e-3, 1.4e-3, [ctr.Straight(0.05), ctr.Arc(0.05, outer)], **material),
        ]
    )


# Three places and a tool of 10 g, which gravity pulls along -y.
wanted = np.array([[0.000, 0.045, 0.110], [0.030, 0.010, 0.120], [-0.020, -0.030, 0.120]])
tool = [ctr.PointWrench(force=[0.0, -0.0981, 0.0])]
first = [ctr.Actuation([turn, turn], [-0.02, -0.01]) for turn in (np.pi, 0.5 * np.pi, 0.0)]
places = [
    ctr.Experiment(pose, tool, [ctr.PositionMeasurement(None, place, TOLERANCE)])
    for pose, place in zip(first, wanted, strict=True)
]
unknown = [
    ctr.Parameter(
        f"bend of tube {i}", tied=[f"tubes[{i}].precurvature[1].curvature"], bounds=(0.2, 3.0), prior=(1.0, 1.0)
    )
    for i in (0, 1)
]
for k, pose in enumerate(first):  # joints as near as may be to where they start: a radian counts as 20 mm
    unknown += [
        ctr.Parameter(f"experiments[{k}].rotations", prior=(pose.rotations, 1.0)),
        ctr.Parameter(f"experiments[{k}].translations", prior=(pose.translations, 0.02), bounds=(-0.04, 0.0)),
    ]
nominal = robot(10.0, 6.0)
fit = ctr.CalibrationProblem(nominal, places, unknown).solve()
design = fit.robot
bends = [tube.precurvature[1].curvature[0] for tube in design.tubes]
print(f"curvatures: inner {bends[0]:.2f}, outer {bends[1]:.2f} 1/m, from 10 and 6")

# What is wanted of each place: that it is reached, by a shape that is stable.
for k, (place, before) in enumerate(zip(wanted, fit.equilibria, strict=True)):
    shape = ctr.ForwardProblem(design).solve(before.actuation, tool, before)
    off = np.linalg.norm(shape.tip_position - place)
    print(f"place {k}: {1e3 * off:.2f} mm off, {'stable' if shape.is_stable else 'UNSTABLE'}, joints", end=" ")
    print(
        np.rad2deg(before.actuation.rotations).round(0).tolist(),
        (1e3 * before.actuation.translations).round(1).tolist(),
    )
    assert shape.is_stable
    assert off < 2.0 * TOLERANCE

# Could the robot as it was have done it?
answers = [ctr.InverseKinematicsProblem(nominal).solve(place, tool) for place in wanted]
for k, answer in enumerate(answers):
    print(f"place {k} with the curvatures as they were: {1e3 * answer.position_error:.1f} mm off at best")
assert max(answer.position_error for answer in answers) > 4.0 * TOLERANCE
