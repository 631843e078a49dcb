"""Contacts at unknown places: found from exact points, sets that hold their places, and how many there are."""

import numpy as np
import pytest
from scipy.stats import binom, chi2

import ctr_opt as ctr
from benchmarks.contact_location import robots, trials

SIGMA = 1e-4  # m
TRIALS = 4  # of every robot


@pytest.fixture(scope="module")
def given():
    """Robot and actuation, and its shape without loads, by name."""
    found = {}
    for name, (robot, actuation) in robots().items():
        found[name] = robot, actuation, ctr.ForwardProblem(robot, compiled=True).solve(actuation)
    return found


def pressed(given, name, contacts):
    """The shape under contacts: fractions of the length, and sizes in bending stiffness over squared arc length."""
    robot, actuation, free = given[name]
    loads = []
    for k, (fraction, size) in enumerate(contacts):
        s = fraction * free.length
        across = free.pose(s)[:3, :2] @ ([0.8, 0.6] if k % 2 == 0 else [-0.6, 0.8])
        loads.append(ctr.PointWrench(size * robot.tubes[0].bending_stiffness / s**2 * across, arc_length=s))
    return loads, ctr.ForwardProblem(robot, tolerance=1e-10, compiled=True).solve(actuation, loads, initial=free)


def seen(shape, noise, sigma=SIGMA, count=24, seed=0):
    """Points along a shape, with noise in standard deviations."""
    s = np.linspace(0.08, 1.0, count) * shape.length
    points = shape.position(s) + noise * sigma * np.random.default_rng(seed).normal(size=(count, 3))
    return ctr.PositionMeasurement(s, points, sigma)


BREAK = 0.1305 / 0.163 + 1e-3  # of B's length: just behind the end of its middle tube


@pytest.mark.parametrize(
    ("name", "fraction", "size"),
    [("A", 0.6, 1.0), ("A", 0.99, 0.5), ("B", BREAK, 1.0), ("B", 0.7, 4.0), ("RJW-S1", 0.6, 3.0)],
    ids=["middle", "next to the tip", "next to a tube's end", "large", "larger"],
)
def test_exact_points_give_place_and_force(given, name, fraction, size):
    """To 1e-2 standard errors: the solvers' 1e-7 of the length are 2e-4 of a point's standard deviation."""
    robot, actuation, _ = given[name]
    (load,), shape = pressed(given, name, [(fraction, size)])
    problem = ctr.ForceEstimationProblem(robot, ctr.PointForce(), compiled=True, tolerance=1e-9)
    estimate = problem.solve(actuation, seen(shape, noise=0.0))
    errors = np.append(estimate.force - load.force, estimate.arc_length - load.arc_length)
    assert (np.abs(errors) < 1e-2 * estimate.deviations).all()
    assert estimate.state.cost < 1e-6


def test_the_edges_of_a_set_are_where_the_loss_says(given):
    """With the place held there the least loss is 1.92 above that of the estimate, to what 1e-4 of the length move."""
    robot, actuation, _ = given["A"]
    _, shape = pressed(given, "A", [(0.7, 1.0)])
    measured = seen(shape, noise=1.0)
    estimate = ctr.ForceEstimationProblem(robot, ctr.PointForce(), compiled=True).solve(actuation, measured)
    ((start, end),) = estimate.arc_length_set
    assert start < estimate.arc_length < end
    for edge in (start, end):
        held = ctr.ForceEstimationProblem(robot, ctr.PointForce(edge), compiled=True).solve(actuation, measured)
        excess = 0.5 * (held.chi_squared - estimate.chi_squared)
        assert excess == pytest.approx(0.5 * chi2.ppf(0.95, 1), rel=0.02)


def test_sets_may_be_disconnected(given):
    """A push near the base or another farther out: the estimate in one interval, its alternative in the other."""
    robot, actuation, _ = given["B"]
    _, shape = pressed(given, "B", [(0.3, 0.6)])
    problem = ctr.ForceEstimationProblem(robot, ctr.PointForce(), compiled=True)
    estimate = problem.solve(actuation, seen(shape, noise=1.0, sigma=2e-4, count=12, seed=1))
    near, far = estimate.arc_length_set
    assert near[1] < far[0]
    assert far[0] < estimate.arc_length < far[1]
    assert near[0] < estimate.alternatives[0].arc_length < near[1]


def test_sets_cover():
    """Of all robots together, within the band of a binomial count that 0.1 % of right sets would leave."""
    found = [each for robot, actuation in robots().values() for each in trials(robot, actuation, TRIALS)]
    least = binom.ppf(1e-3, len(found), 0.95)
    assert sum(each.covered for each in found) >= least
    assert np.mean([sum(end - start for start, end in each.sets) for each in found]) < 0.05


@pytest.mark.parametrize("contacts", [[(0.6, 1.5)], [(0.45, 1.5), (0.9, 0.8)]], ids=["one", "two"])
def test_the_number_of_contacts_is_found(given, contacts):
    """And all places within four standard errors; the table holds all numbers, their criteria as defined."""
    robot, actuation, free = given["A"]
    loads, shape = pressed(given, "A", contacts)
    prior = 10.0 * robot.tubes[0].bending_stiffness / free.length**2
    problem = ctr.ForceEstimationProblem(robot, ctr.Contacts(most=2, prior=(0.0, prior)), compiled=True)
    estimate = problem.solve(actuation, seen(shape, noise=1.0))
    found, errors = np.atleast_1d(estimate.arc_length), np.atleast_1d(estimate.arc_length_error)
    assert len(found) == len(contacts)
    assert (np.abs(found - [load.arc_length for load in loads]) < 4.0 * errors).all()
    assert [row.contacts for row in estimate.evidence] == [0, 1, 2]
    for row in estimate.evidence:
        assert row.criterion == pytest.approx(2.0 * row.loss + 4 * row.contacts * np.log(72))


def test_beside_another_load_there_may_be_none(given):
    """A force at the tip explains all, and every contact costs 4 log 72 for no more than chance explains."""
    robot, actuation, free = given["A"]
    load = ctr.PointWrench(0.5 * robot.tubes[0].bending_stiffness / free.length**2 * free.pose(free.length)[:3, 0])
    shape = ctr.ForwardProblem(robot, tolerance=1e-9, compiled=True).solve(actuation, [load])
    problem = ctr.ForceEstimationProblem(robot, [ctr.TipForce(), ctr.Contacts(most=1)], compiled=True)
    estimate = problem.solve(actuation, seen(shape, noise=1.0))
    assert [row.contacts for row in estimate.evidence] == [0, 1]
    assert estimate.labels == ("force.x", "force.y", "force.z")
    with pytest.raises(ctr.DefinitionError, match="density"):
        estimate.density(0.0)


FRICTION = 0.5


@pytest.fixture(scope="module")
def touched(given):
    """Robot A against a surface: its normal, a direction across, a unit of force; and what is estimated of a push."""
    robot, actuation, free = given["A"]
    s = 0.7 * free.length
    normal, across = free.pose(s)[:3, 0], free.pose(s)[:3, 1]
    unit = robot.tubes[0].bending_stiffness / s**2

    def estimate(push, slide, **surface):
        load = ctr.PointWrench(unit * (push * normal + slide * across), arc_length=s)
        shape = ctr.ForwardProblem(robot, tolerance=1e-9, compiled=True).solve(actuation, [load], initial=free)
        problem = ctr.ForceEstimationProblem(robot, ctr.PointForce(s, **surface), compiled=True)
        return problem.solve(actuation, seen(shape, noise=1.0))

    return normal, across, unit, estimate


def test_a_surface_without_friction_pushes_along_its_normal(touched):
    """As strongly as it did, within four standard errors, and along nothing else: errors are along it, too."""
    normal, _, unit, estimate = touched
    found = estimate(1.0, 0.0, normal=3.0 * normal)
    assert found.labels == ("normal_force",)
    assert abs(found.estimates[0] - unit) < 4.0 * found.deviations[0]
    np.testing.assert_allclose(found.force, found.estimates[0] * normal, rtol=1e-12)
    expected = found.covariance[0, 0] * np.outer(normal, normal)
    np.testing.assert_allclose(found.force_covariance, expected, rtol=1e-9, atol=1e-20)


@pytest.mark.parametrize("friction", [None, FRICTION])
def test_a_surface_does_not_pull(touched, friction):
    """Nothing is left of a pull, exactly; the rest is reported as inconsistent. So strong a pull leaves no doubt."""
    normal, _, unit, estimate = touched
    found = estimate(-1.0, 0.0, normal=normal, friction=friction)
    assert not found.force.any()
    assert np.sqrt(np.linalg.eigvalsh(found.force_covariance)[-1]) < 1e-3 * unit
    assert found.consistent is False


def test_inside_the_cone_friction_changes_nothing(touched):
    normal, _, _, estimate = touched
    found, free = estimate(1.0, 0.1, normal=normal, friction=2.0), estimate(1.0, 0.1)
    np.testing.assert_array_equal(found.force, free.force)
    np.testing.assert_allclose(found.covariance, free.covariance, rtol=1e-6, atol=1e-12 * free.covariance.max())


def test_outside_the_answer_is_the_best_on_the_surface(touched):
    """On it to rounding; worse beside it in any direction of the cone, each solved as a normal alone."""
    normal, across, _, estimate = touched
    found = estimate(1.0, 0.9, normal=normal, friction=FRICTION)
    push = normal @ found.force
    assert np.linalg.norm(found.force - push * normal) == pytest.approx(FRICTION * push, rel=1e-9)
    other = np.cross(normal, across)
    angle = np.arctan2(other @ found.force, across @ found.force)
    for step in (-0.5, -0.05, 0.05, 0.5, np.pi):
        slide = np.cos(angle + step) * across + np.sin(angle + step) * other
        beside = estimate(1.0, 0.9, normal=normal + FRICTION * slide)
        assert beside.state.cost > found.state.cost
    outward = np.cross(
        found.force, np.cross(found.force, normal)
    )  # across the surface, far outside of which it would be
    free = estimate(1.0, 0.9).force_covariance
    assert outward @ found.force_covariance @ outward < 0.2 * outward @ free @ outward
    assert found.degrees_of_freedom == len(found.state.misfit) - 2


@pytest.mark.parametrize(
    ("field", "message"),
    [
        ({"normal": [0.0, 0.0, 0.0]}, "must be a direction"),
        ({"arc_length": 0.1, "friction": 0.5}, "requires normal"),
        ({"normal": [1.0, 0.0, 0.0], "friction": 0.5}, "and arc_length"),
        ({"arc_length": 0.1, "normal": [1.0, 0.0, 0.0], "friction": -0.5}, "friction = -0.5"),
    ],
)
def test_impossible_surfaces_are_refused(field, message):
    with pytest.raises(ctr.DefinitionError, match=message):
        ctr.PointForce(**field)


@pytest.mark.parametrize("field", [{"most": 0}, {"most": 1.5}, {"tube": -1}, {"prior": (0.0, -1.0)}])
def test_impossible_contacts_are_refused(field):
    with pytest.raises(ctr.DefinitionError, match=r"most|tube|standard deviation"):
        ctr.Contacts(**field)
