"""What checks accept, and what their errors say."""

import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.checks import alike, array, direction, index, number, whole
from ctr_opt.errors import DefinitionError


@pytest.mark.parametrize("value", [3, 3.0, np.int64(3), np.float64(3.0)])
def test_whole_numbers_are_integers_of_any_type(value):
    assert whole(value, "count", 1, 3) == 3
    assert type(whole(value, "count", 1, 3)) is int
    assert index(value, "tube", 4) == 3


@pytest.mark.parametrize("value", [0, 4, 2.5, True, "3", None, np.nan, np.inf, [1, 2]])
def test_whole_numbers_outside_or_between_are_refused(value):
    with pytest.raises(DefinitionError, match=r"^count = .* must be a whole number, at least 1 and at most 3$"):
        whole(value, "count", 1, 3)


@pytest.mark.parametrize("value", [-1, 2, 0.5, True, "0"])
def test_indices_outside_are_refused(value):
    with pytest.raises(DefinitionError, match="must be the index of a tube from 0 to 1, 0 being the innermost"):
        index(value, "tube", 2)


def test_numbers_name_their_range():
    with pytest.raises(DefinitionError, match=r"^x = 2 m must be a finite number in m, above 0 and at most 1$"):
        number(2, "x", above=0.0, most=1.0, unit="m")


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([[1.0, np.nan]], r"^a\[0, 1\] = nan must be a finite number in N$"),
        ([[1.0, 2.0], [3.0, -0.5]], r"^a\[1, 1\] = -0.5 N must be above 0$"),
        ([[0.0, -1.0]], r"^a\[0, 0\] = 0 N must be above 0$"),
        ([1.0, 2.0], r"^a has shape \(2,\), but must have shape \(k, 2\)$"),
    ],
)
def test_arrays_name_the_first_wrong_entry(value, message):
    with pytest.raises(DefinitionError, match=message):
        array(value, "a", (None, 2), above=0.0, unit="N")


def test_directions_are_unit_vectors():
    np.testing.assert_allclose(direction([0.0, -3.0, 4.0], "d"), [0.0, -0.6, 0.8], rtol=1e-15)  # rounding
    with pytest.raises(DefinitionError, match=r"^d = \[0.0, 0.0, 0.0\] is zero, but must be a direction$"):
        direction([0, 0, 0], "d")


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (None, None, True),
        (None, np.zeros(3), False),
        ((0.0, np.ones(3)), [0, [1.0, 1.0, 1.0]], True),
        ((0.0, np.ones(3)), (0.0, np.ones(2)), False),
        ((0.0, None), (0.0, 1.0), False),
        (np.ones(3), np.ones((1, 3)), False),
    ],
)
def test_numbers_in_tuples_and_arrays_are_compared(one, other, same):
    assert alike(one, other) is alike(other, one) is same


def test_masked_values_are_no_measurements():
    points = np.ma.array(np.zeros((15, 3)), mask=np.arange(45).reshape(15, 3) < 6)
    with pytest.raises(ctr.DefinitionError, match=r"position: 2 of 15 points are masked: leave them out"):
        ctr.BackboneMeasurement(points, sigma=1e-3)
    assert ctr.BackboneMeasurement(np.ma.array(np.zeros((2, 3))), sigma=1e-3).position.shape == (2, 3)
