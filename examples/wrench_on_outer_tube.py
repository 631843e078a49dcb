"""What happens when something grips the outer tube?

A load acts on one tube. Forces and bending moments pass on to the tubes inside, because the tubes share one shape. A
moment about the axis twists the loaded tube, and the others only as far as their curvature makes them follow.
"""

from pathlib import Path

import numpy as np

import ctr_opt as ctr

RJW = Path(__file__).resolve().parent.parent / "problems" / "rjw_s1"  # a synthetic robot

robot = ctr.load_robot(RJW / "robot.toml")
inner, outer = robot.tubes
problem = ctr.ForwardProblem(robot)
pose = ctr.Actuation(rotations=np.deg2rad([135.0, 0.0]), translations=[-0.1547, -0.0307])
free = problem.solve(pose)
end = outer.length - 0.0307  # m: where the outer tube ends, and without an arc length the load rides on it

moment = 0.05 * free.pose(end)[:3, 2]  # N m, along the backbone as it is there without load
shapes = {
    "outer": problem.solve(pose, [ctr.PointWrench(moment=moment, tube=1)], initial=free),
    "inner": problem.solve(pose, [ctr.PointWrench(moment=moment, arc_length=end, tube=0)], initial=free),
}
for name, shape in shapes.items():
    angles = [np.degrees(shape.tube_angle(i, end) - free.tube_angle(i, end)) for i in (0, 1)]
    moved = 1e3 * np.linalg.norm(shape.tip_position - free.tip_position)
    print(f"50 N mm on the {name} tube turn inner, outer by {angles[0]:6.2f}, {angles[1]:6.2f} degrees;", end=" ")
    print(f"the tip moves by {moved:.2f} mm")

# At its end the outer tube carries what is applied about its axis, and nothing else. The inner tube does not feel it:
# its torsion goes on past the outer tube's end without a step.
held, beside = shapes["outer"], 1e-9
about_the_axis = held.pose(end)[:3, 2] @ moment
print(f"torsional moment in the outer tube's end: {1e3 * outer.torsional_stiffness * held.torsion(1, end):.6f} N mm")
np.testing.assert_allclose(outer.torsional_stiffness * held.torsion(1, end), about_the_axis, atol=1e-7 * 0.05)
np.testing.assert_allclose(held.torsion(0, end), held.torsion(0, end - beside), atol=100.0 * beside)  # slope below 100
# On the inner tube the same moment makes a step there, and leaves the outer tube's end free.
step = shapes["inner"].torsion(0, end - beside) - shapes["inner"].torsion(0, end)
about_the_axis = shapes["inner"].pose(end)[:3, 2] @ moment
np.testing.assert_allclose(inner.torsional_stiffness * step, about_the_axis, atol=1e-7 * 0.05)
assert abs(outer.torsional_stiffness * shapes["inner"].torsion(1, end)) < 1e-7 * 0.05  # of the moment, as above
