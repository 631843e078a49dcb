"""What may not change when a problem is said differently: turned, mirrored, in other units, in more tubes."""

import attrs
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import ctr_opt as ctr
from ctr_opt.loads.density import LoadTable
from tests.support.physics import mapped, random_pose, random_problem, random_robot, robot, tube_ends, turned

# Each side is solved to 1e-10 of its length, so they may differ by twice that, and by what rounding leaves of the
# moments after amplification along the robot: nine digits are asked for, of curvatures (about 10/m) eight.
TOLERANCE = 1e-10
POSITION = 1e-9
ANGLE = 1e-8
seeds = st.integers(0, 10**6)
angles = st.floats(-np.pi, np.pi)
few = settings(
    derandomize=True, deadline=None, max_examples=8, database=None, suppress_health_check=[HealthCheck.too_slow]
)


def problem(seed, most_tubes=3, pose=True):
    """A robot bent and loaded moderately, so that its equilibrium is unique or at least the same branch is followed."""
    rng = np.random.default_rng(seed)
    return random_problem(rng, int(rng.integers(1, most_tubes + 1)), load=0.7, pose=pose)


def solve(made, actuation, loads):
    return ctr.ForwardProblem(made, tolerance=TOLERANCE).solve(actuation, loads)


def rotation_z(a):
    return np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])


def stations(result):
    return np.linspace(0.0, result.length, 7)


def same_inner_values(a, b, tubes=None, sign=1.0, scale=1.0):
    """Torsions and angles of ``a``'s tube i and ``b``'s tube ``tubes[i]``, the latter times sign (and scale)."""
    for i, end in enumerate(tube_ends(a.robot, a.actuation)):
        j = i if tubes is None else tubes[i]
        s = np.linspace(0.0, end, 5)
        np.testing.assert_allclose(a.torsion(i, s), sign * scale * b.torsion(j, scale * s), atol=10 * ANGLE)


@few
@given(seed=seeds, world=seeds)
def test_turning_the_world(seed, world):
    made, actuation, loads = problem(seed)
    move = random_pose(np.random.default_rng(world))
    A = move[:3, :3]
    first = solve(made, actuation, loads)
    second = solve(attrs.evolve(made, base_pose=move @ made.base_pose), actuation, turned(loads, A))
    s = stations(first)
    np.testing.assert_allclose(second.pose(s), move @ first.pose(s), atol=POSITION)
    np.testing.assert_allclose(second.internal_force(s), first.internal_force(s) @ A.T, atol=1e-8)
    np.testing.assert_allclose(second.internal_moment(s), first.internal_moment(s) @ A.T, atol=1e-9)
    np.testing.assert_allclose(second.curvature(s), first.curvature(s), atol=10 * ANGLE)
    same_inner_values(first, second)
    assert second.energy == pytest.approx(first.energy, rel=1e-9, abs=1e-14)


@few
@given(seed=seeds, phi=angles)
def test_turning_all_tubes_and_the_loads(seed, phi):
    made, actuation, loads = problem(seed)
    base = made.base_pose
    A = base[:3, :3] @ rotation_z(phi) @ base[:3, :3].T
    first = solve(made, actuation, loads)
    second = solve(made, ctr.Actuation(actuation.rotations + phi, actuation.translations), turned(loads, A))
    s, origin = stations(first), base[:3, 3]
    np.testing.assert_allclose(second.position(s), origin + (first.position(s) - origin) @ A.T, atol=POSITION)
    np.testing.assert_allclose(second.pose(s)[:, :3, :3], A @ first.pose(s)[:, :3, :3], atol=ANGLE)
    same_inner_values(first, second)


@few
@given(seed=seeds)
def test_equal_tubes_may_change_their_names(seed):
    """Two equal tubes, one in the other, and another around them: who is called the inner one does not matter."""
    rng = np.random.default_rng(seed)
    made = random_robot(rng, 2)
    twin = attrs.evolve(made.tubes[0], name="twin")
    trio = robot(made.tubes[0], twin, made.tubes[1])
    lengths = np.array([t.length for t in trio.tubes])
    beta, alpha = -rng.uniform(0.0, 0.7, 3) * lengths, rng.uniform(-2.0, 2.0, 3)
    ends = beta + lengths
    unit = trio.tubes[2].bending_stiffness / ends.max() ** 2
    loads = [
        ctr.PointWrench(rng.normal(size=3) * unit, rng.normal(size=3) * 0.2 * unit * ends.max(), tube=0),
        ctr.DistributedLoad(rng.normal(size=3) * unit / ends.max(), rng.normal(size=3) * 0.2 * unit, tube=1),
    ]
    swap = [1, 0, 2]
    first = solve(trio, ctr.Actuation(alpha, beta), loads)
    second = solve(trio, ctr.Actuation(alpha[swap], beta[swap]), mapped(loads, np.eye(3), np.eye(3), swap))
    s = stations(first)
    np.testing.assert_allclose(second.position(s), first.position(s), atol=POSITION)
    np.testing.assert_allclose(second.internal_moment(s), first.internal_moment(s), atol=1e-9)
    same_inner_values(first, second, swap)
    for i in range(3):
        np.testing.assert_allclose(first.pose(ends[i], i), second.pose(ends[i], swap[i]), atol=ANGLE)


# -- mirror ------------------------------------------------------------------------------------------------------------


MIRROR = np.diag([-1.0, 1.0, 1.0])
AXIAL = -MIRROR  # moments and curvatures are axial vectors: det(M) M


def mirrored_piece(piece):
    if isinstance(piece, ctr.Straight):
        return piece
    if isinstance(piece, ctr.PolynomialCurvature):
        return attrs.evolve(piece, coefficients=piece.coefficients @ AXIAL)
    return attrs.evolve(piece, curvature=piece.curvature @ AXIAL)


@few
@given(seed=seeds)
def test_mirror_image(seed):
    """x -> -x: forces and positions change their x, moments and curvatures their y and z, angles their sign."""
    made, actuation, loads = problem(seed)
    base = made.base_pose.copy()
    base[:3, :3], base[:3, 3] = MIRROR @ base[:3, :3] @ MIRROR, MIRROR @ base[:3, 3]
    tubes = [attrs.evolve(t, precurvature=[mirrored_piece(p) for p in t.precurvature]) for t in made.tubes]
    first = solve(made, actuation, loads)
    second = solve(
        robot(*tubes, base_pose=base),
        ctr.Actuation(-actuation.rotations, actuation.translations),
        mapped(loads, MIRROR, AXIAL),
    )
    s = stations(first)
    np.testing.assert_allclose(second.position(s), first.position(s) @ MIRROR, atol=POSITION)
    np.testing.assert_allclose(second.pose(s)[:, :3, :3], MIRROR @ first.pose(s)[:, :3, :3] @ MIRROR, atol=ANGLE)
    np.testing.assert_allclose(second.internal_moment(s), first.internal_moment(s) @ AXIAL, atol=1e-9)
    np.testing.assert_allclose(second.curvature(s), first.curvature(s) @ AXIAL, atol=10 * ANGLE)
    same_inner_values(first, second, sign=-1.0)


# -- units -------------------------------------------------------------------------------------------------------------


def scaled_piece(piece, size):
    if isinstance(piece, ctr.SampledCurvature):
        return ctr.SampledCurvature(piece.arc_length * size, piece.curvature / size)
    if isinstance(piece, ctr.PolynomialCurvature):
        return ctr.PolynomialCurvature(piece.length * size, piece.coefficients / size)
    if isinstance(piece, ctr.Arc):
        return ctr.Arc(piece.length * size, piece.curvature / size)
    return ctr.Straight(piece.length * size)


def scaled_density(density, size, factor):
    if callable(density):
        return lambda s: factor * np.asarray(density(s / size))
    if isinstance(density, LoadTable):
        return density.arc_length * size, factor * density.values
    return factor * density


def scaled_load(load, size, stiff):
    if isinstance(load, ctr.PointWrench):
        at = None if load.arc_length is None else load.arc_length * size
        return ctr.PointWrench(stiff * size**2 * load.force, stiff * size**3 * load.moment, at, load.tube)
    return ctr.DistributedLoad(
        scaled_density(load.force, size, stiff * size),
        scaled_density(load.moment, size, stiff * size**2),
        load.start * size,
        None if load.end is None else load.end * size,
        load.tube,
    )


@few
@given(seed=seeds, size=st.sampled_from([1e-3, 0.3, 7.0, 1e3]), stiff=st.sampled_from([1e-4, 1.0, 50.0]))
def test_other_units(seed, size, stiff):
    """Lengths times ``size``, moduli times ``stiff``: a geometrically similar robot; forces grow as E l^2."""
    made, actuation, loads = problem(seed, pose=False)
    tubes = [
        attrs.evolve(
            t,
            outer_diameter=size * t.outer_diameter,
            inner_diameter=size * t.inner_diameter,
            youngs_modulus=stiff * t.youngs_modulus,
            precurvature=[scaled_piece(p, size) for p in t.precurvature],
        )
        for t in made.tubes
    ]
    first = solve(made, actuation, loads)
    second = solve(
        robot(*tubes),
        ctr.Actuation(actuation.rotations, size * actuation.translations),
        [scaled_load(load, size, stiff) for load in loads],
    )
    s = stations(first)
    np.testing.assert_allclose(second.position(s * size) / size, first.position(s), atol=POSITION)
    np.testing.assert_allclose(
        second.internal_moment(s * size) / (stiff * size**3), first.internal_moment(s), atol=1e-9
    )
    same_inner_values(first, second, scale=size)
    assert second.energy / (stiff * size**3) == pytest.approx(first.energy, rel=1e-9, abs=1e-14)
    assert second.determinant == pytest.approx(first.determinant, rel=1e-8)


# -- copies ------------------------------------------------------------------------------------------------------------


@few
@given(seed=seeds, copies=st.integers(2, 4))
def test_equal_tubes_in_one_another_are_one_stiffer_tube(seed, copies):
    made, actuation, loads = problem(seed, most_tubes=1)
    one = made.tubes[0]
    stiff = attrs.evolve(one, youngs_modulus=copies * one.youngs_modulus)
    single = solve(robot(stiff, base_pose=made.base_pose), actuation, loads)
    nest = robot(*(attrs.evolve(one, name=f"copy {i}") for i in range(copies)), base_pose=made.base_pose)
    # An axial moment belongs to one tube, so every copy takes its share.
    share = np.eye(3) / copies
    shared = [load for i in range(copies) for load in mapped(loads, share, share, [i])]
    together = solve(
        nest, ctr.Actuation(np.repeat(actuation.rotations, copies), np.repeat(actuation.translations, copies)), shared
    )
    s = stations(single)
    np.testing.assert_allclose(together.pose(s), single.pose(s), atol=ANGLE)
    np.testing.assert_allclose(together.position(s), single.position(s), atol=POSITION)
    np.testing.assert_allclose(together.internal_moment(s), single.internal_moment(s), atol=1e-9)
    for i in range(copies):
        np.testing.assert_allclose(together.torsion(i, s), single.torsion(0, s), atol=10 * ANGLE)
    assert together.energy == pytest.approx(single.energy, rel=1e-9, abs=1e-14)


@few
@given(seed=seeds)
def test_two_loads_at_one_point_are_their_sum(seed):
    made, actuation, loads = problem(seed)
    first = solve(made, actuation, loads)
    halves = [half for load in loads for half in mapped([load, load], 0.5 * np.eye(3), 0.5 * np.eye(3))]
    second = solve(made, actuation, halves)
    s = stations(first)
    np.testing.assert_allclose(second.pose(s), first.pose(s), atol=POSITION)
