"""What force pulled at the robot, seen by two cameras, and where does it move the tip?

As in the paper's section III-A, a grid of known points registers the cameras' frame to the robot's. Points marked on a
wire give the direction of its force, the hanging mass its magnitude. The clicks are synthetic: true pixels with noise
of 0.3 px. The robot, RJW-S1, is a synthetic stand-in: no number here is a result of the paper.
"""

from pathlib import Path

import numpy as np

import ctr_opt as ctr
from ctr_opt.sensing import Camera, hanging_mass, register, triangulate

RJW = Path(__file__).resolve().parent.parent / "problems" / "rjw_s1"
rng = np.random.default_rng(2010)

# Two cameras of 1024 x 768 pixels, calibrated in the frame of the first, which stands 0.7 m beside the robot.
lens = {"distortion": [-0.21, 0.13, 8e-4, -5e-4], "resolution": (1024, 768)}
matrix = [[1900.0, 0.0, 509.0], [0.0, 1900.0, 390.0], [0.0, 0.0, 1.0]]
second = Camera.from_opencv(matrix, **lens, rotation=[0.0, 0.35, 0.0], translation=[-0.25, 0.0, 0.05])
first = Camera(matrix, **lens)
robot_from_first = np.array([[0, 0, -1.0, 0.7], [0, 1, 0, 0], [1, 0, 0, 0.12], [0, 0, 0, 1]])


def clicks(points):
    """Pixels of points in the robot's frame, with noise."""
    pixels = np.stack([camera.moved(robot_from_first).project(points) for camera in (first, second)], axis=1)
    return pixels + 0.3 * rng.normal(size=pixels.shape)


grid = np.stack(np.meshgrid(0.0, [-0.06, -0.03, 0.0, 0.03, 0.06], [0.08, 0.11, 0.14, 0.17]), axis=-1).reshape(-1, 3)
seen = triangulate([first, second], clicks(grid), sigma=0.3)
registration = register(seen.points, grid, covariances=seen.covariances)
print(registration.report(), end="\n\n")

# The wire leaves the tip toward a pulley; black bands mark it every 10 mm.
direction = np.array([-0.48, 0.64, -0.60]) / np.linalg.norm([-0.48, 0.64, -0.60])
bands = [0.05, -0.02, 0.15] + np.arange(7)[:, None] * 0.01 * direction
marks = triangulate([camera.moved(registration.pose) for camera in (first, second)], clicks(bands), sigma=0.3)
pull = hanging_mass(0.1, marks.points, covariances=marks.covariances, gravity=9.81, mass_sigma=1e-4, tension_sigma=9e-3)
print(pull.report(), end="\n\n")

# What the robot makes of it: the tip, and how far the force's uncertainty moves it.
problem = ctr.ForwardProblem(ctr.load_robot(RJW / "robot.toml"))
pushed = problem.solve(ctr.Actuation(np.deg2rad([135.0, 0.0]), [-0.1547, -0.0307]), [pull.load()])
compliance = pushed.compliance()[:3, :3]
spread = np.sqrt(np.diag(compliance @ pull.covariance @ compliance.T))
print("tip at", 1e3 * pushed.tip_position.round(6), "mm, known from the force to", 1e3 * spread.round(6), "mm")

# The truth is inside of four standard deviations: of the force in any direction, and of the frame.
error = pull.force - 0.981 * direction
assert error @ np.linalg.solve(pull.covariance, error) < 16.0
assert np.all(np.abs(registration.pose[:3, 3] - robot_from_first[:3, 3]) < 4.0 * registration.standard_deviations[:3])
