"""Continuation around folds, on curves that are known."""

import numpy as np
import pytest

from ctr_opt.forward.continuation import imperfect
from ctr_opt.solvers.arclength import trace_around
from ctr_opt.solvers.homotopy import Homotopy, trace

TOLERANCE = 1e-10


class Curve:
    """``f(z, x) = 0`` for one unknown."""

    def __init__(self, f, df, x):
        self.f, self.df, self.x = f, df, x

    def linearize(self, z):
        return np.array([self.f(z[0], self.x)]), np.array([[self.df(z[0], self.x)]])


def snap(x):
    """``x = z - 2 z^2 + 1.2 z^3``: up to 0.157, down to 0.131 and up again."""
    return Curve(lambda z, x: z - 2 * z**2 + 1.2 * z**3 - x, lambda z, x: 1 - 4 * z + 3.6 * z**2, x)


def pitchfork(x):
    """``z (z^2 - (2 x - 1)) = 0``: straight, and two branches from x = 1/2 on."""
    return Curve(lambda z, x: z * (z**2 - (2 * x - 1)), lambda z, x: 3 * z**2 - (2 * x - 1), x)


def test_two_folds_are_passed():
    assert not trace(snap, np.zeros(1), TOLERANCE).complete
    found = trace_around(snap, np.zeros(1), TOLERANCE, Homotopy())
    assert found.complete
    assert found.folds == 2
    z = found.solution.z[0]
    roots = np.roots([1.2, -2.0, 1.0, -1.0])
    assert z == pytest.approx(float(roots[np.abs(roots.imag) < 1e-9].real[0]), abs=1e-9)


def test_a_bifurcation_is_not_run_over():
    found = trace_around(pitchfork, np.zeros(1), TOLERANCE, Homotopy())
    assert not found.complete
    assert found.singular
    assert found.reached == pytest.approx(0.5, abs=1e-3)


def test_an_imperfection_leads_onto_a_branch_of_the_perfect_system():
    found = trace_around(imperfect(pitchfork, 1), np.zeros(1), TOLERANCE, Homotopy())
    assert found.complete
    assert abs(found.solution.z[0]) == pytest.approx(1.0, abs=1e-9)


def test_a_curve_that_comes_back_to_its_start_fails():
    """``z = 0`` and ``z = 1`` at x = 0 are joined by an arch that never reaches 1."""
    found = trace_around(
        lambda x: Curve(lambda z, x: z - z**2 - x, lambda z, x: 1 - 2 * z, x), np.zeros(1), TOLERANCE, Homotopy()
    )
    assert not found.complete
