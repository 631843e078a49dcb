"""Small parts of benchmarks/robustness.py: every cold start ends in a verified equilibrium, and memory stays flat."""

import gc
from pathlib import Path

import numpy as np
import pytest

import ctr_opt as ctr
from benchmarks.memory import resident
from ctr_opt.forward import ways
from tests.support import samples
from tests.support.slow import some_slow

SEED = 7
FEW = [0, 45, 46, 47, 96, 97, 98, 99]  # one to four tubes each: loads that do nothing, something, and most


def solve(sample):
    return ctr.ForwardProblem(sample.robot).solve(sample.actuation, sample.loads)


@pytest.mark.parametrize("index", some_slow(FEW, [0, 45, 46, 97]))
def test_cold_starts_under_forces(index):
    sample = samples.conservative(SEED, index)
    shape = solve(sample)
    assert shape.verify() <= 1e-7 * shape.length
    if index >= 96:
        assert 0.1 < samples.displacement(shape, sample) < 1.0  # half the length was wanted


@pytest.mark.parametrize("index", some_slow(FEW, [0, 45, 46, 47]))
def test_cold_starts_under_moments(index):
    sample = samples.with_moments(SEED, index)
    shape = solve(sample)
    assert shape.verify() <= 1e-7 * shape.length
    if index >= 96:
        assert samples.turn(shape, sample) > np.deg2rad(15.0)


def test_a_robot_that_would_snap_is_followed_around_two_folds(monkeypatch):
    """All other ways end at folds (for a fast test only the first is tried); the path tells."""
    monkeypatch.setattr(ways, "COLD", [way for way in ways.COLD if way.name in ("homotopy", "around folds")])
    sample = samples.with_moments(1, 270)
    shape = solve(sample)
    assert shape.path.startswith("homotopy (ended at 0.946)")
    assert shape.path.endswith("homotopy around folds (2 passed)")
    assert shape.determinant > 0.0
    assert not shape.stability_checked
    assert shape.verify() <= 1e-7 * shape.length


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
def test_memory_stays_flat():
    """After every tube count has been seen, 200 solves of 40 new robots leave less than 1 MB."""

    def solves(first, last):
        for index in range(first, last):
            robot, actuation, loads = samples.light(SEED, index)
            problem, shape = ctr.ForwardProblem(robot, tolerance=1e-4), None
            for _ in range(5):
                shape = problem.solve(actuation, loads, initial=shape)
                actuation = ctr.Actuation(actuation.rotations + 0.02, actuation.translations)
        gc.collect()
        return resident()

    before = solves(0, 40)
    assert solves(40, 80) - before < 1.0  # MB
