"""Curves to precurvatures: curvature and torsion in closed form, inflections included, and the curve back again."""

import numpy as np
import pytest

import ctr_opt as ctr

A, B = 0.03, 0.01
KAPPA, TAU = A / (A**2 + B**2), B / (A**2 + B**2)
BOTH = pytest.mark.parametrize("framing", ["bishop", "frenet"])


def helix(t):
    return np.array([A * np.cos(t), A * np.sin(t), B * t])


def inflected(t):
    """A space curve whose curvature vanishes at t = 0, where its torsion is 40 1/m."""
    return 0.05 * np.array([t, t**3, t**4])


def closed_form(t):
    """Signed curvature and torsion of ``inflected``, by (r' x r'') and (r' x r'') . r'''."""
    first, second = np.array([1, 3 * t**2, 4 * t**3]) * 0.05, np.array([0, 6 * t, 12 * t**2]) * 0.05
    third = np.array([0, 6, 24 * t]) * 0.05
    cross = np.cross(first, second)
    return np.linalg.norm(cross) / np.linalg.norm(first) ** 3, cross @ third / (cross @ cross)


def test_a_helix_has_its_curvature_and_torsion():
    frenet = ctr.precurvature_from_curve(helix, framing="frenet", interval=(0, 6))
    assert frenet.length == pytest.approx(6 * np.hypot(A, B), rel=1e-13)
    # second and third derivatives of a spline over 201 samples: 1e-9 and 1e-8 of the values
    np.testing.assert_allclose(frenet.curvature, np.tile([0.0, KAPPA, TAU], (101, 1)), atol=1e-6)
    bishop = ctr.precurvature_from_curve(helix, interval=(0, 6)).curvature
    np.testing.assert_allclose(np.hypot(bishop[:, 0], bishop[:, 1]), KAPPA, atol=1e-6)
    assert np.all(bishop[:, 2] == 0.0)
    angle = np.unwrap(np.arctan2(-bishop[:, 0], bishop[:, 1]))  # the frames part by the integral of the torsion
    np.testing.assert_allclose(angle - angle[0], TAU * frenet.arc_length, atol=1e-7)


def test_an_inflection_in_space():
    piece = ctr.precurvature_from_curve(inflected, framing="frenet", interval=(-1, 1), samples=201)
    t = np.linspace(-1, 1, 20001)
    speed = np.linalg.norm(np.gradient(np.array([inflected(x) for x in t]), t, axis=0), axis=1)
    s = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(t) * (speed[1:] + speed[:-1]))))
    assert piece.length == pytest.approx(s[-1], rel=1e-7)  # trapezoids over 20000 parts
    sign = np.sign(piece.curvature[0, 1])
    for k in range(0, 201, 10):
        at = np.interp(piece.arc_length[k], s, t)
        kappa, tau = closed_form(at) if abs(at) > 1e-3 else (0.0, 40.0)
        expected = -sign * np.sign(at) * kappa if abs(at) > 1e-3 else 0.0
        # the parameter at an arc length is interpolated to 1e-7, and the curves rise by some 1e3 per unit of it
        assert piece.curvature[k, 1] == pytest.approx(expected, abs=5e-3)
        assert piece.curvature[k, 2] == pytest.approx(tau, abs=5e-3)


def test_a_planar_inflection_changes_the_sign_and_has_no_torsion():
    piece = ctr.precurvature_from_curve(
        lambda t: [0.0, 0.02 * np.sin(3 * t), 0.1 * t], framing="frenet", interval=(0, 2)
    )
    assert piece.curvature[:, 1].min() < -10.0 < 10.0 < piece.curvature[:, 1].max()
    np.testing.assert_allclose(piece.curvature[:, 2], 0.0, atol=1e-6)


@BOTH
@pytest.mark.parametrize(("curve", "interval"), [(helix, (0, 4)), (inflected, (-1, 1))])
def test_a_tube_of_this_precurvature_has_the_shape(curve, interval, framing):
    """A single unloaded tube takes its preset shape: the curve, up to a rigid motion."""
    piece = ctr.precurvature_from_curve(curve, framing=framing, interval=interval, samples=201)
    tube = ctr.Tube("rod", 1e-3, 0.0, piece, bending_stiffness=0.02, torsional_stiffness=0.015)
    shape = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [0.0]))
    ends = np.array([curve(interval[0]), curve(interval[1])])
    middle = np.array([curve(x) for x in np.linspace(*interval, 7)])
    t = np.linspace(*interval, 2001)
    speed = np.linalg.norm(np.gradient(np.array([curve(x) for x in t]), t, axis=0), axis=1)
    s = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(t) * (speed[1:] + speed[:-1]))))
    points = shape.position(np.interp(np.linspace(*interval, 7), t, s).clip(0.0, shape.length))
    # distances between points are invariant; 1e-6 m: trapezoids over 2000 parts
    for i in range(7):
        np.testing.assert_allclose(
            np.linalg.norm(points - points[i], axis=1), np.linalg.norm(middle - middle[i], axis=1), atol=1e-6
        )
    assert np.linalg.norm(points[-1] - points[0]) == pytest.approx(np.linalg.norm(ends[1] - ends[0]), abs=1e-7)


def test_points_of_a_circle():
    t = np.linspace(0, 1.5, 40)
    points = 0.05 * np.column_stack((1 - np.cos(t), np.zeros(40), np.sin(t)))
    piece = ctr.precurvature_from_curve(points)
    assert piece.length == pytest.approx(0.075, rel=1e-9)
    # the second derivative of a fifth-degree spline over 40 points: fourth order, largest at the ends
    np.testing.assert_allclose(piece.curvature, np.tile([0.0, 20.0, 0.0], (101, 1)), atol=2e-4)


@BOTH
def test_a_straight_line(framing):
    piece = ctr.precurvature_from_curve(lambda t: [0.0, 0.0, t], framing=framing, normal=(0, 0, 1))
    np.testing.assert_allclose(piece.curvature, 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([[0, 0, 0], [0, 0, 1]],), "2 points"),
        (([[0, 0, 0], [0, 0, 1], [0, 0, 1], [0, 1, 1]],), r"curve\[1\] and curve\[2\]"),
        ((lambda t: [0.0, 0.0, t**2 - t],), "turns back"),
        ((lambda t: [0.0, t],), "curve"),
        ((lambda t: [0.0, 0.0, np.nan],), "finite"),
    ],
)
def test_what_is_no_curve_is_refused(arguments, words):
    with pytest.raises(ctr.DefinitionError, match=words):
        ctr.precurvature_from_curve(*arguments)


def test_wrong_settings_are_refused():
    with pytest.raises(ctr.DefinitionError, match="framing = 'frennet' must be 'bishop' or 'frenet'"):
        ctr.precurvature_from_curve(helix, framing="frennet")
    with pytest.raises(ctr.DefinitionError, match="samples = 3 must be a whole number, at least 5"):
        ctr.precurvature_from_curve(helix, samples=3)
    with pytest.raises(ctr.DefinitionError, match="interval"):
        ctr.precurvature_from_curve(helix, interval=(1.0, 0.0))
