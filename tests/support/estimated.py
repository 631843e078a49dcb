"""What the tests of estimation share: small robots, experiments with every kind of measurement, seeded noise."""

import attrs
import numpy as np
from scipy.spatial.transform import Rotation

import ctr_opt as ctr
from ctr_opt.robot.names import parameters, robot_with

NOISE = {"position": 5e-4, "angle": 5e-3, "curvature": 5e-2, "torque": 1e-4}
_LENGTHS = ((0.16, 0.08), (0.09, 0.07), (0.05, 0.06))
_DIAMETERS = ((1.0e-3, 0.7e-3), (1.6e-3, 1.2e-3), (2.4e-3, 1.9e-3))


def small_robot(tubes):
    """Tubes with moduli, straight behind, of a polynomial or constant precurvature in front; a turned base."""
    made = []
    for i in range(tubes):
        straight, bent = _LENGTHS[i]
        piece = ctr.Arc(bent, [5.0 - i, 1.0 + i, 0.1])
        if i == 0:
            piece = ctr.PolynomialCurvature(bent, [[1.0, 9.0, 0.2], [2.0, -3.0, 0.1]])
        pieces = [ctr.Straight(straight), piece]
        made.append(ctr.Tube(f"tube {i}", *_DIAMETERS[i], pieces, youngs_modulus=60e9, shear_modulus=22e9))
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    pose[:3, 3] = [0.01, -0.02, 0.03]
    return ctr.Robot(made, pose, on_overlap="ignore")


def off_by(robot, factors):
    """A robot with some of its parameters multiplied."""
    known = parameters(robot, ctr.Actuation(np.zeros(len(robot.tubes)), np.zeros(len(robot.tubes))))
    return robot_with(robot, {name: known[name].value * factor for name, factor in factors.items()})


def actuations(rng, robot, count):
    """Whose tubes end one behind the other, at least 12 mm apart, so that nothing coincides."""
    n = len(robot.tubes)
    lengths = np.array([tube.length for tube in robot.tubes])
    found = []
    for _ in range(count):
        ends = 0.04 + np.cumsum(rng.uniform(0.012, 0.025, n))[::-1]
        found.append(ctr.Actuation(rng.uniform(-1.5, 1.5, n), ends - lengths))
    return found


def solve(robot, actuation, loads=(), tolerance=1e-9):
    return ctr.ForwardProblem(robot, tolerance=tolerance).solve(actuation, loads)


def arc_length(shape, place):
    """Where a place is."""
    ends = np.array([t.length for t in shape.robot.tubes]) + shape.actuation.translations
    return float(ends.max() if place is None else ends[place.tube] if isinstance(place, ctr.Distal) else place)


def fibre(shape, tube, s):
    """Curvature in a tube's own frame, and its torsion; at its end the limit from within it."""
    s = min(s, arc_length(shape, ctr.Distal(tube)) - 1e-11)
    bent, angle = shape.curvature(s)[:2], shape.tube_angle(tube, s)
    c, d = np.cos(angle), np.sin(angle)
    return np.array([c * bent[0] + d * bent[1], c * bent[1] - d * bent[0], shape.torsion(tube, s)])


def every_kind(shape, rng=None):
    """A measurement of each kind, with errors if there is a generator."""
    last = len(shape.robot.tubes) - 1

    def off(size, kind):
        return np.zeros(size) if rng is None else NOISE[kind] * rng.normal(size=size)

    def turned(frame):
        return Rotation.from_rotvec(off(3, "angle")).as_matrix() @ frame

    pose = np.array(shape.pose(shape.length, 0))
    pose[:3, :3], pose[:3, 3] = turned(pose[:3, :3]), pose[:3, 3] + off(3, "position")
    end = ctr.Distal(last)
    places = [0.02, end, None]
    where = np.array([shape.position(arc_length(shape, each)) for each in places])
    bent = np.array([fibre(shape, last, s) for s in (0.011, 0.033)])
    tangent = turned(shape.pose(arc_length(shape, end))[:3, 2])
    torque = shape.actuator_wrench(last)[1] + off((), "torque")
    both = [NOISE["position"]] * 3 + [NOISE["angle"]] * 3
    return [
        ctr.PositionMeasurement(places, where + off((3, 3), "position"), sigma=NOISE["position"]),
        ctr.PoseMeasurement(None, pose, sigma=both, tube=0),
        ctr.TangentMeasurement(end, tangent, sigma=NOISE["angle"]),
        ctr.CurvatureMeasurement([0.011, 0.033], bent + off((2, 3), "curvature"), sigma=NOISE["curvature"], tube=last),
        ctr.TorqueMeasurement(last, torque, sigma=NOISE["torque"]),
    ]


def points(shape, rng=None):
    """Positions of all tubes' ends."""
    places = [ctr.Distal(i) for i in range(len(shape.robot.tubes))]
    found = np.array([shape.position(arc_length(shape, place)) for place in places])
    if rng is not None:
        found = found + NOISE["position"] * rng.normal(size=found.shape)
    return [ctr.PositionMeasurement(places, found, sigma=NOISE["position"])]


def experiments(robot, count, seed, measured=points, *, loaded=True, noise=True, size=0.3):
    """Seeded experiments on a robot; every other one with a force at the tip, of 0.3 N in each axis."""
    rng = np.random.default_rng(seed)
    found = []
    for k, actuation in enumerate(actuations(rng, robot, count)):
        loads = [ctr.PointWrench(size * rng.normal(size=3))] if loaded and k % 2 else []
        shape = solve(robot, actuation, loads)
        found.append(ctr.Experiment(actuation, loads, measured(shape, rng if noise else None)))
    return found


def with_points(data, change=lambda position, k: position, sigma=NOISE["position"]):
    """Experiments with other positions and another noise level."""
    made = []
    for k, each in enumerate(data):
        (old,) = each.measurements
        new = ctr.PositionMeasurement(old.arc_length, change(np.array(old.position), k), sigma)
        made.append(attrs.evolve(each, measurements=[new]))
    return made


def estimation(robot, data, wanted, loss="squared", tolerance=1e-9, compiled=False):
    """An estimation that is ready, and its equilibria at the initial values."""
    problem = ctr.CalibrationProblem(robot, data, wanted, loss=loss, tolerance=tolerance, compiled=compiled)
    made = problem.nominal().estimation
    equilibria = made.equilibria(made.unknowns.initial)
    made.prepare(equilibria)
    return made, equilibria


def flat(values):
    """The numbers of a dictionary, one behind the other."""
    return np.concatenate([np.ravel(value) for value in values.values()])
