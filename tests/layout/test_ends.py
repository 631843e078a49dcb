"""The tube at the tip, found the short way, is that of the snapped ends."""

import attrs
import numpy as np
import pytest

from ctr_opt.layout.ends import SAME_POINT, Ends
from tests.support.physics import random_robot

GAPS = [0.0, 1e-17, 0.4 * SAME_POINT, 0.9 * SAME_POINT, 1.1 * SAME_POINT, 1e-3]  # of the length


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
