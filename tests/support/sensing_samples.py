"""Synthetic measurements with known truth, by equations written out here and not by the package or OpenCV."""

import numpy as np
from scipy import stats

from ctr_opt.sensing import Camera

DISTORTION = (-0.21, 0.13, 8e-4, -5e-4, 0.02)


def turn(vector):
    """Rotation matrix of a rotation vector, by its unit quaternion."""
    angle = np.linalg.norm(vector)
    w = np.cos(angle / 2)
    x, y, z = np.sin(angle / 2) * np.asarray(vector) / angle if angle else np.zeros(3)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_vector(matrix):
    """Of a small rotation."""
    return 0.5 * np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])


def rigid(vector, position):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn(vector), position
    return pose


def brown_conrady(camera, points):
    """Pixels of points of the world: pinhole, radial and tangential distortion."""
    points = np.atleast_2d(points)
    X, Y, Z = ((points - camera.pose[:3, 3]) @ camera.pose[:3, :3]).T
    x, y = X / Z, Y / Z
    k1, k2, p1, p2, k3 = (*camera.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    xd = radial * x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = radial * y + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    K = camera.intrinsics
    return np.column_stack((K[0, 0] * xd + K[0, 2], K[1, 1] * yd + K[1, 2]))


def stereo(distortion=DISTORTION):
    """Two cameras of 1024 x 768 pixels, 0.25 m apart and 0.7 m away from the origin, turned toward it."""
    matrix = [[1150.0, 0.0, 509.3], [0.0, 1147.0, 390.1], [0.0, 0.0, 1.0]]
    poses = [rigid([0.0, -0.17 * side, 0.0], [0.125 * side, 0.01 * side, -0.7]) for side in (-1, 1)]
    return [Camera(matrix, pose, distortion=distortion, resolution=(1024, 768)) for pose in poses]


def seen(cameras, points):
    """Pixels (k, cameras, 2)."""
    return np.stack([brown_conrady(camera, points) for camera in cameras], axis=1)


def cloud(count, seed=0, size=0.1):
    return size * np.random.default_rng(seed).uniform(-1, 1, (count, 3))


def normalized_error_squared(errors, covariances):
    """Errors (n, d) by covariances (d, d) or (n, d, d): chi-square with d degrees of freedom if these are right."""
    return np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[..., None])[..., 0])


def assert_chi_square(values, degrees):
    """The sum of independent chi-square values is inside its central 99.98 percent."""
    low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], degrees * len(values)) / len(values)
    assert low < np.mean(values) < high


def random_covariances(count, size, seed):
    """Anisotropic ones, as stereo cameras have: axes and lengths differ from point to point."""
    rng = np.random.default_rng(seed)
    axes = np.array([turn(vector) for vector in rng.normal(size=(count, 3))])
    lengths = size * rng.uniform([0.3, 0.3, 1.5], [0.7, 0.7, 3.0], (count, 3))
    return axes @ (lengths[:, :, None] ** 2 * np.swapaxes(axes, 1, 2))


def noise_of(covariances, rng):
    """One draw for each covariance (..., 3, 3)."""
    lower = np.linalg.cholesky(covariances)
    return (lower @ rng.normal(size=(*covariances.shape[:-1], 1)))[..., 0]
