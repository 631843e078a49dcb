"""Fifty repetitions of a calibration with new noise: intervals cover, errors reach the bound, covariances are right.

Bands hold all but once in a thousand for right errors; the seed is fixed, so that it stays so. The 500 repetitions of
docs/evidence/calibration_statistics.md are narrower.
"""

import numpy as np
import pytest
from scipy.stats import binom, chi2

from benchmarks.calibration_statistics import LEVEL, central, joint, rejections, repeat, table

REPETITIONS = 50


@pytest.fixture(scope="module")
def found():
    return repeat(REPETITIONS)


@pytest.mark.slow
def test_intervals_cover(found):
    """A binomial count for each number, 41 of 50 and more; all 500 together would be too wide intervals."""
    least, _ = central(binom(REPETITIONS, LEVEL))
    assert found.coverage.shape == (10,)
    assert (found.coverage * REPETITIONS >= least).all()
    assert found.coverage.mean() < 1.0


@pytest.mark.slow
def test_errors_reach_the_bound(found):
    """Sums of fifty squared errors over their variances are chi-square: errors from 0.68 to 1.34 of the bound."""
    least, most = np.sqrt(np.array(central(chi2(REPETITIONS))) / REPETITIONS)
    assert (found.efficiency > least).all()
    assert (found.efficiency < most).all()


@pytest.mark.slow
def test_no_bias(found):
    """Means of fifty: 3.3 of their standard deviations."""
    assert (np.abs(found.bias) < 3.3 / np.sqrt(REPETITIONS)).all()


@pytest.mark.slow
def test_covariances_are_consistent(found):
    """All ten numbers together, by the reported covariances."""
    least, most = central(chi2(10 * REPETITIONS))
    assert least < found.nees.sum() < most


@pytest.mark.slow
def test_residuals_are_rejected_as_often_as_said(found):
    least, most = central(binom(REPETITIONS, 1.0 - LEVEL))
    assert least <= np.count_nonzero(found.p_values < 1.0 - LEVEL) <= most
    assert 0.3 < found.p_values.mean() < 0.7  # uniform: 0.5 +- 0.04


def test_tables():
    found = repeat(2)
    lines = list(table(found))
    assert len(lines) == 2 + 10
    assert all(line.count("|") == 6 for line in lines)
    assert joint(found).startswith("joint NEES: ")
    assert [line.split(":")[0] for line in rejections(found)] == [
        "residuals rejected at 0.05",
        "residuals rejected at 0.001",
    ]
