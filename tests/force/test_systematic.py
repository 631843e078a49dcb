"""What errors of the model do to estimated forces: against estimates from shapes of robots that have them."""

import attrs
import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.force.systematic import Systematic
from ctr_opt.robot.names import parameters, robot_with

SIGMA = 2e-4  # m
PLACES = np.linspace(0.1, 0.98, 12) * 0.163  # m; a point at the tip itself could move to one side only
FORCE = [0.24, -0.3, 0.16]  # N
STEPS = {"m": 2e-5, "rad": 2e-4, "1": 2e-3}  # sizes of errors, small enough for first order


@attrs.frozen
class Way:
    """How a force is estimated."""

    unknown: object = ctr.TipForce()
    options: dict = attrs.field(factory=dict)
    somewhere: bool = False

    def solve(self, given, points, initial=None):
        seen = ctr.PositionMeasurement(PLACES, points, SIGMA)
        if self.somewhere:
            seen = ctr.BackboneMeasurement(points, SIGMA)
        problem = ctr.ForceEstimationProblem(given.robot, self.unknown, compiled=True, tolerance=1e-9, **self.options)
        return problem.solve(given.actuation, seen, initial=initial)


WAYS = {
    "force": Way(),
    "prior": Way(options={"prior": (FORCE, 0.05)}),
    "points somewhere": Way(somewhere=True),
    "errors of the actuation": Way(options={"rotation_sigma": 0.02}),
    "wrench": Way(ctr.TipWrench()),
    "two forces": Way([ctr.PointForce(0.08), ctr.TipForce()]),
}


@pytest.fixture(scope="module")
def given():
    return ctr.load_problem("problems/three_tubes/b1.toml")


def points(given, error=None, size=0.0):
    """Of a robot with an error of the model, under a force at its tip."""
    known = parameters(given.robot, given.actuation)
    changes = {} if error is None else error.changes
    robot = robot_with(given.robot, {name: known[name].value + size * change for name, change in changes.items()})
    problem = ctr.ForwardProblem(robot, tolerance=1e-10, compiled=True)
    return problem.solve(given.actuation, [ctr.PointWrench(FORCE)]).position(PLACES)


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_estimates_follow_errors_of_the_model(given, way):
    """Differences of estimates from exact points to both sides: a part in 200 of second and third order."""
    right = way.solve(given, points(given))
    for error in right.systematic:
        step = STEPS[error.unit]
        up, down = (way.solve(given, points(given, error, size), right) for size in (step, -step))
        change = (up.estimates - down.estimates) / (2.0 * step)
        np.testing.assert_allclose(error.rates, change, atol=5e-3 * np.abs(change).max(), err_msg=str(error))
        bend = up.chi_squared + down.chi_squared - 2.0 * right.chi_squared
        assert error.noncentrality == pytest.approx(bend / (2.0 * step**2), rel=0.02), str(error)
        assert error.force_rate.shape == np.shape(right.force)


@pytest.fixture(scope="module")
def estimate(given):
    return Way().solve(given, points(given))


@pytest.mark.parametrize(("freedom", "tabulated"), [(1, (7.849, 10.507)), (10, (16.241, 20.532))])
def test_sizes_are_those_of_the_non_central_chi_square(freedom, tabulated):
    """Tabulated noncentralities at 5 % and powers of 0.8 and 0.9, to their last digit."""
    error = Systematic("shift", "", "m", {}, freedom, 1.0, np.zeros(3), np.zeros(3))
    assert [error.size_at(power) ** 2 for power in (0.8, 0.9)] == pytest.approx(tabulated, abs=6e-4)
    assert error.power(error.size) == pytest.approx(0.95, abs=1e-9)
    assert error.power(0.0) == pytest.approx(0.05, abs=1e-9)
    with pytest.raises(ctr.DefinitionError, match=r"power = 1\.5 must be"):
        error.size_at(1.5)


def test_sizes_beyond_first_order_are_not_told():
    """What takes twice a stiffness, or more than a radian, to be noticed is hardly ever noticed."""
    error = Systematic("stiffness", "stiffness of tube 'rod'", "1", {}, 10, 1.0, np.ones(3), np.array([0.0, 3.0, 4.0]))
    assert str(error) == "stiffness of tube 'rod': hardly ever detected; adds 0.05 N per %"
    harmless = attrs.evolve(error, noncentrality=100.0, force_rate=np.zeros(3))
    assert str(harmless) == "stiffness of tube 'rod': detected from 49 %, which adds 0 N"
    known = attrs.evolve(error, noncentrality=100.0)
    assert str(known) == "stiffness of tube 'rod': detected from 49 %, which adds 2.5 N"


def test_reports_tell_the_worst_of_each_kind(estimate):
    reported = estimate.report().partition("until they are detected (with 95 %):\n")[2].splitlines()
    worst = [
        max((each for each in estimate.systematic if each.kind == kind), key=lambda each: each.mimicked)
        for kind in ("shift", "tilt", "curvature", "stiffness")
    ]
    assert [line.strip() for line in reported] == [str(each) for each in worst]


@pytest.mark.parametrize("kind", ["shift", "tilt"])
def test_the_worst_directions_are_worse_than_the_axes(estimate, kind):
    *axes, hardest, most = (each for each in estimate.systematic if each.kind == kind)
    assert hardest.description.endswith("hardest to detect")
    assert most.description.endswith("most like a force")
    assert hardest.size >= max(each.size for each in (*axes, most))
    assert most.mimicked >= max(each.mimicked for each in (*axes, hardest))
    for worst in (hardest, most):
        (direction,) = worst.changes.values()
        assert np.linalg.norm(direction) == pytest.approx(1.0, abs=1e-12)


def test_errors_that_are_counted_are_mistaken_for_less(given, estimate):
    """Joints that may be half a radian off explain a base that rolls by a degree, so that no force has to."""
    counted = Way(options={"rotation_sigma": 0.5}).solve(given, points(given))
    plain, known = (each.systematic[5] for each in (estimate, counted))
    assert plain.description == "tilt of the base about z"
    assert np.linalg.norm(known.force_rate) < 0.2 * np.linalg.norm(plain.force_rate)
    assert known.size > 2.0 * plain.size


@pytest.fixture(scope="module")
def rod():
    return ctr.Robot([ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)])


def test_nothing_left_over_shows_nothing(rod):
    held = ctr.Actuation([0.0], [0.0])
    tip = ctr.ForwardProblem(rod).solve(held).tip_position
    found = ctr.ForceEstimationProblem(rod, [ctr.TipForce()]).solve(held, ctr.PositionMeasurement(0.1, tip, 1e-4))
    shift = found.systematic[1]
    assert shift.size == np.inf
    assert shift.power(1.0) == 0.0
    assert np.isfinite(shift.force_rate).all()
    assert shift.mimicked == np.inf
    assert str(shift).startswith("shift of the base along y: never detected, as the loads absorb it; adds ")
    stiffness = next(each for each in found.systematic if each.kind == "stiffness")
    assert stiffness.mimicked == 0.0
    assert str(stiffness) == "stiffness of tube 'rod': has no effect on the measurements"


def test_both_kinds_of_model_tell_the_same(rod):
    """To what the steps of the virtual machine leave."""
    held, places = ctr.Actuation([0.3], [0.0]), [0.03, 0.06, 0.09]
    seen = ctr.ForwardProblem(rod).solve(held, [ctr.PointWrench([0.2, 0.1, 0.0])]).position(places)
    measured = ctr.PositionMeasurement(places, seen, 1e-4)
    reported = [
        ctr.ForceEstimationProblem(rod, [ctr.TipForce()], compiled=compiled).solve(held, measured).systematic
        for compiled in (True, False)
    ]
    for compiled, virtual in zip(*reported, strict=True):
        np.testing.assert_allclose(virtual.rates, compiled.rates, atol=1e-5 * np.abs(compiled.rates).max())
        assert virtual.noncentrality == pytest.approx(compiled.noncentrality, rel=1e-5)


def test_a_direction_that_is_left_alone_is_not_counted_as_estimated():
    """Along a rod that is all but straight: beyond thirty characteristic forces the search does not go that way."""
    tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 0.01), youngs_modulus=60e9, poisson_ratio=0.3)
    held, places = ctr.Actuation([0.0], [0.0]), np.linspace(0.01, 0.1, 10)
    robot = ctr.Robot([tube])
    seen = ctr.ForwardProblem(robot).solve(held).position(places)
    noise = 1e-4 * np.random.default_rng(0).normal(size=seen.shape)
    measured = ctr.PositionMeasurement(places, seen + noise, 1e-4)
    found = ctr.ForceEstimationProblem(robot, ctr.TipForce()).solve(held, measured)
    assert found.undetermined == ["axial force: undetermined, no information"]
    assert abs(found.force[2]) < 1e-6 * found.characteristic_force
    assert found.degrees_of_freedom == 30 - 2
