"""Numbers, symbols and compiled code agree where ends, steps of curvature, loads and measurements meet.

On random robots in whole centimetres (``tests/support/centimetres.py``). Which tube is meant follows from whole
picometres, what its frame is from the angles of the tubes, and what derivatives are from solving again.

All of 200 robots are asked for poses and for slopes where an inner tube ends. Jacobians and compliances cost many
solves, predictions and residuals a third of a second, models of symbols a second or more: of these there are fewer, and
all but a handful of everything but poses is left to the slow run.
"""

from functools import cache

import attrs
import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ctr_opt as ctr
from ctr_opt.force.model import loaded_model
from ctr_opt.forward.compiled import CompiledRecord
from ctr_opt.layout.ends import Ends
from ctr_opt.robot.names import parameters
from tests.support.centimetres import PM, case, metres
from tests.support.slow import some_slow

WAYS = {False: "virtual machine", True: "compiled"}
TOLERANCE = 1e-10  # of a solve: positions over the length
STEP = 2e-5  # rad, m: of differences
APART = 1e-4  # m: farther than differences go


def solve(given, compiled=True, **start):
    problem = ctr.ForwardProblem(given.robot, tolerance=TOLERANCE, compiled=compiled)
    return problem.solve(given.actuation, given.loads, **start)


@cache
def solved(index, riding=False):
    """The robot of an index and its shape, of compiled code."""
    given = case(index, riding=riding)
    return given, solve(given)


def moved(given, joint, by):
    """With one joint moved: rotations, then translations."""
    joints = np.concatenate((given.actuation.rotations, given.actuation.translations))
    joints[joint] += by
    return attrs.evolve(given, actuation=ctr.Actuation(*np.split(joints, 2)))


def turned(frames, angles):
    """Frames turned about their own z."""
    return frames @ Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0])).as_matrix()


def apart(pose, other):
    """Six numbers: the difference of positions, and the rotation vector in the world."""
    turn = Rotation.from_matrix(pose[:3, :3] @ other[:3, :3].T).as_rotvec()
    return np.append(pose[:3, 3] - other[:3, 3], turn)


def close(a, b, allowed):
    np.testing.assert_allclose(a, b, rtol=0.0, atol=allowed)


@pytest.mark.parametrize("block", range(8))
def test_poses_of_200_robots(block):
    """Of both kinds of shapes, to 2e-9: positions are good to 1e-11 m, and angles turn by 100 rad/m at most."""
    for index in range(25 * block, 25 * block + 25):
        given, shape = solved(index)
        assert isinstance(shape.record, CompiledRecord)
        both = shape, solve(given, compiled=False, initial=shape)
        s, tubes = np.array([metres(place) for place in given.places]), [given.innermost(x) for x in given.places]
        longest = given.innermost(given.tip)
        for one in both:
            turns = np.empty(len(s))
            for i in set(tubes):
                turns[np.equal(tubes, i)] = one.tube_angle(i, s[np.equal(tubes, i)])
            expected = turned(one.pose(s, longest)[:, :3, :3], turns - one.tube_angle(longest, s))
            close(one.pose(s)[:, :3, :3], expected, 1e-12)
            close(one.tip_pose[:3, :3], expected[-1], 1e-12)
        close(both[0].pose(s), both[1].pose(s), 2e-9)
        for i, end in enumerate(given.ends):
            close(both[0].pose(metres(end), i), both[1].pose(metres(end), i), 2e-9)


def base_at_entry(given, joint):
    """Whether a joint is the translation of a tube that cannot advance: its derivative is that from behind."""
    tubes = len(given.ends)
    return joint >= tubes and given.actuation.translations[joint - tubes] > -1e-9


def slope(given, shape, joint, side, pose):
    """The derivative of a pose by a joint from one side, of a parabola through three solves there."""
    shapes = [solve(moved(given, joint, side * k * STEP), initial=shape) for k in (1, 2, 3)]
    poses = [pose(one) for one in shapes]
    return np.array([-5.0, 8.0, -3.0]) @ [apart(one, poses[0]) for one in poses] / (2.0 * side * STEP)


@pytest.mark.parametrize("index", some_slow(range(60), [3, 4, 6, 13, 18]))
def test_jacobians_are_slopes_from_either_side(index):
    """Within 1e-5 of the largest: parabolas are off by STEP^2 times third derivatives, up to 1e4 of it by m and rad.

    Points 1e-12 m apart have an order, and no difference stays in it. There the same robots with points farther apart
    are differentiated, and the Jacobian is what theirs tend to, on a parabola.
    """
    given, shape = solved(index, riding=True)
    wider = [case(index, riding=True, apart=k * APART) for k in (1, 2, 3)] if given.moved == 1e-12 else []
    shapes = [solve(one) for one in wider]
    for side in (1, -1):
        jacobian, there, at = shape.jacobian(side=side), given, shape
        if wider:
            beside = [one.jacobian(side=side) for one in shapes]
            limit = np.tensordot([3.0, -3.0, 1.0], beside, axes=1)
            close(jacobian, limit, 1e-5 * np.abs(jacobian).max())
            jacobian, there, at = beside[0], wider[0], shapes[0]
        for joint, column in enumerate(jacobian.T):
            way = -1 if base_at_entry(there, joint) else side
            expected = slope(there, at, joint, way, lambda one: one.tip_pose)
            close(column, expected, 1e-5 * np.abs(jacobian).max())


@pytest.mark.parametrize("index", some_slow(range(200), [0, 1, 3, 6]))
def test_slopes_where_an_inner_tube_ends(index):
    """Of the pose at a fixed place, by rotations, in the frame of the tube that ends there; solves leave up to 2e-5."""
    given, shape = solved(index, riding=True)
    end = min(given.ends)
    tube, tubes = given.innermost(end), len(given.ends)
    found = shape.sensitivity(("pose", metres(end)), "rotations")
    for joint in range(tubes):
        expected = slope(given, shape, joint, 1, lambda one: one.pose(metres(end), tube))
        close(found[:, joint], expected, 3e-5 * np.abs(found).max())


@pytest.mark.parametrize("index", some_slow(range(100), [0, 1, 2, 5, 6]))
def test_compliances_are_slopes(index):
    """By forces and moments at tubes' ends, of 1e-4 of what would bend the robot much; as above."""
    given, shape = solved(index)
    for tube, end in enumerate(given.ends):
        compliance = shape.compliance(tube=tube)
        frame = tube if end == given.tip else given.innermost(given.tip)
        columns = []
        for unit in 1e-3 * np.eye(6) * np.repeat([1.0, 0.1], 3):
            pushed = [
                solve(attrs.evolve(given, loads=(*given.loads, ctr.PointWrench(*np.split(sign * unit, 2), tube=tube))))
                for sign in (1, -1)
            ]
            poses = [one.pose(one.length, frame) for one in pushed]
            columns.append(apart(*poses) / (2.0 * np.abs(unit).max()))
        close(compliance, np.transpose(columns), 1e-5 * np.abs(compliance).max())


SMOOTH = [5, 11, 14, 26, 32, 44, 59, 62, 74, 93, 94, 95, 107, 125, 137, 139, 144, 149, 161, 164, 167, 169, 179, 197]


@pytest.mark.parametrize("index", some_slow(SMOOTH, [5, 26, 197]))
def test_derivatives_in_compiled_code(index):
    """Where points are 1e-12 m apart there are no sides, and compiled code takes the derivatives itself."""
    given, shape = solved(index)
    other = solve(given, compiled=False, initial=shape)
    assert not shape.one_sided
    close(shape.jacobian(), other.jacobian(), 1e-7 * np.abs(other.jacobian()).max())
    for tube, end in enumerate(given.ends):
        if end == given.tip:
            close(shape.compliance(tube=tube), other.compliance(tube=tube), 1e-7 * np.abs(other.compliance()).max())


@pytest.mark.parametrize("riding", [False, True])
@pytest.mark.parametrize("index", some_slow(range(40), [0, 3, 11]))
def test_one_sided_derivatives_in_compiled_code(index, riding, monkeypatch):
    """Without symbols, from either side, at the tip and at a place where something ends or begins.

    They are evaluated some 1e-12 of the length beside; a point 1e-12 m away stays on its side. What remains are the
    errors of both solves, which derivatives amplify to 1e-6 of the largest.
    """
    given, shape = solved(index, riding)
    other = solve(given, compiled=False, initial=shape)
    rng, sides = np.random.default_rng(index), (1, -1)
    tube = int(rng.integers(len(given.ends)))
    place = metres(rng.choice([s for s in given.places if metres(s) < shape.length - 1e-9]))
    asked = {f"jacobian({s}, {k})": lambda e, s=s, k=k: e.jacobian(s, k) for s in (None, place) for k in sides}
    asked |= {f"compliance({s}, {tube})": lambda e, s=s: e.compliance(s, tube=tube) for s in (None, place)}
    asked |= {f"actuator_wrench({tube}, {k})": lambda e, k=k: np.array(e.actuator_wrench(tube, k)) for k in sides}
    expected = {name: question(other) for name, question in asked.items()}
    kinks, one_sided = other.kinks, other.one_sided

    def symbols(*_, **__):
        raise AssertionError("derivatives by symbols")

    monkeypatch.setattr("ctr_opt.forward.derivatives.derivatives", symbols)
    for name, question in asked.items():
        allowed = 1e-5 * np.abs(expected[name]).max() + 1e-9
        np.testing.assert_allclose(question(shape), expected[name], rtol=0.0, atol=allowed, err_msg=name)
    assert shape.kinks == kinks
    assert shape.one_sided == one_sided


def own_curvature(shape, tube, s):
    """Of a tube in its own frame, at its end."""
    own = shape.robot.tubes[tube]
    bend = shape.tube_moment(tube, s)[:2] / own.bending_stiffness + own.precurvature[-1].curvature[:2]
    return np.append(bend, shape.torsion(tube, s))


def poses(given, shape):
    """Measured at every place in the frame that is meant there, and at the ends of the tubes."""
    errors = {"sigma": [1e-4] * 3 + [1e-3] * 3}
    seen = [ctr.PositionMeasurement(None, shape.tip_position, 1e-4)]
    seen.append(ctr.PoseMeasurement(None, shape.tip_pose, **errors))
    for place in given.places:
        s = metres(place)
        seen.append(ctr.PoseMeasurement(s, shape.pose(s, given.innermost(place)), **errors))
        seen.append(ctr.PositionMeasurement(s, shape.position(s), 1e-4))
        seen.append(ctr.TangentMeasurement(s, shape.pose(s, given.innermost(place))[:3, 2], 1e-3))
    for tube, end in enumerate(shape.configuration.tube_ends):
        seen.append(ctr.PoseMeasurement(ctr.Distal(tube), shape.pose(end, tube), **errors))
    return seen


def measured(given, shape):
    """Those, and of every tube its pose and curvature at the place of its end, and its torque."""
    seen = poses(given, shape)
    for tube, end in enumerate(given.ends):
        s = metres(end)
        seen.append(ctr.PoseMeasurement(s, shape.pose(s, tube), [1e-4] * 3 + [1e-3] * 3, tube))
        bent = own_curvature(shape, tube, s)
        seen.append(ctr.CurvatureMeasurement([s, ctr.Distal(tube)], [bent, bent], 0.1, tube=tube))
        seen.append(ctr.TorqueMeasurement(tube, shape.actuator_wrench(tube)[1], 1e-3))
    return seen


def predicted(given, shape, compiled):
    """What a model says of all that is measured, each kind compared with the shape, and of forces on actuators."""
    seen, ends = measured(given, shape), Ends.of_robot(given.robot, given.actuation.translations)
    forces = [ctr.ForceMeasurement(tube, 0.0, 1e-3) for tube in range(len(given.ends))]
    observables = [one.framed(ends) for each in [*seen, *forces] for one in each.observables]
    names = [f"loads[0].{field}" for field in ("force", "moment")], ["rotations", "tubes[0].bending_stiffness"]
    known = parameters(given.robot, given.actuation, given.loads)
    values = np.concatenate([known[name].value for name in names[0]])
    model = loaded_model(given.robot, given.actuation, given.loads, *names, observables, compiled, lambda: 8)
    assert model.compiled == compiled
    reported, start = model.at(shape.unknowns, values, np.zeros(0)).predictions, 0
    for each in seen:
        misfit = each.compare([each], reported[start : start + len(each.observables)])[0]
        close(misfit, 0.0, 1e-6 if isinstance(each, ctr.CurvatureMeasurement) else 1e-7)
        start += len(each.observables)
    return reported, reported[start:]


@pytest.mark.parametrize("index", some_slow(range(100), [1, 3, 4, 5]))
def test_predictions_of_compiled_code(index):
    """What shapes show, to 1e-7 (curvatures, of 10/m, to 1e-6)."""
    predicted(*solved(index), compiled=True)


@pytest.mark.parametrize("index", some_slow([0, 2, 10, 31], [0, 2]))
def test_predictions_of_all_models(index):
    """As of compiled code, from symbols; slopes to 1e-6 of the largest; forces of one order."""
    reported, forces = zip(*(predicted(*solved(index), compiled=compiled) for compiled in (True, False)), strict=True)
    pushes = [np.vstack([each.value[0] for each in one]) for one in forces]
    close(*pushes, 1e-7)
    slopes = [np.vstack([each.slopes[0] for each in one]) for one in reported]
    size = np.abs(slopes[0]).max(axis=0)
    close(*(one / np.maximum(size, 1e-6 * size.max()) for one in slopes), 1e-6)


def rates(frame, slopes):
    """World angular velocities ``(3, k)`` of a frame whose entries, column by column, have slopes ``(9, k)``."""
    turns = [slope.reshape((3, 3), order="F") @ frame.T for slope in slopes.T]
    return np.transpose([[turn[2, 1], turn[0, 2], turn[1, 0]] for turn in turns])


def at_entry(given):
    """Whether a tube's base or a step of its curvature is at the entry."""
    steps = [(0.0, *np.cumsum([piece.length for piece in tube.precurvature])) for tube in given.robot.tubes]
    translations = given.actuation.translations
    return any(np.abs(np.add(*each)).min() < 1e-9 for each in zip(steps, translations, strict=True))


@pytest.mark.parametrize("index", some_slow(range(40), [0, 3, 4]))
def test_functions_of_problems(index):
    """Tips and their slopes, to 1e-7 of them: steps are the function's own. By translations from one of the sides.

    It takes one order of all points: of three tubes, or with points at the entry that only move out of it, there are
    more orders than two sides.
    """
    given, shape = solved(index, riding=True)
    tubes = len(given.ends)
    s = np.array([metres(place) for place in given.places])
    function = ctr.ForwardProblem(given.robot, tolerance=TOLERANCE).function(shape, along=s)
    joints = ca.MX.sym("joints", 2 * tubes)
    reported = function(rotations=joints[:tubes], translations=joints[tubes:], initial=shape.unknowns)
    out = [reported["tip_rotation"], reported["positions"], reported["tip_position"]]
    both = ca.vertcat(reported["tip_position"], ca.vec(reported["tip_rotation"]))
    at = np.concatenate((given.actuation.rotations, given.actuation.translations))
    frame, positions, tip, slopes = (
        part.full() for part in ca.Function("f", [joints], [*out, ca.jacobian(both, joints)])(at)
    )
    close(frame, shape.tip_pose[:3, :3], 1e-7)
    close(positions.T, shape.position(s), 1e-8)
    close(tip[:, 0], shape.tip_position, 1e-8)
    sides = [shape.jacobian(side=side) for side in (1, -1)]
    found = np.vstack((slopes[:3], rates(frame, slopes[3:])))
    close(found[:, :tubes], sides[0][:, :tubes], 1e-6)
    for joint in range(tubes, 2 * tubes if tubes == 2 and not at_entry(given) else tubes):
        beside = [np.abs(found[:3, joint] - side[:3, joint]).max() for side in sides]
        assert min(beside) < 1e-6 * np.abs(sides[0][:3]).max()


@pytest.mark.parametrize(
    ("index", "compiled"),
    some_slow([*((i, True) for i in range(40)), (1, False), (2, False), (10, False)], [(5, True), (8, True)]),
)
def test_residuals_of_random_robots(index, compiled):
    """At the true parameters, in 1/m, rad and m: as below, of robots that end and bend at the entry, too."""
    given, shape = solved(index)
    experiment = ctr.Experiment(given.actuation, given.loads, measured(given, shape))
    names = ["tubes[0].bending_stiffness"]
    nominal = ctr.CalibrationProblem(given.robot, [experiment], names, compiled=compiled).nominal()
    for residual in nominal.residuals:
        close(residual.value, 0.0, 2e-6)


@pytest.mark.parametrize(
    ("index", "compiled"), some_slow([*((i, True) for i in range(20)), (0, False), (1, False)], [(6, True)])
)
def test_sensors_at_ends_and_at_the_entry(index, compiled):
    """Coils beside the axis, where the first tube ends and at the entry, found from four turns, to 1e-7 m."""
    given, mounted, experiments = case(index), {"end": [1e-3, 2e-4, 0.0], "entry": [-3e-4, 1e-3, 0.0]}, []
    places = {"end": min(given.ends), "entry": 0}
    for turn in (0.0, 0.4, 0.8, 1.2):
        actuation = attrs.evolve(given.actuation, rotations=given.actuation.rotations + turn)
        shape, seen = solve(attrs.evolve(given, actuation=actuation)), []
        for name, place in places.items():
            frame = shape.pose(metres(place), given.innermost(place))
            at = frame[:3, 3] + frame[:3, :3] @ mounted[name]
            seen.append(ctr.PositionMeasurement(metres(place), at, 1e-4, sensor=name))
        experiments.append(ctr.Experiment(actuation, given.loads, seen))
    names = [f"sensors.{name}.translation" for name in places]
    fit = ctr.CalibrationProblem(given.robot, experiments, names, compiled=compiled).solve()
    for name in places:
        close(fit.values[f"sensors.{name}.translation"], mounted[name], 1e-7)


def experiments(offset, seen):
    """Of a robot whose inner tube is farther than was read, so that tubes are flush with others as it is read."""
    given, made = case(3, riding=True), []
    lengths = np.array([round(100 * tube.length) for tube in given.robot.tubes])
    for ends in ([4, 4, 6], [6, 4, 4], [5, 5, 5], [4, 5, 5]):
        read = ctr.Actuation(given.actuation.rotations, 0.01 * (np.array(ends) - lengths))
        true = ctr.Actuation(read.rotations, read.translations + np.array([offset, 0.0, 0.0]))
        one = attrs.evolve(given, actuation=true, ends=tuple(end * PM for end in ends))
        made.append(ctr.Experiment(read, one.loads, seen(one, solve(one))))
    return given.robot, made


@pytest.mark.parametrize("compiled", some_slow(list(WAYS), [True]), ids=WAYS.get)
def test_nothing_is_left_at_the_true_parameters(compiled):
    """But for the errors of solves, in 1/m, rad and m. Translations are unknown, too, and part what coincides."""
    names = ["tubes[0].translation_offset", "tubes[0].bending_stiffness"]
    nominal = ctr.CalibrationProblem(*experiments(0.0, measured), names, compiled=compiled).nominal()
    for residual in nominal.residuals:
        close(residual.value, 0.0, 2e-6)


@pytest.mark.parametrize("compiled", some_slow(list(WAYS), [True]), ids=WAYS.get)
def test_an_offset_is_found_though_measurements_are_where_the_tube_was_read_to_end(compiled):
    """What is measured there stays on that tube; 0.1 mm to 1e-9 m."""
    fit = ctr.CalibrationProblem(*experiments(1e-4, poses), ["tubes[0].translation_offset"], compiled=compiled).solve()
    close(fit.values["tubes[0].translation_offset"], 1e-4, 1e-9)


@pytest.mark.parametrize(
    ("index", "compiled"),
    [
        *(pytest.param(1, False), pytest.param(3, False, marks=pytest.mark.slow)),
        *(pytest.param(1, True), pytest.param(3, True)),
    ],
    ids=lambda value: WAYS[value] if isinstance(value, bool) else str(value),
)
def test_forces_from_what_a_robot_shows(index, compiled):
    """The force that acts, whatever model explains the measurements, to 1e-5 of it."""
    given = case(index)
    shape = solve(given)
    tube = given.innermost(given.tip)
    force = np.array([0.05, -0.08, 0.02])
    pushed = attrs.evolve(given, loads=(*given.loads, ctr.PointWrench(force, tube=tube)))
    shape = solve(pushed)
    problem = ctr.ForceEstimationProblem(given.robot, ctr.TipForce(), compiled=compiled)
    found = problem.solve(given.actuation, measured(given, shape), given.loads)
    assert found.consistent
    close(found.estimates, force, 1e-5 * np.abs(force).max())
