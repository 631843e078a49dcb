"""Triangulation: points in space from corresponding pixels of calibrated cameras."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import attrs
import numpy as np

from ..checks import Array, array
from ..errors import DefinitionError
from .cameras import Camera
from .noise import deviations_of, numbers, symmetric

_STEPS = 50
_CONVERGED = 1e-11  # of the distance to the cameras
_PARALLEL = 1e-7  # rad: nearer rays have no point of intersection in double precision
_UNCERTAIN = 0.25  # of the distance: beyond this, a covariance no longer describes a point
_FEWEST = 5  # points from whose reprojection errors the noise is estimated


@attrs.frozen(eq=False)
class Triangulation:
    """Points triangulated from pixels, with their uncertainty.

    Attributes
    ----------
    points
        ``(k, 3)`` m, in the world of the cameras.
    covariances
        ``(k, 3, 3)`` m^2, of independent points. They do not include errors of the calibration, which all points share.
    reprojection_errors
        ``(k, cameras, 2)`` px, measured minus projected.
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
        """Standard deviations of the coordinates, ``(k, 3)`` m."""
        return np.sqrt(np.diagonal(self.covariances, axis1=1, axis2=2))

    @property
    def chi_square(self) -> Array:
        """Weighted squared reprojection errors ``(k,)``: chi-square with ``2 cameras - 3`` degrees of freedom."""
        scaled = self.reprojection_errors / self.sigma[:, None]
        return np.asarray(np.sum(scaled**2, axis=(1, 2)))

    def report(self) -> str:
        """Describe the errors of pixels and points, and the point that fits worst, as text."""
        sizes = np.linalg.norm(self.reprojection_errors, axis=2)
        k, camera = np.unravel_index(np.argmax(sizes), sizes.shape)
        how = "estimated" if self.estimated else "given"
        deviations = 1e3 * np.sqrt(np.mean(self.standard_deviations**2, axis=0))
        return (
            f"Triangulation of {len(self.points)} points by {len(self.sigma)} cameras\n"
            f"  pixel noise ({how})     {numbers(self.sigma)} px\n"
            f"  reprojection errors     rms {np.sqrt(np.mean(sizes**2)):.3f} px, "
            f"largest {sizes[k, camera]:.3f} px (point {k}, camera {camera})\n"
            f"  standard deviations     {numbers(deviations)} mm in x, y, z (rms)"
        )


def triangulate(cameras: Sequence[Camera], pixels: Any, *, sigma: Any = None) -> Triangulation:
    """Find the most likely points in space for pixels with independent normal errors.

    It minimizes ``sum_c |pixel_c - project_c(X)|^2 / sigma_c^2`` for each point ``X``, lens distortion included, by
    Gauss-Newton steps from the point nearest to the rays. The covariance is ``(sum_c J_c^T J_c / sigma_c^2)^-1``.

    Parameters
    ----------
    cameras
        At least two, calibrated in one world.
    pixels
        ``(k, cameras, 2)`` px: the pixel of each point in each camera.
    sigma
        Standard deviation of a pixel's coordinate, px: one number or one per camera. ``None``: one number is estimated
        from the reprojection errors, which needs at least 5 points.

    Raises
    ------
    DefinitionError
        A shape is wrong, a pixel is not finite or outside the image, or rays are parallel or diverge in front of the
        cameras. Rays are also refused if the distance is not known to 25 percent.

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
        raise DefinitionError("pixels has no point, but must have at least 1")
    deviations = deviations_of(1.0 if sigma is None else sigma, len(cameras), unit="px")
    if sigma is None and len(measured) < _FEWEST:
        raise DefinitionError(
            f"sigma is missing: {len(measured)} points are too few to estimate it, which needs at least {_FEWEST}"
        )
    views = _Views(cameras, measured, deviations)
    points = _refined(views, _nearest(views))
    errors, jacobians = views.errors(points)
    scale = 1.0
    if sigma is None:
        degrees = len(points) * (2 * len(cameras) - 3)
        # Exact pixels leave only rounding errors: the least noise keeps covariances regular.
        scale = max(float(np.sqrt(np.sum(errors**2) / degrees)), 1e-9)
    covariances = scale**2 * symmetric(np.linalg.inv(_information(jacobians)))
    _check_certainty(views.distances(points), covariances)
    return Triangulation(points, covariances, errors * deviations[:, None], scale * deviations, sigma is None)


def _cameras(value: Any) -> tuple[Camera, ...]:
    if not isinstance(value, (list, tuple)) or len(value) < 2:
        raise DefinitionError("cameras must be a list of at least 2 Camera")
    for c, camera in enumerate(value):
        if not isinstance(camera, Camera):
            raise DefinitionError(f"cameras[{c}] = {camera!r} must be a Camera")
    return tuple(value)


@attrs.frozen(eq=False)
class _Views:
    """Pixels ``(k, cameras, 2)`` of cameras, and standard deviations of their coordinates ``(cameras,)``, px."""

    cameras: tuple[Camera, ...]
    pixels: Array
    sigma: Array

    @property
    def centres(self) -> Array:
        """Centres of the cameras, ``(cameras, 3)`` m."""
        return np.array([camera.position for camera in self.cameras])

    def errors(self, points: Array) -> tuple[Array, Array]:
        """Measured minus projected ``(k, cameras, 2)``, and the projections' derivatives by the points, over sigma."""
        projected, jacobians = zip(*(camera.linearized(points) for camera in self.cameras), strict=True)
        errors = self.pixels - np.stack(projected, axis=1)
        return errors / self.sigma[:, None], np.stack(jacobians, axis=1) / self.sigma[:, None, None]

    def distances(self, points: Array) -> Array:
        """Distances of points from the nearest camera, ``(k,)`` m."""
        return np.asarray(np.linalg.norm(points[:, None] - self.centres, axis=2).min(axis=1))


def _rays(camera: Camera, pixels: Array, c: int) -> Array:
    try:
        return camera.rays(pixels)
    except DefinitionError as error:
        raise DefinitionError(f"cameras[{c}]: {error}") from None


def _nearest(views: _Views) -> Array:
    """Find the points ``(k, 3)`` with the least sum of squared distances from their rays."""
    rays = np.stack([_rays(camera, views.pixels[:, c], c) for c, camera in enumerate(views.cameras)], axis=1)
    sines = [np.linalg.norm(np.cross(a, b), axis=1) for a, b in combinations(np.swapaxes(rays, 0, 1), 2)]
    angle = np.max(sines, axis=0)
    if angle.min() < _PARALLEL:
        k = int(np.argmin(angle))
        raise DefinitionError(
            f"pixels[{k}]: the rays are parallel (within {angle[k]:.1e} rad), so the point's distance is not determined"
        )
    across = np.eye(3) - rays[..., :, None] * rays[..., None, :]
    right = np.einsum("kcij,cj->ki", across, views.centres)
    points = np.asarray(np.linalg.solve(across.sum(axis=1), right[..., None])[..., 0])
    ahead = np.einsum("kci,kci->kc", points[:, None, :] - views.centres, rays)
    if ahead.min() <= 0.0:
        k, c = divmod(int(np.argmin(ahead)), len(views.cameras))
        raise DefinitionError(
            f"pixels[{k}]: the rays meet behind cameras[{c}], so the pixels do not match or a pose is wrong"
        )
    return points


def _information(jacobians: Array) -> Array:
    return np.asarray(np.einsum("kcai,kcaj->kij", jacobians, jacobians))


def _refined(views: _Views, points: Array) -> Array:
    """Refine points by Gauss-Newton steps, halved if they would raise the error of a point."""
    errors, jacobians = views.errors(points)
    factor = np.ones(len(points))
    for _ in range(_STEPS):
        scale = views.distances(points)
        slope = np.einsum("kcai,kca->ki", jacobians, errors)
        step = np.linalg.solve(_information(jacobians), slope[..., None])[..., 0]
        size = np.linalg.norm(step, axis=1)
        if (size < _CONVERGED * scale).all():
            return points + step
        # At most a quarter of the distance, so that no step leads behind a camera.
        trial = points + step * np.minimum(factor, 0.25 * scale / np.maximum(size, 1e-300))[:, None]
        new_errors, new_jacobians = views.errors(trial)
        cost, new_cost = (np.sum(values**2, axis=(1, 2)) for values in (errors, new_errors))
        better = new_cost <= cost * (1.0 + 1e-9) + 1e-18
        factor = np.where(better, 1.0, 0.5 * factor)
        points = np.where(better[:, None], trial, points)
        errors = np.where(better[:, None, None], new_errors, errors)
        jacobians = np.where(better[:, None, None, None], new_jacobians, jacobians)
    k = int(np.argmax(size / views.distances(points)))
    raise DefinitionError(f"pixels[{k}]: no point fits; the cameras' poses or the correspondence are wrong")


def _check_certainty(distance: Array, covariances: Array) -> None:
    relative = np.sqrt(np.linalg.eigvalsh(covariances)[:, -1]) / distance
    if relative.max() > _UNCERTAIN:
        k = int(np.argmax(relative))
        raise DefinitionError(
            f"pixels[{k}]: the rays are so nearly parallel that the distance of {distance[k]:.3g} m has a standard "
            f"deviation of {100.0 * relative[k]:.0f} percent; at most {100.0 * _UNCERTAIN:.0f} is allowed"
        )
