"""Curvatures from strains of material lines that are bent by finite rotations."""

import numpy as np
import pytest

from ctr_opt.errors import DefinitionError
from ctr_opt.sensing import core_ring, curvature_from_strains
from tests.support.sensing_samples import assert_chi_square, normalized_error_squared, turn

CORES = np.vstack((core_ring(35e-6, np.deg2rad([10.0, 130.0, 250.0])), [[0.0, 0.0]]))


def stretched(curvature, cores, length=0.02, steps=2000):
    """Strains of lines at the cores of a rod bent by (u_x, u_y): lengths of polygons over finite rotations.

    The rod's frame turns by exp(s hat(u)) and its axis follows the frame's z, both integrated by midpoints.
    """
    u, h = np.array([*curvature, 0.0]), length / steps
    step, middle, frame, point = turn(u * h), turn(u * h / 2), np.eye(3), np.zeros(3)
    lines = [np.column_stack((cores, np.zeros(len(cores))))]
    offsets = lines[0]
    for _ in range(steps):
        point = point + h * (frame @ middle)[:, 2]
        frame = frame @ step
        lines.append(point + offsets @ frame.T)
    lengths = np.linalg.norm(np.diff(lines, axis=0), axis=2).sum(axis=0)
    return lengths / length - 1.0


@pytest.mark.parametrize("curvature", [(12.0, 0.0), (0.0, 12.0), (-7.0, 20.0), (0.0, 0.0)])
def test_strains_of_a_bent_fibre_give_its_curvature(curvature):
    strains = stretched(curvature, CORES)
    for temperature in (True, False):
        found = curvature_from_strains([strains], CORES, temperature=temperature)
        # exact for plane bending but for polygons: (u h)^2 / 24 = 2e-9 of the length, over 35e-6 m
        np.testing.assert_allclose(found.curvature, [curvature], atol=3e-9 / 35e-6)
    np.testing.assert_allclose(curvature_from_strains([strains], CORES).common_strain, 0.0, atol=3e-9)


def test_positive_u_x_stretches_the_side_of_positive_y():
    """And bends toward -y: where the rod of the test ends, and what the package says of the strains."""
    strains = stretched((10.0, 0.0), np.array([[0.0, 35e-6], [0.0, -35e-6], [35e-6, 0.0]]))
    assert strains[0] > 3e-4 > -3e-4 > strains[1]
    assert (turn([10.0 * 0.02, 0, 0]) @ [0, 0, 1])[1] < 0.0
    found = curvature_from_strains([[3.5e-4, -3.5e-4, 0.0]], [[0.0, 35e-6], [0.0, -35e-6], [35e-6, 0.0]])
    np.testing.assert_allclose(found.curvature, [[10.0, 0.0]], atol=1e-9)


def test_a_common_strain_is_reported_from_bending():
    rng = np.random.default_rng(0)
    u, common = rng.normal(scale=10, size=(50, 2)), rng.normal(scale=5e-4, size=50)
    strains = np.column_stack([u[:, 0] * y - u[:, 1] * x + common for x, y in CORES])
    found = curvature_from_strains(strains, CORES)
    np.testing.assert_allclose(found.curvature, u, atol=1e-9)  # rounding of 1e-19 over 35e-6 m
    np.testing.assert_allclose(found.common_strain, common, atol=1e-15)
    wrong = curvature_from_strains(strains[:, :2], CORES[:2], temperature=False)
    assert np.abs(wrong.curvature - u).max() > 1.0


@pytest.mark.parametrize("kind", ["sigma", "each", "covariance", "estimated"])
def test_covariance_is_the_scatter(kind):
    rng = np.random.default_rng(1)
    each = np.array([1e-6, 2e-6, 3e-6, 1e-6])
    mixed = np.diag(each**2) + 1e-12
    spread = {"each": np.diag(each**2), "covariance": mixed}.get(kind, 4e-12 * np.eye(4))
    options = {"sigma": {"sigma": 2e-6}, "each": {"sigma": each}, "covariance": {"covariance": mixed}}.get(kind, {})
    truth = np.array([8.0, -3.0, 2e-4])
    clean = truth[0] * CORES[:, 1] - truth[1] * CORES[:, 0] + truth[2]
    found = curvature_from_strains(clean + rng.multivariate_normal(np.zeros(4), spread, 2000), CORES, **options)
    errors = np.column_stack((found.curvature, found.common_strain)) - truth
    if kind == "estimated":
        by_sigma = curvature_from_strains([clean], CORES, sigma=2e-6).covariance
        np.testing.assert_allclose(
            found.covariance, by_sigma, rtol=0.13, atol=1e-12
        )  # 2000 left: 3 percent, four times
    else:
        assert_chi_square(normalized_error_squared(errors, found.covariance), 3)


def test_three_cores_leave_nothing_to_estimate_noise_from():
    found = curvature_from_strains(np.zeros((9, 3)), CORES[:3])
    assert found.covariance is None
    assert found.standard_deviations is None
    assert "unknown: give sigma" in found.report()
    assert "1/m in u_x, u_y" in curvature_from_strains(np.zeros((9, 3)), CORES[:3], sigma=1e-6).report()


@pytest.mark.parametrize(
    ("strains", "cores", "options", "message"),
    [
        (np.zeros((3, 2)), CORES[:2], {}, "has 2 cores, but must have at least 3"),
        (np.zeros((3, 1)), CORES[:1], {"temperature": False}, "has 1 cores, but must have at least 2"),
        (np.zeros((3, 3)), [[1e-5, 0], [2e-5, 0], [0, 0]], {}, "the cores are on a line, so"),
        (np.zeros((3, 3)), [[1e-5, 1e-5], [2e-5, 0], [0, 2e-5]], {}, "the cores are on a line, so"),
        (np.zeros((3, 2)), [[1e-5, 0], [-1e-5, 0]], {"temperature": False}, "a line through the axis"),
        (np.zeros((3, 3)), CORES, {}, r"strains has shape \(3, 3\), but must have shape \(k, 4\)"),
        (np.zeros((0, 4)), CORES, {}, "strains has no row"),
        (np.full((3, 4), np.nan), CORES, {}, r"strains\[0, 0\] = nan"),
        (np.zeros((3, 4)), CORES, {"sigma": 0.0}, "sigma = 0 must be"),
        (np.zeros((3, 4)), CORES, {"covariance": -np.eye(4)}, "positive definite"),
        (np.zeros((3, 4)), CORES, {"covariance": np.eye(4), "sigma": 1e-6}, "give one of them"),
        (np.zeros((3, 4)), CORES, {"temperature": 1}, "temperature = 1 must be True or False"),
    ],
)
def test_wrong_input(strains, cores, options, message):
    with pytest.raises(DefinitionError, match=message):
        curvature_from_strains(strains, cores, **options)


def test_wrong_rings():
    with pytest.raises(DefinitionError, match="radius = 0 m"):
        core_ring(0.0, [0.0])
