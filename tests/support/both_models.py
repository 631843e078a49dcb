"""What the tests of compiled predictions share: loads of many kinds, and what both models tell of them."""

import numpy as np

import ctr_opt as ctr
from ctr_opt.force.model import loaded_model
from ctr_opt.robot.names import parameters

NUMBERS = [
    *("loads[0].force", "loads[1].force", "loads[1].moment"),
    *("loads[2].force", "loads[2].moment", "loads[3].moment"),
]


def pushed(tubes):
    """At the tip, in the middle of the last tube, along the first, and on the last one's base and end."""
    last = tubes - 1
    return [
        ctr.PointWrench([0.2, -0.1, 0.15], [1e-3, -2e-3, 1e-3]),
        ctr.PointWrench([-0.1, 0.2, 0.1], [2e-3, 1e-3, -3e-3], 0.03, last),
        ctr.DistributedLoad([1.0, 2.0, -1.0], [0.02, -0.01, 0.03], 0.015, 0.035),
        ctr.PointWrench([0.1, 0.1, 0.1], [1e-3, 3e-3, 2e-3], 0.0, last),
        ctr.PointWrench([0.05, -0.05, 0.1], [-1e-3, 1e-3, 2e-3], tube=last, frame="body"),
    ]


def predicted_by_both(robot, actuation, loads, wanted, measured, z):
    """Predictions ``(2, observables, numbers)`` and their slopes, by compiled code and in the virtual machine.

    ``wanted``: names of numbers of loads, which may change, and of others.
    """
    observables = [one for each in measured for one in each.observables]
    known = parameters(robot, actuation, loads)
    values = np.concatenate([np.zeros(0), *(known[name].value.ravel() for name in wanted[0])])
    found = []
    for compiled in (True, False):
        model = loaded_model(robot, actuation, loads, *wanted, observables, compiled, lambda: 12)
        assert model.compiled == compiled
        reported = model.at(z, values, np.zeros(0)).predictions
        found.append([np.array([getattr(each, part)[0] for each in reported]) for part in ("value", "slopes")])
    return [np.array(both) for both in zip(*found, strict=True)]


def same(values, slopes):
    """To 1e-9 of the largest: steps of two lengths, to the eighth order; slopes of each number to 1e-8 of its own."""
    np.testing.assert_allclose(*values, rtol=0.0, atol=1e-9 * np.abs(values).max())
    size = np.abs(slopes).max(axis=(0, 1, 2))
    assert (size > 0.0).any()
    np.testing.assert_allclose(*(slopes / np.maximum(size, 1e-6 * size.max())), rtol=0.0, atol=1e-8)
