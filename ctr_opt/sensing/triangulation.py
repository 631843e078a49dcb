"""Points in space from corresponding pixels of calibrated cameras."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import attrs
import numpy as np

from ..checks import Array, array, number
from ..errors import DefinitionError
from .cameras import Camera
from .noise import symmetric

_STEPS = 50
_CONVERGED = 1e-11  # of the distance to the cameras
_PARALLEL = 1e-7  # rad: nearer rays have no point of intersection in double precision
_UNCERTAIN = 0.25  # of the distance: beyond, a covariance describes a point no longer
_FEWEST = 5  # points from whose reprojection errors the noise is estimated


@attrs.frozen(eq=False)
class Triangulation:
    """Points triangulated from pixels.

    Attributes
    ----------
    points
        ``(k, 3)`` m, in the world of the cameras.
    covariances
        ``(k, 3, 3)`` m^2, of independent points: errors of the calibration, which all points share, are not in them.
    reprojection_errors
        ``(k, cameras, 2)`` px, measured less projected.
    sigma
        Standard deviation of a pixel's coordinate ``(cameras,)``, px, given or estimated.
    estimated
        Whether ``sigma`` was estimated from the reprojection errors.
    """

    points: Array
    covariances: Array
    reprojection_errors: Array
    sigma: Array
    estimated: bool

    @property
    def standard_deviations(self) -> Array:
        """Of the coordinates, ``(k, 3)`` m."""
        return np.sqrt(np.diagonal(self.covariances, axis1=1, axis2=2))

    @property
    def chi_square(self) -> Array:
        """Weighted squared reprojection errors ``(k,)``: chi-square with ``2 cameras - 3`` degrees of freedom."""
        scaled = self.reprojection_errors / self.sigma[:, None]
        return np.asarray(np.sum(scaled**2, axis=(1, 2)))

    def report(self) -> str:
        """Text: how well pixels and points are known, and which point fits worst."""
        sizes = np.linalg.norm(self.reprojection_errors, axis=2)
        k, camera = np.unravel_index(np.argmax(sizes), sizes.shape)
        how = "estimated" if self.estimated else "given"
        deviations = 1e3 * np.sqrt(np.mean(self.standard_deviations**2, axis=0))
        return "\n".join(
            (
                f"Triangulation of {len(self.points)} points by {len(self.sigma)} cameras",
                f"  pixel noise ({how})     {', '.join(f'{value:.3f}' for value in self.sigma)} px",
                f"  reprojection errors     rms {np.sqrt(np.mean(sizes**2)):.3f} px, "
                f"largest {sizes[k, camera]:.3f} px (point {k}, camera {camera})",
                "  standard deviations     "
                + ", ".join(f"{value:.3f}" for value in deviations)
                + " mm in x, y, z (rms)",
            )
        )


def triangulate(cameras: Sequence[Camera], pixels: Any, *, sigma: Any = None) -> Triangulation:
    """The most likely points in space for pixels with independent normal errors.

    Minimizes ``sum_c |pixel_c - project_c(X)|^2 / sigma_c^2`` for each point ``X``, lens distortion included: from the
    point nearest to the rays, by Gauss-Newton steps. The covariance is ``(sum_c J_c^T J_c / sigma_c^2)^-1``.

    Parameters
    ----------
    cameras
        At least two, calibrated in one world.
    pixels
        ``(k, cameras, 2)`` px: where each camera sees each point.
    sigma
        Standard deviation of a pixel's coordinate, px: one number or one for each camera. ``None``: one number is
        estimated from the reprojection errors, which takes at least 5 points.

    Raises
    ------
    DefinitionError
        Wrong shapes, pixels that are no numbers or outside the image, rays that are parallel, part in front of
        the cameras, or are so nearly parallel that the distance is not known to 25 percent.

    Notes
    -----
    R. Hartley, A. Zisserman, Multiple View Geometry, 2nd ed., 2004, sections 12.2, 12.3 and 5.2.

    Examples
    --------
    >>> import numpy as np
    >>> right = np.eye(4)
    >>> right[0, 3] = 0.2
    >>> matrix = [[800, 0, 512], [0, 800, 384], [0, 0, 1]]
    >>> pair = [Camera(matrix), Camera(matrix, right)]
    >>> found = triangulate(pair, [[[592, 424], [432, 424]]], sigma=0.5)
    >>> found.points.round(9).tolist()
    [[0.1, 0.05, 1.0]]
    """
    cameras = _cameras(cameras)
    measured = array(pixels, "pixels", (None, len(cameras), 2), unit="px")
    if len(measured) == 0:
        raise DefinitionError("pixels has no point, but needs at least 1")
    deviations = np.ones(len(cameras)) if sigma is None else _deviations(sigma, len(cameras))
    if sigma is None and len(measured) < _FEWEST:
        raise DefinitionError(
            f"sigma is missing: {len(measured)} points are too few to estimate it, which takes {_FEWEST}"
        )
    rays = np.stack([_rays(camera, measured[:, c], c) for c, camera in enumerate(cameras)], axis=1)
    points = _refined(cameras, measured, deviations, _nearest(cameras, rays))
    errors, jacobians = _errors(cameras, measured, points)
    if sigma is None:
        degrees = len(points) * (2 * len(cameras) - 3)
        # Exact pixels leave rounding errors: so small a noise is none, but covariances stay regular.
        deviations = deviations * max(np.sqrt(np.sum(errors**2) / degrees), 1e-9)
    covariances = symmetric(np.linalg.inv(_information(jacobians, deviations)))
    _check_certainty(cameras, points, covariances)
    return Triangulation(points, covariances, errors, deviations, sigma is None)


def _cameras(value: Any) -> tuple[Camera, ...]:
    if not isinstance(value, (list, tuple)) or len(value) < 2:
        raise DefinitionError("cameras must be a list of at least 2 Camera")
    for c, camera in enumerate(value):
        if not isinstance(camera, Camera):
            raise DefinitionError(f"cameras[{c}] = {camera!r} must be a Camera")
    return tuple(value)


def _deviations(sigma: Any, cameras: int) -> Array:
    if np.ndim(sigma) == 0:
        return np.full(cameras, number(sigma, "sigma", above=0.0, unit="px"))
    values = array(sigma, "sigma", (cameras,), unit="px")
    return np.array([number(value, f"sigma[{c}]", above=0.0, unit="px") for c, value in enumerate(values)])


def _rays(camera: Camera, pixels: Array, c: int) -> Array:
    try:
        return camera.rays(pixels)
    except DefinitionError as error:
        raise DefinitionError(f"cameras[{c}]: {error}") from None


def _nearest(cameras: Sequence[Camera], rays: Array) -> Array:
    """The points ``(k, 3)`` with the least sum of squared distances from their rays ``(k, cameras, 3)``."""
    sines = [np.linalg.norm(np.cross(rays[:, a], rays[:, b]), axis=1) for a, b in combinations(range(len(cameras)), 2)]
    angle = np.max(sines, axis=0)
    if angle.min() < _PARALLEL:
        k = int(np.argmin(angle))
        raise DefinitionError(
            f"pixels[{k}]: its rays are parallel (within {angle[k]:.1e} rad), so the point's distance is not determined"
        )
    across = np.eye(3) - rays[..., :, None] * rays[..., None, :]
    centres = np.array([camera.position for camera in cameras])
    right = np.einsum("kcij,cj->ki", across, centres)
    points = np.asarray(np.linalg.solve(across.sum(axis=1), right[..., None])[..., 0])
    ahead = np.einsum("kci,kci->kc", points[:, None, :] - centres, rays)
    if ahead.min() <= 0.0:
        k, c = divmod(int(np.argmin(ahead)), len(cameras))
        raise DefinitionError(
            f"pixels[{k}]: its rays meet behind cameras[{c}], so they show no common point, or a camera's pose is wrong"
        )
    return points


def _errors(cameras: Sequence[Camera], measured: Array, points: Array) -> tuple[Array, Array]:
    """Measured less projected ``(k, cameras, 2)``, and the derivatives of the projections ``(k, cameras, 2, 3)``."""
    seen = [camera.linearized(points) for camera in cameras]
    return measured - np.stack([pixels for pixels, _ in seen], axis=1), np.stack([j for _, j in seen], axis=1)


def _information(jacobians: Array, deviations: Array) -> Array:
    scaled = jacobians / deviations[:, None, None]
    return np.asarray(np.einsum("kcai,kcaj->kij", scaled, scaled))


def _refined(cameras: Sequence[Camera], measured: Array, deviations: Array, points: Array) -> Array:
    """Gauss-Newton steps, cut to half where they would raise the error of a point."""
    centres = np.array([camera.position for camera in cameras])
    scale = np.linalg.norm(points[:, None] - centres, axis=2).min(axis=1)
    errors, jacobians = _errors(cameras, measured, points)
    factor = np.ones(len(points))
    for _ in range(_STEPS):
        slope = np.einsum("kcai,kca,c->ki", jacobians, errors, deviations**-2)
        step = np.linalg.solve(_information(jacobians, deviations), slope[..., None])[..., 0]
        size = np.linalg.norm(step, axis=1)
        if (size < _CONVERGED * scale).all():
            return points + step
        # At most a quarter of the distance, so that no step leads behind a camera.
        trial = points + step * np.minimum(factor, 0.25 * scale / np.maximum(size, 1e-300))[:, None]
        new_errors, new_jacobians = _errors(cameras, measured, trial)
        worse = _cost(new_errors, deviations) > _cost(errors, deviations) * (1.0 + 1e-9) + 1e-18
        factor = np.where(worse, 0.5 * factor, 1.0)
        points = np.where(worse[:, None], points, trial)
        errors = np.where(worse[:, None, None], errors, new_errors)
        jacobians = np.where(worse[:, None, None, None], jacobians, new_jacobians)
        scale = np.linalg.norm(points[:, None] - centres, axis=2).min(axis=1)
    k = int(np.argmax(size / scale))
    raise DefinitionError(f"pixels[{k}]: no point fits; the cameras' poses or the correspondence are wrong")


def _cost(errors: Array, deviations: Array) -> Array:
    return np.asarray(np.einsum("kca,kca,c->k", errors, errors, deviations**-2))


def _check_certainty(cameras: Sequence[Camera], points: Array, covariances: Array) -> None:
    centres = np.array([camera.position for camera in cameras])
    distance = np.linalg.norm(points[:, None] - centres, axis=2).min(axis=1)
    relative = np.sqrt(np.linalg.eigvalsh(covariances)[:, -1]) / distance
    if relative.max() > _UNCERTAIN:
        k = int(np.argmax(relative))
        raise DefinitionError(
            f"pixels[{k}]: its rays are so nearly parallel that its distance of {distance[k]:.3g} m has a standard "
            f"deviation of {100.0 * relative[k]:.0f} percent, allowed {100.0 * _UNCERTAIN:.0f}"
        )
