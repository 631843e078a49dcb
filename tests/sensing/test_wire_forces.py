"""Forces of wires with known directions; covariances against the scatter of many repetitions."""

import numpy as np
import pytest
from scipy.optimize import least_squares

import ctr_opt as ctr
from ctr_opt.errors import DefinitionError
from ctr_opt.sensing import hanging_mass, wire_direction
from tests.support.sensing_samples import assert_chi_square, noise_of, normalized_error_squared, random_covariances

D = np.array([0.48, -0.6, 0.64])
D = D / np.linalg.norm(D)
PLACES = np.array([0.0, 0.02, 0.03, 0.05, 0.07, 0.1])
WIRE = np.outer(PLACES, D) + np.array([0.1, 0.2, 0.3])
ACROSS = np.linalg.svd(D[None])[2][1:]  # two directions normal to the wire: what varies


@pytest.mark.parametrize("options", [{}, {"sigma": 1e-4}, {"covariances": random_covariances(6, 1e-4, 0)}])
def test_an_exact_wire(options):
    found = wire_direction(WIRE, **options)
    np.testing.assert_allclose(found.direction, D, atol=1e-14)  # rounding of 1e-16 m over 0.1 m
    np.testing.assert_allclose(wire_direction(WIRE[::-1], sigma=1e-4).direction, -D, atol=1e-14)
    np.testing.assert_allclose(found.covariance @ D, 0.0, atol=1e-18)
    assert found.residuals.max() < 1e-15


def test_the_line_is_the_most_likely_one():
    """All unknowns at once, the places along the wire too, by scipy."""
    spreads = random_covariances(6, 1e-3, 1)
    points = WIRE + noise_of(spreads, np.random.default_rng(2))
    white = np.linalg.inv(np.linalg.cholesky(spreads))

    def errors(x):
        line = WIRE[0] + x[:2] @ ACROSS + np.outer(x[4:], D + x[2:4] @ ACROSS)
        return np.einsum("kij,kj->ki", white, points - line).ravel()

    best = least_squares(
        errors, np.concatenate((np.zeros(4), PLACES)), x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    expected = D + best.x[2:4] @ ACROSS
    found = wire_direction(points, covariances=spreads)
    np.testing.assert_allclose(found.direction, expected / np.linalg.norm(expected), atol=1e-7)  # scipy's differences
    tilt = np.linalg.inv(best.jac.T @ best.jac)[2:4, 2:4]
    # scipy measures the tilt across D and not across the estimate: 1 percent apart, squared twice
    np.testing.assert_allclose(ACROSS @ found.covariance @ ACROSS.T, tilt, rtol=5e-3)


@pytest.mark.parametrize("kind", ["isotropic", "anisotropic"])
def test_covariance_is_the_scatter(kind):
    rng, spreads = np.random.default_rng(3), random_covariances(6, 3e-4, 4)
    spreads = spreads if kind == "anisotropic" else np.tile(9e-8 * np.eye(3), (6, 1, 1))
    runs = [wire_direction(WIRE + noise_of(spreads, rng), covariances=spreads) for _ in range(500)]
    errors = np.array([found.direction - D for found in runs]) @ ACROSS.T
    covariances = ACROSS @ np.array([found.covariance for found in runs]) @ ACROSS.T
    assert_chi_square(normalized_error_squared(errors, covariances), 2)
    if kind == "isotropic":
        left = [np.sum(found.residuals**2) / 9e-8 for found in runs]
        assert_chi_square(left, 2 * 6 - 4)
        expected = 3e-4 / np.sqrt(np.sum((PLACES - PLACES.mean()) ** 2))  # of a line's slope, in each direction
        np.testing.assert_allclose([found.angle_deviation for found in runs], np.sqrt(2) * expected, rtol=0.02)


def test_noise_is_estimated_from_the_residuals():
    places = np.linspace(0, 0.1, 300)
    points = np.outer(places, D) + 2e-4 * np.random.default_rng(5).normal(size=(300, 3))
    assert wire_direction(points).sigma == pytest.approx(2e-4, rel=0.12)  # 1 / sqrt(1192) = 3 percent, four times that


def test_a_hanging_mass():
    pull = hanging_mass(0.1, WIRE, gravity=9.81, sigma=3e-4)
    np.testing.assert_allclose(pull.force, 0.981 * D, atol=1e-14)
    assert pull.magnitude == pytest.approx(0.981, rel=1e-15)
    assert hanging_mass(0.1, WIRE, sigma=3e-4).magnitude == pytest.approx(0.980665, rel=1e-15)
    load = pull.load(1, arc_length=0.05)
    assert load == ctr.PointWrench(force=pull.force, tube=1, arc_length=0.05)
    assert pull.load().arc_length is None
    assert "0.9810 +- 0.0000 N" in pull.report()


def test_covariance_of_the_force_is_the_scatter():
    rng, errors, covariances = np.random.default_rng(6), [], []
    for _ in range(500):
        mass, friction = 0.2 + 5e-4 * rng.normal(), 0.02 * rng.normal()
        points = WIRE + 2e-4 * rng.normal(size=WIRE.shape)
        pull = hanging_mass(0.2, points, gravity=9.81, sigma=2e-4, mass_sigma=5e-4, tension_sigma=0.02)
        errors.append(pull.force - (9.81 * mass + friction) * D)
        covariances.append(pull.covariance)
    assert_chi_square(normalized_error_squared(np.array(errors), np.array(covariances)), 3)
    assert pull.magnitude_deviation == pytest.approx(np.hypot(9.81 * 5e-4, 0.02))


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        (WIRE[:2], {}, "points has 2 points, but must have at least 3"),
        (WIRE[:1], {"sigma": 1e-4}, "must have at least 2"),
        (np.zeros((4, 3)), {"sigma": 1e-4}, "the first and the last must be apart"),
        (WIRE[[0, 1, 2, 0]], {"sigma": 1e-4}, "the first and the last must be apart"),
        (WIRE, {"sigma": 0.1}, "points span little more than their noise"),
        (WIRE, {"sigma": 1e-4, "covariances": np.eye(3)}, "give one of them"),
        (WIRE[:, :2], {}, "points has shape"),
    ],
)
def test_wrong_wires(points, options, message):
    with pytest.raises(DefinitionError, match=message):
        wire_direction(points, **options)


@pytest.mark.parametrize(
    ("mass", "options", "message"),
    [
        (0.0, {}, "mass = 0 kg must be a finite number in kg, above 0"),
        (0.1, {"gravity": -9.81}, "gravity = -9.81 m/s"),
        (0.1, {"mass_sigma": -1.0}, "mass_sigma"),
        (0.1, {"tension_sigma": np.nan}, "tension_sigma"),
    ],
)
def test_wrong_masses(mass, options, message):
    with pytest.raises(DefinitionError, match=message):
        hanging_mass(mass, WIRE, **options)
