"""Compiled predictions against derivatives of equilibria, which share no code with them, and against differences."""

import pickle

import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.forward.record import PoseRate
from ctr_opt.layout.ends import Ends
from ctr_opt.layout.observables import Distal, Observable
from ctr_opt.native.compile import compiler
from ctr_opt.native.predictions import Predictions, supported
from ctr_opt.robot.names import parameters
from tests.support.perturbed import TIGHT, central, changed, pose_vector
from tests.support.physics import held, random_problem, robot, rod, tube, tube_ends
from tests.support.slow import some_slow

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")

NOTHING = 1e-3  # of what a parameter does at the tip: derivatives below are compared with this
STIFFNESSES = ("bending_stiffness", "torsional_stiffness")
TIP = Observable("pose")
STEPS = {"translations": 2e-5, "arc_length": 2e-5, "rotations": 1e-3, "base.rotation": 1e-3, "base.translation": 1e-3}


def case(seed, tubes, body=False):
    """A random robot with its base drawn back, a load in the middle of a tube, and others that compiled code knows."""
    rng = np.random.default_rng(seed)
    made, actuation, loads = random_problem(rng, tubes, load=0.5, pose=True, functions=False)
    loads = [x for x in loads if not (isinstance(x, ctr.DistributedLoad) and not isinstance(x.force, np.ndarray))]
    ends = tube_ends(made, actuation)
    force = 0.3 * max(t.bending_stiffness for t in made.tubes) / ends.max() ** 2

    def random(size):
        return size * force * rng.normal(size=3)

    loads.append(ctr.PointWrench(random(1.0), random(0.1 * ends.max()), 0.5 * ends[0]))
    loads.append(ctr.DistributedLoad(random(1.0 / ends[-1]), random(0.1), 0.2 * ends[-1], None, tubes - 1))
    if body:
        loads.append(ctr.PointWrench(random(0.5), random(0.1 * ends.max()), tube=tubes - 1, frame="body"))
        loads.append(
            ctr.DistributedLoad(random(0.5 / ends[0]), random(0.05), 0.2 * ends[0], 0.8 * ends[0], frame="body")
        )
    places = [(None, None), (0.0, None), (0.37 * ends[-1], tubes - 1), (float(ends[0]), 0)]
    places += [(Distal(i), None) for i in range(tubes)]
    return rng, made, actuation, loads, [Observable("pose", *place) for place in places]


def names_of(made, actuation, loads):
    """Those that are supported, stiffnesses apart, as moduli and diameters make them."""
    given = [name for name, p in parameters(made, actuation, loads).items() if not p.idle]
    names = [name for name in given if supported(name, made, loads)]
    groups = [[name for name in names if name.endswith(STIFFNESSES) is flag] for flag in (False, True)]
    return [group for group in groups if group]


def solved(model, start):
    """Unknowns at which nothing is left, by Newton's method from nearby."""
    z = start.copy()
    for _ in range(3):
        now = model.at(z[None])
        assert not now.failed.any()
        z -= np.linalg.solve(now.slopes[0][:, : model.unknowns], now.residual[0])
    np.testing.assert_allclose(z, start, rtol=0.0, atol=1e-6 * np.abs(start).max())
    return z


def total(model, at):
    """Derivatives of what is observed at an equilibrium: by the implicit-function theorem."""
    n = model.unknowns
    unknowns = -np.linalg.solve(at.slopes[0][:, :n], at.slopes[0][:, n:])
    return [one.slopes[0][..., n:] + one.slopes[0][..., :n] @ unknowns for one in at.observed]


def tangent(result, i, ends):
    """The pose's change with arc length at a tube's end, from the left, per metre: differences of the shape itself."""
    s = ends[i]
    h = 1e-4
    poses = [pose_vector(result.pose(s - k * h, i), result.pose(s, i)) for k in range(5)]
    return -sum(w * p for w, p in zip(np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / 12.0 / h, poses, strict=True))


CASES = [(0, False), (1, False), (2, False), (0, True), (1, True)]  # seeds, and whether with body loads


@pytest.mark.parametrize(("seed", "body"), some_slow(CASES, [(0, True)]))
def test_derivatives_at_equilibria_are_sensitivities(seed, body):
    _, made, actuation, loads, probes = case(seed, 1 + seed % 3, body)
    result = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, loads)
    ends, known = tube_ends(made, actuation), parameters(made, actuation, loads)
    for names in names_of(made, actuation, loads):
        model = Predictions(made, names, [(actuation, loads)], probes, refinements=1)
        at = model.at(solved(model, result.unknowns)[None])
        columns = np.cumsum([0, *(known[name].size for name in names)])
        effect = None
        for one, found, pose in zip(probes, total(model, at), at.observed, strict=True):
            effect = np.abs(found).max(axis=0) if effect is None else effect  # at the tip
            end = one.place.tube if isinstance(one.place, Distal) else None
            s, carrier = (one.place, one.tube) if end is None else (ends[end], end)
            of = "tip_pose" if s is None else ("pose", s) if carrier is None else ("pose", s, carrier)
            reference = result.tip_pose if s is None else result.pose(s, carrier)
            np.testing.assert_allclose(pose.value[0], reference[:3], atol=1e-9)
            expected = result.sensitivity(of, names).copy()
            for name, first, last in zip(names, columns, columns[1:], strict=False):
                tolerance = 1e-7
                if name == "translations" and end is not None:
                    expected[:, first + end] += tangent(result, end, ends)  # it moves along
                    tolerance = 1e-5  # of the difference
                a, b = found[:, first:last], expected[:, first:last]
                scale = max(np.abs(b).max(), NOTHING * effect[first:last].max())
                np.testing.assert_allclose(a, b, rtol=0.0, atol=tolerance * scale, err_msg=f"{name} {one}")


class Away:
    """A random case at unknowns that are not those of an equilibrium, and what it is with a number changed."""

    def __init__(self, seed, body):
        self.rng, self.robot, self.actuation, self.loads, probes = case(10 + seed, 1 + seed % 3, body)
        ends = tube_ends(self.robot, self.actuation)
        poses = [*probes[:3], Observable("pose", 0.81 * float(ends[0])), *probes[4:]]
        carriers = Ends.of_robot(self.robot, self.actuation.translations)
        fibres = [Observable("tube_curvature", one.place, one.framed(carriers).frame) for one in poses]
        self.observables, self.poses = [*poses, *fibres, Observable("base_wrench")], len(poses)
        self.length = ends.max()
        self.unit = max(t.bending_stiffness for t in self.robot.tubes) / self.length
        self.names = names_of(self.robot, self.actuation, self.loads)
        self.z = 0.3 * self.unit * self.rng.normal(size=self.at([], np.zeros(0)).slopes.shape[-1])
        self.direction = self.rng.normal(size=len(self.z)) * self.unit

    def at(self, names, z, of=None):
        robot, actuation, loads = of or (self.robot, self.actuation, self.loads)
        model = Predictions(robot, names, [(actuation, loads)], self.observables, refinements=1)
        return model.at(z[None] if z.size else np.zeros((1, model.unknowns)))

    @property
    def scales(self):
        """By what curvatures and the base wrench are multiplied to be dimensionless."""
        wrench = np.repeat([self.length / self.unit, 1.0 / self.unit], 3)
        return [self.length] * self.poses + [wrench]

    def values(self, found, reference):
        """Residual, poses as position and turn from a reference, and the rest dimensionless."""
        k = self.poses
        poses = [pose_vector(found.observed[i].value[0], reference.observed[i].value[0]) for i in range(k)]
        rest = [factor * one.value[0] for factor, one in zip(self.scales, found.observed[k:], strict=True)]
        return np.concatenate([found.residual[0] / self.unit, *poses, *rest])

    def slopes(self, found):
        factors = [1.0] * self.poses + self.scales
        rows = [
            np.reshape(factor, (-1, 1)) * one.slopes[0] for factor, one in zip(factors, found.observed, strict=True)
        ]
        return np.concatenate([found.slopes[0] / self.unit, *rows])

    def with_unknowns(self, x):
        return self.at([], self.z + x * self.direction)

    def with_parameter(self, name, value):
        return self.at([], self.z, of=changed(self.robot, self.actuation, self.loads, name, value))


@pytest.mark.parametrize(("seed", "body"), CASES)
def test_derivatives_away_from_equilibria_are_differences(seed, body):
    """Along random directions of the unknowns and of each parameter: poses, curvatures, the wrench at the base."""
    case = Away(seed, body)
    known, n = parameters(case.robot, case.actuation, case.loads), len(case.z)
    for names in case.names:
        at = case.at(names, case.z)
        assert not at.failed.any()
        moves, columns = [(case.with_unknowns, case.direction, 1e-3)], [slice(0, n)]
        for name in names:
            value, first = known[name].value, columns[-1].stop
            d = np.asarray(case.rng.uniform(-1.0, 1.0, value.shape))
            h = STEPS.get(name, STEPS.get(name.rpartition(".")[2], 1e-3 * max(np.abs(value).max(), 1e-3)))
            moves.append((lambda x, of=(name, value, d): case.with_parameter(of[0], of[1] + x * of[2]), d.ravel(), h))
            columns.append(slice(first, first + value.size))
        for (move, direction, h), part in zip(moves, columns, strict=True):
            found = case.slopes(at)[:, part] @ direction
            wanted = central(lambda x, move=move, at=at: case.values(move(x), at), h)
            atol = 1e-6 * max(np.abs(wanted).max(), 1e-6)
            np.testing.assert_allclose(found, wanted, rtol=0.0, atol=atol, err_msg=str([names, part]))


def pushed():
    made = robot(tube("inner", [ctr.Straight(0.05), ctr.Arc(0.08, 8.0)]), tube("outer", ctr.Arc(0.06, 3.0), 0.05, 0.04))
    return made, ctr.Actuation([0.3, -0.5], [-0.02, -0.01]), [ctr.PointWrench([0.2, 0.1, -0.1])]


def test_many_experiments_are_as_many_single_ones():
    made, actuation, _ = pushed()
    rng = np.random.default_rng(1)
    experiments = [
        (ctr.Actuation(rng.normal(size=2), actuation.translations * rng.uniform(0.5, 1.0)),
         [ctr.Gravity([0.0, 0.0, -9.0])] * (k % 2) + [ctr.PointWrench(0.1 * rng.normal(size=3), arc_length=0.03)])
        for k in range(6)
    ]  # fmt: skip
    places = np.array([[np.nan, *[rng.uniform(0.0, 0.03)] * 2] for _ in experiments])
    observables = [TIP, Observable("pose", 0.01), Observable("tube_curvature", 0.01, 1), Observable("base_wrench")]
    names = ["rotations", "tubes[1].bending_stiffness"]
    z = 0.1 * rng.normal(size=(6, 4))
    many = Predictions(made, names, experiments, observables, places).at(z)
    assert many.observed[0].slopes.shape == (6, 6, 4 + 3)
    for k, each in enumerate(experiments):
        one = Predictions(made, names, [each], observables, places[k : k + 1]).at(z[k : k + 1])
        for name in ("residual", "slopes"):
            np.testing.assert_array_equal(getattr(one, name)[0], getattr(many, name)[k])
        for a, b in zip(one.observed, many.observed, strict=True):
            np.testing.assert_array_equal(a.value[0], b.value[k])
            np.testing.assert_array_equal(a.slopes[0], b.slopes[k])


def test_what_is_asked_for_changes_nothing_else():
    """Directions in another order, with others between: what shares a block does not mix."""
    made, actuation, loads = pushed()
    z = np.array([[0.02, -0.01, 0.003, 0.004]])
    names = ["translations", "loads[0].moment", "base.rotation", "tubes[0].precurvature[1].curvature"]
    names += ["base.translation", "loads[0].force", "tubes[1].torsional_stiffness", "rotations"]
    known = parameters(made, actuation, loads)
    probes = [Observable("pose", 0.0), Observable("pose", Distal(1)), TIP]
    every = Predictions(made, names, [(actuation, loads)], probes).at(z)
    column = 4
    for name in names:
        alone = Predictions(made, [name], [(actuation, loads)], probes).at(z)
        size = known[name].size
        for a, b in ((alone.observed.slopes, every.observed.slopes), (alone.slopes, every.slopes)):
            np.testing.assert_allclose(a[..., 4:], b[..., column : column + size], rtol=1e-12, atol=1e-14)
        column += size


def test_a_base_at_the_entry_is_drawn_back():
    made, _, loads = pushed()
    actuation = ctr.Actuation([0.3, -0.5], [-0.02, 0.0])
    result = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, loads)
    model = Predictions(made, ["translations"], [(actuation, loads)], [TIP], refinements=1)
    found = total(model, model.at(solved(model, result.unknowns)[None]))[0]
    np.testing.assert_allclose(found, result.sensitivity("tip_pose", "translations"), atol=1e-7)


@pytest.mark.parametrize(("seed", "body"), [(1, True), (2, False)])
def test_jacobian_and_compliance_come_from_the_same_sweep(seed, body):
    """A copy that has left its library behind takes the slower way."""
    _, made, actuation, loads, _ = case(seed, 1 + seed % 3, body)
    result = ctr.ForwardProblem(made, compiled=True).solve(actuation, loads)
    copy = pickle.loads(pickle.dumps(result))
    for name in ("jacobian", "compliance"):
        a, b = getattr(result, name)(), getattr(copy, name)()
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-12 * np.abs(b).max())
    assert result.record.rates(PoseRate()) is not None  # by compiled code
    assert copy.record.rates(PoseRate()) is None


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("name", ["translations", "loads[1].arc_length"])
def test_derivatives_with_two_sides(name, side):
    """A load at a fixed place where a tube ends, which may be drawn back or reach further."""
    made, actuation, loads = pushed()
    end = float(tube_ends(made, actuation)[1])
    there = [*loads, ctr.PointWrench([0.1, 0.0, 0.0], arc_length=end)]
    result = ctr.ForwardProblem(made, tolerance=TIGHT).solve(actuation, there)
    observables = [TIP, Observable("pose", 0.01, 1), Observable("base_wrench")]
    model = Predictions(made, [name], [(actuation, there)], observables, refinements=1, side=side)
    values = model.at(solved(model, result.unknowns)[None])
    assert not values.failed.any()
    for one, of in zip(total(model, values), ("tip_pose", ("pose", 0.01, 1), "base_wrench"), strict=True):
        exact = result.sensitivity(of, name, side=side).reshape(one.shape)
        # evaluated 1e-9 of the length beside, and the virtual machine's answer is as good as its solve
        np.testing.assert_allclose(one, exact, rtol=0.0, atol=1e-6 * np.abs(exact).max())


def test_a_failed_experiment_leaves_the_others():
    made, actuation, loads = pushed()
    far = ctr.Actuation([0.0, 0.0], [-0.13, 0.0])  # wholly behind the entry point
    model = Predictions(made, ["rotations"], [(actuation, loads), (far, loads)], [Observable("pose", 0.01, 1)])
    found = model.at(np.zeros((2, 4)))
    assert found.failed.astype(bool).tolist() == [False, True]
    assert np.isfinite(found.observed[0].value[0]).all()
    assert np.isnan(found.residual[1]).all()


def test_what_is_supported():
    made, _, loads = pushed()
    loads = [*loads, ctr.Gravity([0.0, 0.0, -9.0]), ctr.PointMass(0.01, 0.02), ctr.DistributedLoad([1.0, 0.0, 0.0])]
    yes = ["rotations", "base.rotation", "tubes[1].bending_stiffness", "tubes[0].precurvature[1].curvature"]
    yes += ["loads[0].moment", "loads[2].arc_length", "loads[3].force"]
    no = ["loads[1].acceleration", "loads[0].arc_length", "tubes[0].precurvature[1].length", "loads[2].mass", "nothing"]
    no += [
        "tubes[2].bending_stiffness",
        "tubes[0].precurvature[0].curvature",
        "loads[3].start",
        "tubes[0].shear_modulus",
    ]
    assert [name for name in (*yes, *no) if supported(name, made, loads)] == yes
    heavy = ctr.Tube("heavy", 2e-3, 1e-3, ctr.Straight(0.1), 60e9, poisson_ratio=0.3, density=6000.0)
    assert supported("tubes[0].inner_diameter", robot(heavy))
    assert not supported("tubes[0].inner_diameter", robot(heavy), loads)


def test_wrong_questions_are_reported():
    made = rod()
    cases = {
        "does not support derivatives": (["tubes[0].precurvature[0].length"], TIP, []),
        "is not a parameter": (["rotation"], TIP, []),
        r"observables\[0\].place = 0.2": ([], Observable("pose", 0.2), []),
        "tube = 1 must be": ([], Observable("pose", 0.05, 1), []),
        "loads: compiled code": ([], TIP, [ctr.DistributedLoad(force=lambda s: [s, 0.0, 0.0])]),
        "cannot predict it": ([], Observable("internal_force", 0.05), []),
    }
    for message, (names, observable, loads) in cases.items():
        with pytest.raises(ctr.DefinitionError, match=message):
            Predictions(made, names, [(held(), loads)], [observable])
    with pytest.raises(ctr.DefinitionError, match="experiments is empty"):
        Predictions(made, [], [], [TIP])
    with pytest.raises(ctr.DefinitionError, match="unknowns"):
        Predictions(made, [], [(held(), [])], [TIP]).at(np.zeros((1, 4)))
