"""Precurvature from points of curves that scipy integrates from a known u*(s)."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ctr_opt as ctr
from ctr_opt.errors import DefinitionError
from ctr_opt.sensing import identify_precurvature

LENGTH = 0.12


def general(s):
    """Two components that change along the tube, 1/m."""
    q = s / LENGTH
    return np.array([6 + 4 * np.sin(3.8 * q), 12 - 7 * q + 3 * np.cos(5 * q)])


def points_of(u, count, length=LENGTH):
    """The curve of u(s) from the origin along z, x at its base along the world's."""

    def slope(s, state):
        R, (ux, uy) = state[3:].reshape(3, 3), u(s)
        return np.concatenate((R[:, 2], (R @ [[0, 0, uy], [0, 0, -ux], [-uy, ux, 0]]).ravel()))

    start = np.concatenate((np.zeros(3), np.eye(3).ravel()))
    found = solve_ivp(slope, (0, length), start, t_eval=np.linspace(0, length, count), rtol=1e-11, atol=1e-13)
    return found.y[:3].T


def errors_of(fit, u=general):
    return fit.curvature[:, :2] - np.array([u(s) for s in fit.arc_length])


CLEAN = points_of(general, 60)


@pytest.mark.parametrize("method", ["polynomial", "spline"])
def test_clean_points_give_the_curvature(method):
    fit = identify_precurvature(CLEAN, method=method)
    # second derivatives of an order of at most 12, and of a spline with sixteen intervals
    assert np.abs(errors_of(fit)).max() < 5e-3
    assert fit.length == pytest.approx(LENGTH, rel=1e-7)
    assert np.all(fit.curvature[:, 2] == 0.0)
    assert np.abs(fit.residuals).max() < 1e-6


def test_the_frame_is_that_of_precurvature_from_curve():
    """The same smooth curve, by the package's other way: a spline of its points and an adaptive integrator."""
    noisy = CLEAN + 2e-4 * np.random.default_rng(0).normal(size=CLEAN.shape)
    fit = identify_precurvature(noisy, order=5, samples=401, normal=[0.3, 1.0, 0.2])
    other = ctr.precurvature_from_curve(fit.curve, normal=[0.3, 1.0, 0.2], samples=401)
    expected = np.column_stack([np.interp(fit.arc_length, other.arc_length, u) for u in other.curvature.T])
    assert other.length == pytest.approx(fit.length, rel=1e-9)
    # linear interpolation over 400 parts: u'' h^2 / 8
    np.testing.assert_allclose(fit.curvature, expected, atol=5e-3)


@pytest.mark.parametrize("turns", [0.25, 1.5])
def test_a_coil_of_more_than_one_turn(turns):
    kappa = 2 * np.pi * turns / LENGTH
    fit = identify_precurvature(points_of(lambda s: (0.0, kappa), 80), method="spline")
    np.testing.assert_allclose(fit.curvature[:, :2], np.tile([0.0, kappa], (101, 1)), atol=2e-3 * kappa)


def test_a_straight_tube_has_none():
    rng = np.random.default_rng(1)
    points = np.outer(np.linspace(0, 0.1, 30), [0, 0.6, 0.8]) + 1e-4 * rng.normal(size=(30, 3))
    fit = identify_precurvature(points)
    assert fit.order == 2
    assert np.all(np.abs(fit.curvature[:, :2]) < 4 * fit.standard_errors)


def test_dense_points_may_jitter_along_the_tube():
    """Half a noise apart, so that every other point seems to lie behind the one before."""
    rng, u = np.random.default_rng(8), lambda s: (3.0, 8.0)
    points = points_of(u, 600) + 4e-4 * rng.normal(size=(600, 3))
    for method in ("polynomial", "spline"):
        fit = identify_precurvature(points, method=method)
        assert fit.sigma == pytest.approx(4e-4, rel=0.08)  # 1 / sqrt(2 * 1200) = 2 percent, four times that
        assert np.abs(errors_of(fit, u) / fit.standard_errors).max() < 4.0
        assert fit.length == pytest.approx(LENGTH, abs=1e-3)  # the ends are points with noise of 0.4 mm


@pytest.mark.parametrize(("method", "low"), [("polynomial", 0.93), ("spline", 0.93)])
def test_bands_cover_the_truth(method, low):
    """Bands of 95 percent: over curve and repetitions they hold the truth about as often, rather more."""
    covered, sizes, noises = [], [], []
    rng, truth = np.random.default_rng(2), points_of(general, 40)
    for _ in range(16):
        fit = identify_precurvature(truth + 2e-4 * rng.normal(size=truth.shape), method=method, samples=21)
        scaled = errors_of(fit) / fit.standard_errors
        covered.append(np.mean(np.abs(scaled) < 1.96))
        sizes.append(np.mean(scaled**2))
        noises.append(fit.sigma**2)
    assert np.mean(covered) >= low
    assert 0.4 < np.mean(sizes) < 1.3
    # 16 * 2 * (40 - 6) squares: known to 4 percent in variance, 8 with the choice of an order
    assert np.sqrt(np.mean(noises)) == pytest.approx(2e-4, rel=0.08)


def test_standard_errors_of_a_right_order_are_the_scatter():
    """An order that leaves no bias: mean squares of the scaled errors are one, at the ends and between."""
    rng, truth, scaled = np.random.default_rng(3), points_of(lambda s: (5.0, 8.0 - 40 * s), 50), []
    for _ in range(60):
        noisy = truth + 1e-4 * rng.normal(size=truth.shape)
        fit = identify_precurvature(noisy, order=4, sigma=1e-4, samples=11)
        scaled.append(errors_of(fit, lambda s: (5.0, 8.0 - 40 * s)) / fit.standard_errors)
    squares = np.mean(np.square(scaled), axis=0)
    # 60 draws: the mean square is known to sqrt(2 / 60) = 18 percent; neighbours are not independent
    assert 0.75 < squares.mean() < 1.25
    assert np.all((squares > 0.35) & (squares < 2.0))


@pytest.mark.parametrize("method", ["polynomial", "spline"])
def test_a_known_direction_of_the_base_is_kept_and_helps(method):
    """Errors near the base and of the tip of a tube that is clamped there are far less; bands still hold the truth."""
    rng, truth, covered, errors = np.random.default_rng(9), points_of(general, 40), [], {True: [], False: []}
    for _ in range(15):
        noisy = truth + 2e-4 * rng.normal(size=truth.shape)
        for known in (True, False):
            fit = identify_precurvature(noisy, method=method, samples=41, tangent=[0, 0, 2.0] if known else None)
            errors[known].append(errors_of(fit)[0])
        known = identify_precurvature(noisy, method=method, samples=41, tangent=[0, 0, 2.0])
        covered.append(np.abs(errors_of(known) / known.standard_errors) < 1.96)
        start = np.diff(known.curve[:2], axis=0)[0]
        # the first of 40 chords is bent by half of its angle, some 14 / m times 1.5 mm
        np.testing.assert_allclose(start / np.linalg.norm(start), [0, 0, 1], atol=0.04)
    assert np.mean(covered) > 0.9
    assert np.mean(np.square(errors[True])) < 0.5 * np.mean(np.square(errors[False]))


def test_anisotropic_noise_is_carried_to_the_components():
    """A planar arc known well in its plane and badly across: u_y is known well, u_x badly."""
    spread = np.diag([1e-4, 4e-4, 1e-4]) ** 2
    rng, truth, scaled = np.random.default_rng(4), points_of(lambda s: (0.0, 9.0), 40), []
    for _ in range(40):
        noisy = truth + rng.normal(size=truth.shape) @ np.sqrt(spread)
        fit = identify_precurvature(noisy, order=4, covariances=np.tile(spread, (40, 1, 1)), samples=11)
        scaled.append(errors_of(fit, lambda s: (0.0, 9.0)) / fit.standard_errors)
    # A little more than 4: noise in the plane is partly along the curve, which turns by 1.1 rad, and does not count.
    ratio = fit.standard_errors[:, 0] / fit.standard_errors[:, 1]
    assert np.all((ratio > 3.8) & (ratio < 5.0))
    squares = np.mean(np.square(scaled), axis=(0, 1))
    assert np.all((squares > 0.6) & (squares < 1.5))


def test_cross_validation_is_leaving_points_out():
    """The score of an order by fits without each point, at the arc lengths of the truth: near those of the fit."""
    noisy = CLEAN + 2e-4 * np.random.default_rng(5).normal(size=CLEAN.shape)
    fit = identify_precurvature(noisy)
    # Noise along the curve moves a point's arc length with it, so that only the part across it is left.
    tangent = np.gradient(CLEAN, LENGTH / 59, axis=0)
    q = np.linspace(0, 1, 60) + np.sum((noisy - CLEAN) * tangent, axis=1) / LENGTH
    q = (q - q[0]) / (q[-1] - q[0])
    for order in (3, 4, 5, 6):
        powers, left = np.vander(2 * q - 1, order + 1), []
        for k in range(len(noisy)):
            kept = np.arange(len(noisy)) != k
            left.append(noisy[k] - powers[k] @ np.linalg.lstsq(powers[kept], noisy[kept], rcond=None)[0])
        assert fit.scores[order] == pytest.approx(np.sqrt(np.mean(np.sum(np.square(left), axis=1))), rel=0.02)
    assert fit.scores[fit.order] < 1.1 * min(fit.scores.values())
    assert set(fit.scores) == set(range(2, 13))


@pytest.mark.parametrize("method", ["polynomial", "spline"])
def test_a_tube_of_the_piece_has_the_measured_shape(method):
    fit = identify_precurvature(CLEAN, method=method, straight=0.05)
    assert fit.pieces[0] == ctr.Straight(0.05)
    tube = ctr.Tube("tube", 1e-3, 0.0, fit.pieces, bending_stiffness=0.02, torsional_stiffness=0.015)
    shape = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [0.0]))
    tip = CLEAN[-1] + [0, 0, 0.05]
    assert np.linalg.norm(shape.tip_position - tip) < 1e-6  # curvatures wrong by 5e-3 1/m here and there


def test_the_plot_is_the_papers():
    import matplotlib.pyplot as plt

    fit = identify_precurvature(CLEAN + 1e-4 * np.random.default_rng(6).normal(size=CLEAN.shape), straight=0.02)
    _, given = plt.subplots()
    axes = fit.plot(ax=given)
    assert axes is given
    lines = [line for line in axes.get_lines() if line.get_label().startswith("$")]
    for c, line in enumerate(lines):
        np.testing.assert_allclose(line.get_xdata(), 1e3 * (fit.arc_length + 0.02))
        np.testing.assert_allclose(line.get_ydata(), fit.curvature[:, c])
    assert len(lines) == len(axes.collections) == 2
    assert "[mm]" in axes.get_xlabel()
    assert "[1/m]" in axes.get_ylabel()
    assert fit.plot() is not given
    plt.close("all")


def test_reports_name_the_noise():
    noisy = CLEAN + 1e-4 * np.random.default_rng(7).normal(size=CLEAN.shape)
    assert "polynomial of order" in identify_precurvature(noisy).report()
    text = identify_precurvature(noisy, method="spline", sigma=1e-4).report()
    assert "smoothing spline" in text
    assert "0.1000 mm, given" in text


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        (CLEAN[:5], {}, "points has 5 points, but must have at least 6"),
        (CLEAN[:, :2], {}, "points has shape"),
        (CLEAN * np.nan, {}, r"points\[0, 0\] = nan"),
        (np.repeat(CLEAN, 2, axis=0), {}, r"points\[0\] and points\[1\] are the same"),
        (np.vstack((CLEAN[:9], CLEAN[3:])), {}, r"points\[8\]: the points turn back there"),
        (CLEAN, {"method": "circle"}, "method = 'circle' must be 'polynomial' or 'spline'"),
        (CLEAN, {"order": 1}, "order = 1 must be"),
        (CLEAN, {"order": 2.5}, "order = 2.5 must be a whole number"),
        (CLEAN[:8], {"order": 7}, "order = 7 must be at most 6, with 8 points"),
        (CLEAN, {"smoothing": 1.0}, "smoothing requires method = 'spline'"),
        (CLEAN, {"order": 3, "method": "spline"}, "order requires method = 'polynomial'"),
        (CLEAN, {"smoothing": 0.0, "method": "spline"}, "smoothing = 0 must be"),
        (CLEAN[:6], {"smoothing": 1e-12, "method": "spline"}, "so small that the curve goes through all points"),
        (CLEAN, {"straight": -0.1}, "straight = -0.1 m"),
        (CLEAN, {"normal": [0, 0, 1]}, "must point away from the tangent at the base"),
        (CLEAN, {"tangent": [0, 0, 0]}, "tangent = .* must be a direction"),
        (CLEAN, {"tangent": [0, 1]}, "tangent has shape"),
        (CLEAN, {"normal": [0, 0, 0]}, "must point away from the tangent at the base"),
        (CLEAN, {"samples": 5.5}, "samples = 5.5 must be a whole number"),
        (CLEAN, {"samples": 4}, "samples = 4 must be a whole number, at least 5"),
        (CLEAN, {"sigma": 0.0}, "sigma = 0 m"),
        (CLEAN, {"sigma": 1e-4, "covariances": np.eye(3)}, "give one of them"),
    ],
)
def test_wrong_input(points, options, message):
    with pytest.raises(DefinitionError, match=message):
        identify_precurvature(points, **options)
