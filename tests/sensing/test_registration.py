"""Rigid registration against motions by quaternions; covariances against the scatter of many repetitions."""

import statistics

import numpy as np
import pytest

from ctr_opt.errors import DefinitionError
from ctr_opt.sensing import register
from tests.support.sensing_samples import (
    assert_chi_square,
    cloud,
    noise_of,
    normalized_error_squared,
    random_covariances,
    rigid,
    rotation_vector,
)

POSE = rigid([0.7, -1.9, 0.4], [0.3, -0.1, 0.05])
GRID = np.stack(np.meshgrid([-0.06, 0.0, 0.06], [-0.04, 0.04], [0.0]), axis=-1).reshape(-1, 3)


def measured(reference, pose=POSE):
    """What is measured of reference points in the frame from which ``pose`` leads to theirs."""
    return (reference - pose[:3, 3]) @ pose[:3, :3]


def errors_of(found, pose=POSE):
    """Translation and small rotation that are left, in the reference's axes."""
    return np.concatenate(
        (pose[:3, 3] - found.pose[:3, 3], rotation_vector(pose[:3, :3] @ found.pose[:3, :3].T)),
    )


@pytest.mark.parametrize("vector", [[0, 0, 0], [0.7, -1.9, 0.4], [3.1415926, 0, 0], [1e-9, 0, 0]])
@pytest.mark.parametrize("reference", [cloud(12), GRID, GRID[[0, 1, 3]]], ids=["cloud", "grid", "three"])
def test_exact_points_give_the_exact_motion(vector, reference):
    pose = rigid(vector, [0.3, -0.1, 0.05])
    for options in ({"sigma": 1e-3}, {"covariances": random_covariances(len(reference), 1e-3, 0)}, {}):
        found = register(measured(reference, pose), reference, **options)
        np.testing.assert_allclose(found.pose, pose, atol=1e-14)  # rounding
        assert found.errors.maximum < 1e-15
        np.testing.assert_allclose(found.apply(measured(reference, pose)), reference, atol=1e-15)


def test_the_errors_are_what_the_paper_prints():
    rng = np.random.default_rng(5)
    found = register(measured(cloud(20)) + 5e-4 * rng.normal(size=(20, 3)), cloud(20))
    distances = [sum(x * x for x in row) ** 0.5 for row in found.errors.vectors.tolist()]
    assert found.errors.mean == pytest.approx(statistics.mean(distances), rel=1e-14)
    assert found.errors.maximum == pytest.approx(max(distances), rel=1e-14)
    assert found.errors.minimum == pytest.approx(min(distances), rel=1e-14)
    assert found.errors.standard_deviation == pytest.approx(statistics.stdev(distances), rel=1e-13)
    by_axis = [statistics.mean(abs(row[c]) for row in found.errors.vectors.tolist()) for c in range(3)]
    np.testing.assert_allclose(found.errors.mean_by_axis, by_axis, rtol=1e-13)
    line = ", ".join(f"{1e3 * x:.3f}" for x in (statistics.mean(distances), max(distances), min(distances)))
    assert f"mean, max, min, std       {line}" in found.report()


@pytest.mark.parametrize("reference", [cloud(15), GRID], ids=["cloud", "grid"])
def test_covariance_of_isotropic_noise_is_the_scatter(reference):
    rng, sigma = np.random.default_rng(6), 3e-4
    runs = [
        register(measured(reference) + sigma * rng.normal(size=reference.shape), reference, sigma=sigma)
        for _ in range(400)
    ]
    errors = np.array([errors_of(found) for found in runs])
    assert_chi_square(normalized_error_squared(errors, np.array([found.covariance for found in runs])), 6)
    # what is left of the points has 3 k - 6 degrees of freedom
    left = np.array([np.sum(found.errors.vectors**2) / sigma**2 for found in runs])
    assert_chi_square(left, 3 * len(reference) - 6)


def test_covariances_of_stereo_points_are_used():
    """Anisotropic noise: the covariance is the scatter, and smaller than that of equal weights."""
    reference, spreads = cloud(10), random_covariances(10, 4e-4, 7)
    rng = np.random.default_rng(8)
    weighted, equal, covariances = [], [], []
    for _ in range(400):
        points = measured(reference) + noise_of(spreads, rng)
        found = register(points, reference, covariances=spreads)
        weighted.append(errors_of(found))
        covariances.append(found.covariance)
        equal.append(errors_of(register(points, reference)))
    assert_chi_square(normalized_error_squared(np.array(weighted), np.array(covariances)), 6)
    assert np.linalg.det(np.cov(np.array(weighted).T)) < 0.2 * np.linalg.det(np.cov(np.array(equal).T))


def test_noise_is_estimated_from_the_errors():
    rng, reference = np.random.default_rng(9), cloud(400)
    found = register(measured(reference) + 2e-4 * rng.normal(size=reference.shape), reference)
    assert found.sigma == pytest.approx(2e-4, rel=0.08)  # 1 / sqrt(2 * 1194) = 2 percent, four times that
    known = register(measured(reference), reference, sigma=found.sigma)
    np.testing.assert_allclose(found.standard_deviations, known.standard_deviations, rtol=1e-3)


def test_weights_are_inverse_variances():
    rng, reference = np.random.default_rng(10), cloud(9)
    sigma = rng.uniform(1e-4, 1e-3, 9)
    points = measured(reference) + sigma[:, None] * rng.normal(size=(9, 3))
    by_weights, by_sigma = register(points, reference, weights=5.0 / sigma**2), register(points, reference, sigma=sigma)
    by_matrices = register(points, reference, covariances=sigma[:, None, None] ** 2 * np.eye(3))
    np.testing.assert_allclose(by_weights.pose, by_sigma.pose, atol=1e-14)
    np.testing.assert_allclose(by_matrices.pose, by_sigma.pose, atol=1e-11)  # Gauss-Newton's own tolerance
    np.testing.assert_allclose(by_matrices.covariance, by_sigma.covariance, rtol=1e-9)
    scaled = by_weights.covariance / by_sigma.covariance
    np.testing.assert_allclose(scaled, scaled[0, 0], rtol=1e-6)


def test_a_mirrored_cloud_is_not_mirrored_back():
    found = register(cloud(10) * [1, 1, -1], cloud(10))
    assert np.linalg.det(found.pose[:3, :3]) == pytest.approx(1.0)
    assert found.errors.mean > 0.01


LINE = np.outer(np.arange(5.0), [0.01, 0.02, 0.0])


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((cloud(2), cloud(2)), {}, "measured has 2 points, but must have at least 3"),
        ((cloud(4), cloud(5)), {}, "measured has 4 points, but reference has 5"),
        ((LINE, LINE), {}, "measured: the points are on a line"),
        ((cloud(5), LINE), {}, "reference: the points are on a line"),
        ((np.zeros((4, 3)), cloud(4)), {}, "on a line or coincide"),
        ((LINE + 1e-4 * cloud(5), LINE + 1e-4 * cloud(5)), {"sigma": 1e-3}, "on a line to within their noise"),
        ((cloud(4)[:, :2], cloud(4)), {}, "measured has shape"),
        ((cloud(4) * np.nan, cloud(4)), {}, r"measured\[0, 0\] = nan"),
        ((cloud(4), cloud(4)), {"sigma": 1e-3, "covariances": np.eye(3)}, "give one of them"),
        ((cloud(4), cloud(4)), {"sigma": 1e-3, "weights": np.ones(4)}, "give one of the three"),
        ((cloud(4), cloud(4)), {"weights": [1, 1, 0, 1]}, r"weights\[2\] = 0"),
        ((cloud(4), cloud(4)), {"sigma": [1e-3, 1e-3, -1e-3, 1e-3]}, r"sigma\[2\] = -0.001 m must be above 0"),
        (
            (cloud(4), cloud(4)),
            {"covariances": np.zeros((4, 3, 3))},
            r"covariances\[0\] must be symmetric and positive",
        ),
    ],
)
def test_wrong_input(arguments, options, message):
    with pytest.raises(DefinitionError, match=message):
        register(*arguments, **options)
