"""Triangulation of pixels made by equations of its own; covariances against the scatter of many repetitions."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from ctr_opt.errors import DefinitionError
from ctr_opt.sensing import Camera, triangulate
from tests.support.sensing_samples import assert_chi_square, cloud, normalized_error_squared, rigid, seen, stereo

PAIR = stereo()
THIRD = Camera(PAIR[0].intrinsics, rigid([0.25, 0.0, 0.0], [0.0, 0.2, -0.75]), distortion=[0.1, 0.05, 0, 1e-3])


@pytest.mark.parametrize("cameras", [PAIR, [*PAIR, THIRD]], ids=["two", "three"])
def test_exact_pixels_give_exact_points(cameras):
    found = triangulate(cameras, seen(cameras, cloud(40)), sigma=0.3)
    # 1e-13 px of rounding are 1e-16 m; the undistorted pixels where it starts do not matter
    np.testing.assert_allclose(found.points, cloud(40), atol=1e-13)
    assert np.abs(found.reprojection_errors).max() < 1e-9


def test_the_answer_is_the_most_likely_point():
    """The same minimum by scipy, of the projection in numpy; unequal noise of the cameras."""
    cameras, sigma = [*PAIR, THIRD], np.array([0.5, 2.0, 1.0])
    rng = np.random.default_rng(1)
    pixels = seen(cameras, cloud(5)) + sigma[:, None] * rng.normal(size=(5, 3, 2))
    found = triangulate(cameras, pixels, sigma=sigma)
    for k, truth in enumerate(cloud(5)):
        best = least_squares(
            lambda x, k=k: ((pixels[k] - seen(cameras, x)[0]) / sigma[:, None]).ravel(), truth, xtol=1e-14, ftol=1e-14
        )
        np.testing.assert_allclose(found.points[k], best.x, atol=1e-8)  # scipy's derivatives are differences
        np.testing.assert_allclose(found.covariances[k], np.linalg.inv(best.jac.T @ best.jac), rtol=1e-5)
        assert found.chi_square[k] == pytest.approx(2 * best.cost, rel=1e-9)


def test_covariances_are_the_scatter_of_repetitions():
    truth, sigma, rng = cloud(4, seed=3), 0.4, np.random.default_rng(2)
    for point in truth:
        pixels = seen(PAIR, point) + sigma * rng.normal(size=(1500, 2, 2))
        found = triangulate(PAIR, pixels, sigma=sigma)
        assert_chi_square(normalized_error_squared(found.points - point, found.covariances), 3)
        assert_chi_square(found.chi_square, 1)
        scatter = np.cov(found.points.T)
        scale = np.sqrt(np.outer(np.diag(scatter), np.diag(scatter)))
        # entries of the covariance of 1500 draws are known to 1 / sqrt(750) = 4 percent, four times that allowed
        assert np.abs(found.covariances.mean(axis=0) - scatter).max() < 0.15 * scale.max()
        assert np.abs((found.covariances.mean(axis=0) - scatter) / scale).max() < 0.15


def test_noise_is_estimated_from_the_reprojection_errors():
    rng = np.random.default_rng(4)
    found = triangulate(PAIR, seen(PAIR, cloud(800)) + 0.7 * rng.normal(size=(800, 2, 2)))
    assert found.estimated
    np.testing.assert_allclose(found.sigma, 0.7, rtol=0.1)  # 1 / sqrt(2 * 800) = 2.5 percent, four times that
    assert "estimated" in found.report()
    assert "800 points by 2 cameras" in found.report()


def test_distortion_matters():
    """Pixels of a distorting lens read as those of none are off by far more than the noise: a check of the test."""
    plain = [Camera(camera.intrinsics, camera.pose) for camera in PAIR]
    found = triangulate(plain, seen(PAIR, cloud(20)), sigma=0.3)
    assert np.abs(found.points - cloud(20)).max() > 1e-4


def test_parallel_rays_are_refused():
    pair = [Camera(PAIR[0].intrinsics), Camera(PAIR[0].intrinsics, rigid([0, 0, 0], [0.2, 0, 0]))]
    with pytest.raises(DefinitionError, match=r"pixels\[1\]: the rays are parallel"):
        triangulate(pair, [[[500, 300], [400, 300]], [[500, 300], [500, 300]]], sigma=1.0)
    with pytest.raises(DefinitionError, match=r"pixels\[0\]: the rays are parallel"):
        triangulate([pair[0], pair[0]], [[[500, 300], [500, 300]]], sigma=1.0)
    with pytest.raises(DefinitionError, match=r"so nearly parallel that the distance of 115 m .* 71 percent"):
        triangulate(pair, [[[500, 300], [498, 300]]], sigma=1.0)


def test_points_behind_the_cameras_are_refused():
    pair = [Camera(PAIR[0].intrinsics), Camera(PAIR[0].intrinsics, rigid([0, 0, 0], [0.2, 0, 0]))]
    with pytest.raises(DefinitionError, match=r"pixels\[0\]: the rays meet behind cameras\["):
        triangulate(pair, [[[500, 300], [600, 300]]], sigma=1.0)


GOOD = seen(PAIR, cloud(6))


@pytest.mark.parametrize(
    ("pixels", "options", "message"),
    [
        (np.where(np.arange(24).reshape(6, 2, 2) == 9, np.nan, GOOD), {"sigma": 1}, r"pixels\[2, 0, 1\] = nan must be"),
        (GOOD[:, :1], {"sigma": 1}, r"pixels has shape \(6, 1, 2\), but must have shape \(k, 2, 2\)"),
        (GOOD[:0], {"sigma": 1}, "pixels has no point"),
        (GOOD + 900, {"sigma": 1}, r"cameras\[0\]: pixels\[0\] = .* outside the image"),
        (GOOD[:4], {}, "4 points are too few to estimate it"),
        (GOOD, {"sigma": 0}, "sigma = 0 px must be a finite number in px, above 0"),
        (GOOD, {"sigma": [1, -1]}, r"sigma\[1\] = -1 px"),
        (GOOD, {"sigma": [1, 1, 1]}, r"sigma has shape \(3,\)"),
    ],
)
def test_wrong_input(pixels, options, message):
    with pytest.raises(DefinitionError, match=message):
        triangulate(PAIR, pixels, **options)


@pytest.mark.parametrize(("cameras", "message"), [([PAIR[0]], "at least 2"), ([PAIR[0], "left"], r"cameras\[1\]")])
def test_wrong_cameras(cameras, message):
    with pytest.raises(DefinitionError, match=message):
        triangulate(cameras, GOOD, sigma=1.0)
