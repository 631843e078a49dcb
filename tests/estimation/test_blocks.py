"""Blocks of misfits and the step of a linearized experiment, against sums by hand and one big system of equations."""

import attrs
import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.stats import chi2

import ctr_opt as ctr
from ctr_opt.estimation.blocks import Blocks
from ctr_opt.estimation.chi_square import p_value, quantile, tail
from ctr_opt.estimation.linearized import Linearized
from ctr_opt.estimation.losses import LOSSES, Loss
from ctr_opt.estimation.measurements import BackboneMeasurement


def measured():
    """A tip with its frame, a point, and three points somewhere: blocks of 6, 3, and three of 3."""
    pose = ctr.PoseMeasurement(None, np.eye(4), sigma=0.01)
    return [pose, ctr.PositionMeasurement(0.05, np.zeros(3)), BackboneMeasurement(np.zeros((3, 3)), ordered=False)]


def scene(rng):
    """Misfits of two experiments and their slopes by four unknowns, and by the places of the last three points."""
    misfit, rows, along = rng.normal(size=(2, 18)), rng.normal(size=(2, 18, 4)), np.zeros((2, 18, 3))
    for k in range(3):
        along[:, 9 + 3 * k : 12 + 3 * k, k] = rng.normal(size=(2, 3))
    return misfit, rows, along


@pytest.mark.parametrize("name", LOSSES)
def test_losses_are_those_of_each_block(name):
    """With the threshold of its own size; weights are twice the slopes by the squares."""
    blocks, misfit = Blocks.of(measured(), name), scene(np.random.default_rng(1))[0]
    assert blocks.sizes.tolist() == [6, 3, 3, 3, 3]
    assert blocks.starts.tolist() == [0, 6, 9, 12, 15]
    assert blocks.orders == ((0, 3, False),)
    assert blocks.places == 3
    parts = np.split(misfit, blocks.starts[1:], axis=1)
    by_hand = [Loss(name, part.shape[1]).evaluate((part**2).sum(axis=1)) for part in parts]
    for mine, wanted in zip(blocks.losses(misfit), zip(*by_hand, strict=True), strict=True):
        np.testing.assert_allclose(mine, np.transpose(wanted), rtol=1e-14)
    cost, weights = blocks.weights(misfit)
    np.testing.assert_allclose(cost, np.sum([rho for rho, _, _ in by_hand], axis=0), rtol=1e-13)
    gradient = approx_fprime(misfit.ravel(), lambda m: blocks.weights(m.reshape(2, 18))[0].sum(), 1e-7)
    np.testing.assert_allclose((weights * misfit).ravel(), gradient, atol=2e-6)  # forward differences of 1e-7


@pytest.mark.parametrize("name", LOSSES)
def test_expansions_leave_places_out(name):
    """Gradient and Hessian of all, built block by block from rank-one terms, and the places' rows solved for."""
    blocks, (misfit, rows, along) = Blocks.of(measured(), name), scene(np.random.default_rng(2))
    rho, gradients, hessian = blocks.expanded(misfit, rows, along, positive=False)
    both = np.concatenate((rows, along), axis=2)
    for e in range(2):
        matrix, pulls = np.zeros((7, 7)), []
        for start, size in zip(blocks.starts, blocks.sizes, strict=True):
            r, slopes = misfit[e, start : start + size], both[e, start : start + size]
            _, first, second = Loss(name, size).evaluate(r @ r)
            pulls.append(2.0 * first * slopes.T @ r)
            matrix += 2.0 * first * slopes.T @ slopes + 4.0 * second * np.outer(slopes.T @ r, slopes.T @ r)
        gain = np.linalg.solve(matrix[4:, 4:], matrix[4:, :4])
        np.testing.assert_allclose(hessian[e], matrix[:4, :4] - matrix[:4, 4:] @ gain, rtol=1e-10, atol=1e-12)
        wanted = np.array(pulls)[:, :4] - np.array(pulls)[:, 4:] @ gain
        np.testing.assert_allclose(gradients[e], wanted, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(rho, blocks.losses(misfit)[0], rtol=1e-15)


def test_hessians_can_be_kept_from_bending_down():
    """Cauchy's loss far out: along the residual itself the curvature is zero then, below zero otherwise."""
    blocks, (misfit, rows, along) = Blocks.of(measured(), "cauchy"), scene(np.random.default_rng(3))
    least = [
        np.linalg.eigvalsh(blocks.expanded(20.0 * misfit, rows, along, positive=positive)[2])[:, 0]
        for positive in (False, True)
    ]
    assert (least[0] < 0.0).all()
    assert (least[1] > -1e-12).all()


def test_loss_can_be_changed():
    blocks, misfit = Blocks.of(measured(), "huber"), scene(np.random.default_rng(4))[0]
    assert not blocks.plain
    squares = attrs.evolve(blocks, loss="squared")
    assert squares.plain
    np.testing.assert_allclose(squares.weights(misfit)[0], 0.5 * (misfit**2).sum(axis=1), rtol=1e-14)


def test_moments_follow_the_unknowns():
    """Against the bordered system ``[[r_z, r_x], [0, 1]] (dz, dx) = (-r, dx)`` of two experiments, solved at once."""
    rng = np.random.default_rng(5)
    residual, slopes = rng.normal(size=(2, 3)), rng.normal(size=(2, 3, 8)) + 3.0 * np.eye(3, 8)
    misfit, rates, mixing = rng.normal(size=(2, 4)), rng.normal(size=(2, 4, 9)), rng.normal(size=(2, 6, 2))
    here = Linearized.of(residual, slopes, (misfit, rates), np.zeros((2, 4, 0)), mixing, np.zeros((2, 0)), 0.1)
    for e in range(2):
        for dx in (np.zeros(2), rng.normal(size=2)):
            system = np.block([[slopes[e, :, :3], slopes[e, :, 3:] @ mixing[e, :5]], [np.zeros((2, 3)), np.eye(2)]])
            dz = np.linalg.solve(system, np.concatenate((-residual[e], dx)))[:3]
            moved = misfit[e] + rates[e] @ np.concatenate((dz, mixing[e] @ dx))
            one = here.one(e)
            np.testing.assert_allclose(one.follow @ np.concatenate(([1.0], dx)), dz, rtol=1e-10, atol=1e-12)
            np.testing.assert_allclose(one.settled + one.reduced @ dx, moved, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(here.step[e], here.one(e).step, rtol=1e-12)


@pytest.mark.parametrize("freedom", [1, 2, 3, 17, 400])
def test_chi_square_is_that_of_scipy(freedom):
    for p in (1e-6, 0.05, 0.5, 0.95, 1.0 - 1e-6):
        np.testing.assert_allclose(quantile(p, freedom), chi2.ppf(p, freedom), rtol=1e-10)
    for x in (0.1, 1.0, freedom, 3.0 * freedom):
        np.testing.assert_allclose(tail(x, freedom), chi2.sf(x, freedom), rtol=1e-10)
        assert p_value(x, freedom) == tail(x, freedom)
    assert np.isnan(p_value(1.0, 0))
