"""Sixty trials of each force estimate, and some of each error of the model; docs/evidence/force_statistics.md has more.

Bands hold all but once in a thousand for right errors; the seed is fixed, so that it stays so.
"""

import numpy as np
import pytest
from scipy.stats import binom, chi2

from benchmarks.calibration_statistics import central
from benchmarks.force_statistics import KINDS, POWERS, REGIMES, ROBOTS, Study, of_errors, of_wrong
from ctr_opt.force.systematic import CONSISTENT

TRIALS, WRONG = 60, 15


@pytest.fixture(scope="module")
def found():
    studies = {(sought, robot): Study(sought, robot) for sought in REGIMES for robot in ROBOTS}
    return {key: (study, study.trials(TRIALS)) for key, study in studies.items()}


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("sought", REGIMES)
def test_errors_are_those_reported(found, sought, robot):
    """Root-mean-square errors, of sums of sixty squares, are within 0.71 to 1.31 of the bound."""
    study, trials = found[sought, robot]
    assert study.at_truth.axes[2].standard_deviation < 0.1 * study.unit[0]  # the linearized regime
    least, most = np.sqrt(np.array(central(chi2(TRIALS))) / TRIALS)
    assert ((trials.efficiency > least) & (trials.efficiency < most)).all()
    low, high = trials.band
    assert low < trials.nees.mean() < high
    assert of_errors(sought, robot, study, trials).count("|") == 7


def test_false_alarms_are_as_many_as_said(found):
    """Of 540 as many as 12 to 45, and probabilities uniform: a mean of 0.5."""
    p_values = np.concatenate([trials.p_values for _, trials in found.values()])
    low, high = central(binom(len(p_values), CONSISTENT))
    assert low <= np.count_nonzero(p_values < CONSISTENT) <= high
    assert p_values.mean() == pytest.approx(0.5, abs=3.3 / np.sqrt(12 * len(p_values)))


def test_wrong_models_are_noticed_as_often_as_said(found):
    """Misfits of exact points within two points of first order; counts of all kinds, sizes and robots within chance."""
    wrong = [list(found["tip force", robot][0].wrong(WRONG, kind)) for robot in ROBOTS for kind in KINDS]
    for size, power in enumerate(POWERS):
        assert [each[size].exact for each in wrong] == pytest.approx([power] * len(wrong), abs=0.02)
        low, high = central(binom(WRONG * len(wrong), power))
        assert low <= WRONG * sum(each[size].measured for each in wrong) <= high
    assert of_wrong("tip force", "A", wrong[0]).count("|") == 8
