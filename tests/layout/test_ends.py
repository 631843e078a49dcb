"""Numbers, arrays, symbols and compiled code follow one rule which tubes' ends are one point."""

from itertools import permutations

import attrs
import casadi as ca
import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

import ctr_opt as ctr
from ctr_opt.forward.compiled import CompiledRecord
from ctr_opt.layout.ends import SAME_POINT, Ends, chained, chained_symbols, first_at_tip, innermost, outermost_at_tip
from tests.support.physics import random_robot

GAPS = [0.0, 1e-17, 0.4 * SAME_POINT, 0.9 * SAME_POINT, 1.1 * SAME_POINT, 1e-3]  # of the length
DIAMETERS = [(1.0e-3, 0.6e-3), (1.6e-3, 1.2e-3), (2.2e-3, 1.8e-3)]


@pytest.mark.parametrize("first", GAPS)
@pytest.mark.parametrize("second", GAPS)
def test_the_tube_at_the_tip(first, second):
    """Chains of close ends are one point, whichever tube is the longest."""
    robot = random_robot(np.random.default_rng(1), 3)
    lengths = np.array([tube.length for tube in robot.tubes])
    rng = np.random.default_rng(2)
    for order in ([0, 1, 2], [2, 1, 0], [1, 0, 2], [1, 2, 0]):
        ends = np.empty(3)
        ends[order] = 0.05 * (1.0 - np.array([0.0, first, first + second])) * rng.uniform(0.9, 1.0)
        translations = ends - lengths
        assert Ends.tube_at_tip(robot, translations) == Ends.of_robot(robot, translations).innermost()
    assert Ends.tube_at_tip(attrs.evolve(robot, tubes=robot.tubes[:1]), np.array([-0.01])) == 0


def chains():
    """Ends of 3 to 5 tubes in steps of 0.6 of the tolerance, shuffled, one chain or two, at the tip or one before."""
    rng = np.random.default_rng(3)
    for tubes in (3, 4, 5):
        for _ in range(40):
            steps = rng.choice([0.6, 1.4, 1e9], size=tubes, p=[0.7, 0.2, 0.1]) * SAME_POINT
            yield 0.2 * (1.0 - np.cumsum(steps))[rng.permutation(tubes)]


def expected(ends):
    """The largest of the ends that are connected by steps within the tolerance."""
    close = np.abs(ends[:, None] - ends) <= SAME_POINT * ends.max()
    _, group = connected_components(close)
    return np.array([ends[group == one].max() for one in group])


def test_chains_of_ends_are_one_point():
    for ends in chains():
        last = expected(ends)
        at_tip = np.flatnonzero(last == last.max())
        given = Ends.at(ends.tolist())
        np.testing.assert_array_equal(given.array, last)
        np.testing.assert_array_equal(chained(np.stack((ends, ends[::-1]))), np.stack((last, last[::-1])))
        symbols = ca.SX.sym("ends", len(ends))
        tops = chained_symbols(ca.vertsplit(symbols), given.slack)
        weights = ca.vertcat(*first_at_tip(tops))
        found, first = ca.Function("chained", [symbols], [ca.vertcat(*tops), weights])(ends)
        np.testing.assert_array_equal(found.full()[:, 0], last)
        np.testing.assert_array_equal(np.flatnonzero(first.full()), at_tip[:1])
        assert given.innermost() == innermost(chained(ends)) == at_tip[0]
        assert outermost_at_tip(chained(ends)) == at_tip[-1]
        s = np.concatenate((ends, last - 2.0 * given.slack))  # at every end, and before it
        there = [min(np.flatnonzero(last >= x - given.slack)) for x in s]
        np.testing.assert_array_equal(given.innermost_along(s), there)


ORDERS = list(permutations([0.0, 0.6, 1.2]))


@pytest.mark.parametrize(
    "steps",
    [pytest.param(each, marks=pytest.mark.slow if k in (0, 2, 3) else ()) for k, each in enumerate(ORDERS)],
    ids=str,
)
def test_solves_agree_on_chains(steps):
    """Numbers, symbols and compiled code take the tip for the innermost tube's, and loads there for being on all tubes.

    Poses are good to 1e-9 for the tolerance, slopes to 1e-6 of the largest; the function's steps are fixed.
    """
    pieces = [[ctr.Straight(0.06), ctr.Arc(0.04, kappa)] for kappa in (9.0, 6.0, 4.0)]
    tubes = [ctr.Tube(f"tube {i}", *DIAMETERS[i], pieces[i], youngs_modulus=60e9, poisson_ratio=0.3) for i in range(3)]
    rotations, translations = [0.3, 1.2, -0.8], 0.08 * (1.0 - np.array(steps) * SAME_POINT) - 0.1
    loads = [ctr.PointWrench([0.1, 0.05, -0.1], [0.0, 0.0, 1e-3], arc_length=0.08, tube=i) for i in range(3)]
    compiled, slow = (ctr.ForwardProblem(ctr.Robot(tubes), tolerance=1e-10, compiled=which) for which in (True, False))
    fast = compiled.solve(ctr.Actuation(rotations, translations), loads)
    shape = slow.solve(ctr.Actuation(rotations, translations), loads, initial=fast)
    assert isinstance(fast.record, CompiledRecord)
    reported = slow.function(shape)(rotations=rotations, translations=translations, initial=shape.unknowns)
    expected = fast.pose(fast.length, 0)
    assert np.abs(expected - fast.pose(fast.length, 1)).max() > 0.1  # the tubes are turned otherwise
    for pose in (fast.tip_pose, shape.tip_pose, shape.pose(shape.length)):
        np.testing.assert_allclose(pose, expected, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(reported["tip_rotation"].full(), expected[:3, :3], rtol=0.0, atol=1e-7)
    slopes = shape.jacobian(side=1)
    np.testing.assert_allclose(fast.jacobian(side=1), slopes, rtol=0.0, atol=1e-6 * np.abs(slopes).max())
    np.testing.assert_allclose(fast.compliance(), shape.compliance(), rtol=1e-6, atol=1e-6)
