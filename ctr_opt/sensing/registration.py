"""Rigid registration of corresponding points, from the measured frame to the reference frame."""

from __future__ import annotations

from typing import Any

import attrs
import numpy as np

from ..checks import Array, array
from ..errors import DefinitionError
from .noise import numbers, points_of, spreads_of, symmetric

_STEPS = 50
_CONVERGED = 1e-12  # rad, and of the size of the cloud
_LINE = 1e-6  # of the cloud's length: its least width
_UNCERTAIN = 0.3  # rad: beyond this, a covariance no longer describes a rotation


@attrs.frozen(eq=False)
class RegistrationErrors:
    """Remaining errors between registered and reference points.

    Attributes
    ----------
    vectors
        ``(k, 3)`` m, registered minus reference, in the reference's axes.
    """

    vectors: Array

    @property
    def distances(self) -> Array:
        """Euclidean errors ``(k,)``, m."""
        return np.asarray(np.linalg.norm(self.vectors, axis=1))

    @property
    def mean(self) -> float:
        """Mean Euclidean error, m."""
        return float(self.distances.mean())

    @property
    def maximum(self) -> float:
        """Largest Euclidean error, m."""
        return float(self.distances.max())

    @property
    def minimum(self) -> float:
        """Smallest Euclidean error, m."""
        return float(self.distances.min())

    @property
    def standard_deviation(self) -> float:
        """Standard deviation of the Euclidean errors, m, with the divisor ``k - 1``."""
        return float(self.distances.std(ddof=1))

    @property
    def mean_by_axis(self) -> Array:
        """Mean absolute errors along x, y and z, ``(3,)`` m."""
        return np.asarray(np.abs(self.vectors).mean(axis=0))


@attrs.frozen(eq=False)
class Registration:
    """A rigid motion that maps measured points to reference points.

    Attributes
    ----------
    pose
        ``(4, 4)``, m: ``reference = R measured + t``.
    covariance
        ``(6, 6)``, covariance of the errors ``(dt, w)`` of translation, m, and rotation, rad, in the reference's axes,
        ``R_true = exp(hat(w)) R``.
    errors
        Remaining errors of the points.
    sigma
        Standard deviation of a coordinate of a point (of unit weight), m, if it was estimated from the errors, else
        ``None``.
    """

    pose: Array
    covariance: Array
    errors: RegistrationErrors
    sigma: float | None

    @property
    def standard_deviations(self) -> Array:
        """Standard deviations of translation, m, and rotation, rad, ``(6,)``."""
        return np.sqrt(np.diag(self.covariance))

    def apply(self, points: Any) -> Array:
        """Transform points ``(k, 3)``, m, from the measured frame to the reference's."""
        return points_of(points, "points", least=0) @ self.pose[:3, :3].T + self.pose[:3, 3]

    def report(self) -> str:
        """Describe the errors, as the paper prints them, and the motion's uncertainty as text."""
        errors, deviations = self.errors, self.standard_deviations
        values = np.array([errors.mean, errors.maximum, errors.minimum, errors.standard_deviation])
        noise = "as given" if self.sigma is None else f"{1e3 * self.sigma:.3f} mm in a coordinate, estimated"
        return (
            f"Registration of {len(errors.vectors)} points\n"
            f"  errors: mean, max, min, std       {numbers(1e3 * values)} mm\n"
            f"  mean errors along x, y, z         ({numbers(1e3 * errors.mean_by_axis)}) mm\n"
            f"  noise                             {noise}\n"
            f"  translation                       ({numbers(1e3 * self.pose[:3, 3])}) mm\n"
            f"    standard deviations             ({numbers(1e3 * deviations[:3])}) mm\n"
            f"    standard deviations of rotation ({numbers(np.degrees(deviations[3:]))}) deg"
        )


def register(
    measured: Any, reference: Any, *, sigma: Any = None, covariances: Any = None, weights: Any = None
) -> Registration:
    """Find the rigid motion that brings measured points nearest to reference points.

    It minimizes ``sum_i e_i^T (R C_i R^T)^-1 e_i`` with ``e_i = R m_i + t - r_i``. This is the maximum-likelihood
    motion for measured points with independent normal errors of covariance ``C_i`` and exact reference points. Kabsch's
    singular value decomposition solves it; if covariances are given, Gauss-Newton steps refine the result.

    Parameters
    ----------
    measured, reference
        ``(k, 3)`` m, corresponding row by row; at least 3 points that are not on a line.
    sigma
        Standard deviation of a coordinate, m: one number or one per point.
    covariances
        Covariances of the measured points, ``(k, 3, 3)`` m^2, instead of ``sigma``; a triangulation has them.
    weights
        Relative weights ``(k,)``, 1 / variance, instead of ``sigma``; the noise is estimated from the errors. Without
        any of the three, all points have equal weight.

    Raises
    ------
    DefinitionError
        A shape is wrong, points are too few or on a line (to within their noise), or two of the three are given.

    Notes
    -----
    W. Kabsch, Acta Cryst. A32, 1976; K. Arun, T. Huang, S. Blostein, IEEE PAMI 9, 1987. The covariance is the inverse
    of the normal matrix ``sum_i J_i^T (R C_i R^T)^-1 J_i``, ``J_i = [1, -hat(r_i - t)]``.

    Examples
    --------
    >>> import numpy as np
    >>> grid = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0.0]])
    >>> turned = grid[:, [1, 2, 0]] + [0.5, 0.0, 0.0]
    >>> found = register(turned, grid, sigma=1e-4)
    >>> found.pose.round(9).tolist()[0], round(found.errors.maximum, 9)
    ([0.0, 0.0, 1.0, 0.0], 0.0)
    """
    measured, reference = points_of(measured, "measured", least=3), points_of(reference, "reference", least=3)
    if len(measured) != len(reference):
        raise DefinitionError(f"measured has {len(measured)} points, but reference has {len(reference)}")
    if weights is not None and (sigma is not None or covariances is not None):
        raise DefinitionError("weights are given together with sigma or covariances: give one of the three")
    for points, field in ((measured, "measured"), (reference, "reference")):
        _check_spread(points, field)
    spreads, relative = spreads_of(sigma, covariances, len(measured))
    if weights is not None:
        spreads = spreads / array(weights, "weights", (len(measured),), above=0.0)[:, None, None]
    inverses = np.asarray(np.linalg.inv(spreads), dtype=np.float64)
    rotation, translation = _kabsch(measured, reference, 3.0 / np.trace(spreads, axis1=1, axis2=2))
    if covariances is not None:
        rotation, translation = _refined(measured, reference, inverses, rotation, translation)
    vectors, turned, normal, _ = _linearized(measured, reference, inverses, rotation, translation)
    covariance, deviation = symmetric(np.linalg.inv(normal)), None
    if relative:
        degrees = 3 * len(measured) - 6
        deviation = float(np.sqrt(np.einsum("ki,kij,kj", vectors, turned, vectors) / degrees))
        covariance = covariance * deviation**2
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    _check_certainty(covariance)
    return Registration(pose, covariance, RegistrationErrors(vectors), deviation)


def _check_spread(points: Array, field: str) -> None:
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if sizes[1] <= _LINE * sizes[0]:
        raise DefinitionError(f"{field}: the points are on a line or coincide, so the rotation is not determined")


def _check_certainty(covariance: Array) -> None:
    deviation = float(np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:])[-1]))
    if deviation > _UNCERTAIN:
        raise DefinitionError(
            f"measured: the points are on a line to within their noise; a rotation has a standard deviation of "
            f"{deviation:.2g} rad; at most {_UNCERTAIN:g} rad is allowed"
        )


def _kabsch(measured: Array, reference: Array, weights: Array) -> tuple[Array, Array]:
    from scipy.spatial.transform import Rotation

    shares = weights / weights.sum()
    a, b = shares @ measured, shares @ reference
    turn, _ = Rotation.align_vectors(reference - b, measured - a, weights=shares)
    rotation = turn.as_matrix()
    return rotation, b - rotation @ a


def _linearized(
    measured: Array, reference: Array, inverses: Array, rotation: Array, translation: Array
) -> tuple[Array, Array, Array, Array]:
    """Errors ``(k, 3)``, their inverse covariances, the normal matrix ``(6, 6)`` and the gradient by ``(dt, w)``.

    Seen in the measured frame, errors have constant covariances, whose inverses are ``inverses``; their derivative,
    turned back, is ``J = [1, -hat(arm)]`` with arms from ``t``.
    """
    errors, arms = measured @ rotation.T + translation - reference, reference - translation
    turned = rotation @ inverses @ rotation.T
    (x, y, z), zero = arms.T, np.zeros(len(arms))
    minus_hat = np.array([[zero, z, -y], [-z, zero, x], [y, -x, zero]]).transpose(2, 0, 1)
    jacobian = np.concatenate((np.broadcast_to(np.eye(3), minus_hat.shape), minus_hat), axis=2)
    weighted = np.swapaxes(jacobian, 1, 2) @ turned
    return errors, turned, (weighted @ jacobian).sum(axis=0), np.einsum("kij,kj->i", weighted, errors)


def _refined(
    measured: Array, reference: Array, inverses: Array, rotation: Array, translation: Array
) -> tuple[Array, Array]:
    """Refine a motion by Gauss-Newton steps."""
    from scipy.spatial.transform import Rotation

    size = np.linalg.norm(reference - reference.mean(axis=0), axis=1).max()
    for _ in range(_STEPS):
        _, _, normal, gradient = _linearized(measured, reference, inverses, rotation, translation)
        step = -np.linalg.solve(normal, gradient)
        translation = translation + step[:3]
        rotation = Rotation.from_rotvec(step[3:]).as_matrix() @ rotation
        if np.linalg.norm(step[:3]) < _CONVERGED * size and np.linalg.norm(step[3:]) < _CONVERGED:
            return rotation, translation
    raise DefinitionError(
        "measured: no motion fits; check that the points and covariances correspond to the points of reference"
    )
