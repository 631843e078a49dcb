"""Calibrated cameras, also from files: points in the world to pixels, and pixels to rays."""

from __future__ import annotations

import importlib
from functools import partial
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from ..checks import ARRAY_EQ, Array, Entry, array, rigid
from ..errors import DefinitionError, MissingExtraError
from ..files.described import read
from ..files.text import at, read_toml
from .noise import points_of

_NEWTON_STEPS = 20  # of the undistortion
_PIXEL = 1e-7  # px: an undistorted pixel is distorted back to better than this
_OPTIONAL = ("distortion?", "pose?", "rotation?", "translation?", "resolution?")
_TABLE = dict.fromkeys(("intrinsics", *_OPTIONAL), Entry("any"))  # of a file


def _intrinsics(value: Any) -> Array:
    matrix = array(value, "intrinsics", (3, 3), unit="px")
    if matrix[0, 0] <= 0.0 or matrix[1, 1] <= 0.0:
        raise DefinitionError(f"intrinsics: focal lengths {matrix[0, 0]:g}, {matrix[1, 1]:g} px must be above 0")
    expected = np.array([[matrix[0, 0], 0.0, matrix[0, 2]], [0.0, matrix[1, 1], matrix[1, 2]], [0.0, 0.0, 1.0]])
    if not np.array_equal(matrix, expected):
        raise DefinitionError(
            f"intrinsics = {matrix.tolist()} must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]: pixels without skew"
        )
    return matrix


def _distortion(value: Any) -> Array:
    coefficients = array(np.ravel(value) if np.size(value) else np.zeros(0), "distortion", (None,))
    if len(coefficients) not in (0, 4, 5):
        raise DefinitionError(
            f"distortion has {len(coefficients)} coefficients, but must have none, 4 (k1, k2, p1, p2) or 5 (k3 last)"
        )
    return coefficients


def _pose(value: Any) -> Array:
    return rigid(value, "pose")


def _resolution(value: Any) -> Array | None:
    if value is None:
        return None
    size = array(value, "resolution", (2,), unit="px")
    if not (size >= 1.0).all():
        raise DefinitionError(f"resolution = {size.tolist()} px must be (width, height), at least 1")
    return size


@attrs.frozen
class Camera:
    """A calibrated camera: a pinhole with the Brown-Conrady lens distortion.

    A point ``(X, Y, Z)`` in the camera's frame (x to the right, y down, z forward) has normalized coordinates
    ``(x, y) = (X, Y) / Z``. With ``r^2 = x^2 + y^2`` and ``c = 1 + k1 r^2 + k2 r^4 + k3 r^6``, the lens moves them to
    ``(c x + 2 p1 x y + p2 (r^2 + 2 x^2), c y + p1 (r^2 + 2 y^2) + 2 p2 x y)``. ``intrinsics`` maps these to pixels.

    Parameters
    ----------
    intrinsics
        ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]``, px. The centre of the first pixel is (0, 0).
    pose
        Pose of the camera's frame in the world, ``(4, 4)``, m; default identity.
    distortion
        ``k1, k2, p1, p2`` and optionally ``k3``, in OpenCV's order; default none.
    resolution
        ``(width, height)``, px. If given, pixels outside the image are refused.

    Raises
    ------
    DefinitionError
        A shape is wrong, a focal length is not positive, pixels are skewed, or the pose is not rigid.

    Notes
    -----
    The model and the order of its coefficients are OpenCV's (``cv2.projectPoints``), and those of the MATLAB
    calibration toolbox that the paper used. Cameras need the extra ``sensing``.

    Examples
    --------
    >>> camera = Camera([[800, 0, 512], [0, 800, 384], [0, 0, 1]], resolution=(1024, 768))
    >>> camera.project([[0.1, 0.05, 1.0]]).round(9).tolist()
    [[592.0, 424.0]]
    """

    intrinsics: Array = attrs.field(converter=_intrinsics, eq=ARRAY_EQ, hash=False)
    pose: Array = attrs.field(default=np.eye(4), converter=_pose, eq=ARRAY_EQ, hash=False)
    distortion: Array = attrs.field(default=(), converter=_distortion, eq=ARRAY_EQ, hash=False, kw_only=True)
    resolution: Array | None = attrs.field(
        default=None, converter=_resolution, eq=attrs.cmp_using(eq=np.array_equal), hash=False, kw_only=True
    )

    @classmethod
    def from_opencv(
        cls,
        intrinsics: Any,
        distortion: Any = (),
        *,
        rotation: Any = None,
        translation: Any = None,
        resolution: Any = None,
    ) -> Camera:
        """Make a camera from the results of OpenCV's calibration: ``X_camera = rotation X_world + translation``.

        Parameters
        ----------
        intrinsics, distortion, resolution
            As of :class:`Camera`.
        rotation
            ``(3, 3)``, or a rotation vector ``(3,)``, rad, of the world in the camera; default none.
        translation
            ``(3,)`` m; default zero. With ``R, T`` of ``cv2.stereoCalibrate`` for the second camera, the world is the
            first camera's frame.
        """
        from scipy.spatial.transform import Rotation

        inverse = np.eye(4)
        if rotation is not None and np.size(rotation) == 3:
            vector = array(np.ravel(rotation), "rotation", (3,), unit="rad")
            inverse[:3, :3] = Rotation.from_rotvec(vector.copy()).as_matrix()
        elif rotation is not None:
            inverse[:3, :3] = array(rotation, "rotation", (3, 3))
        if translation is not None:
            inverse[:3, 3] = array(np.ravel(translation), "translation", (3,), unit="m")
        pose = np.linalg.inv(rigid(inverse, "rotation and translation"))
        return cls(intrinsics, pose, distortion=distortion, resolution=resolution)

    @property
    def position(self) -> Array:
        """Centre of projection in the world, ``(3,)`` m."""
        return self.pose[:3, 3]

    def moved(self, pose: Any) -> Camera:
        """Copy the camera with its world moved by ``pose`` ``(4, 4)``, such as the pose of a registration."""
        return attrs.evolve(self, pose=rigid(pose, "pose") @ self.pose)

    def in_frame(self, points: Any) -> Array:
        """Transform points of the world ``(k, 3)``, m, to the camera's frame."""
        return (points_of(points, "points", least=0) - self.position) @ self.pose[:3, :3]

    def project(self, points: Any) -> Array:
        """Project points of the world ``(k, 3)``, m, to pixels ``(k, 2)``; points behind the camera are refused."""
        return self.linearized(points)[0]

    def linearized(self, points: Any) -> tuple[Array, Array]:
        """Project points ``(k, 3)``, m, to pixels ``(k, 2)``, with derivatives by the points ``(k, 2, 3)`` px/m."""
        local = self.in_frame(points)
        if len(local) and local[:, 2].min() <= 0.0:
            k = int(np.argmin(local[:, 2]))
            raise DefinitionError(
                f"points[{k}] is behind the camera: z = {local[k, 2]:g} m in its frame must be above 0"
            )
        pixels, by_local = self._distorted(local)
        return pixels, by_local @ self.pose[:3, :3].T

    def _distorted(self, local: Array) -> tuple[Array, Array]:
        if len(local) == 0:
            return np.zeros((0, 2)), np.zeros((0, 2, 3))
        zero = np.zeros(3)
        pixels, jacobian = _opencv().projectPoints(
            np.ascontiguousarray(local)[:, None, :], zero, zero, self.intrinsics.copy(), self.distortion.copy()
        )
        # Columns 3 to 5 are the derivatives by OpenCV's translation, which is added to the points.
        return pixels[:, 0], jacobian[:, 3:6].reshape(-1, 2, 3)

    def sees(self, points: Any) -> Any:
        """Whether points ``(k, 3)``, m, are in front of the camera and, if its resolution is known, in the image."""
        local = self.in_frame(points)
        seen = local[:, 2] > 0.0
        if self.resolution is not None and seen.any():
            seen[seen] = _inside(self._distorted(local[seen])[0], self.resolution)
        return seen

    def undistort(self, pixels: Any) -> Array:
        """Find the normalized coordinates ``(k, 2)`` that the lens maps to pixels ``(k, 2)``, to 1e-7 px.

        Raises
        ------
        DefinitionError
            A pixel is outside the image, or the distortion maps no point to it.
        """
        wanted = array(pixels, "pixels", (None, 2), unit="px")
        if self.resolution is not None and not (inside := _inside(wanted, self.resolution)).all():
            k, (width, height) = int(np.argmin(inside)), self.resolution
            raise DefinitionError(
                f"pixels[{k}] = {wanted[k].tolist()} px is outside the image of {width:g} x {height:g} px"
            )
        flat = (wanted - self.intrinsics[:2, 2]) / self.intrinsics[[0, 1], [0, 1]]
        if not self.distortion.any():
            return flat
        # OpenCV iterates a fixed point instead (undistortPoints), which diverges for strong pincushion distortion.
        with np.errstate(all="ignore"):
            for _ in range(_NEWTON_STEPS):
                reached, jacobian = self._distorted(np.column_stack((flat, np.ones(len(flat)))))
                flat = flat + np.linalg.solve(jacobian[:, :, :2], (wanted - reached)[..., None])[..., 0]
            error = np.abs(self._distorted(np.column_stack((flat, np.ones(len(flat)))))[0] - wanted)
        bad = ~(error.max(axis=1, initial=0.0) <= _PIXEL)
        if bad.any():
            k = int(np.argmax(bad))
            raise DefinitionError(
                f"pixels[{k}] = {wanted[k].tolist()} px cannot result from this distortion: check both"
            )
        return flat

    def rays(self, pixels: Any) -> Array:
        """Unit vectors ``(k, 3)`` in the world from ``position`` toward the points seen at pixels ``(k, 2)``."""
        flat = self.undistort(pixels)
        local = np.column_stack((flat, np.ones(len(flat))))
        return np.asarray(local / np.linalg.norm(local, axis=1, keepdims=True) @ self.pose[:3, :3].T)


def _inside(pixels: Array, resolution: Array) -> Any:
    return np.all((pixels >= -0.5) & (pixels <= resolution - 0.5), axis=1)


def _opencv() -> Any:
    """Import the module ``cv2`` when it is used; an error names the extra to install."""
    try:
        return importlib.import_module("cv2")
    except ImportError as error:
        raise MissingExtraError(
            f"cameras need OpenCV, which cannot be imported ({error}): pip install 'ctr_opt[sensing]'"
        ) from None


def load_cameras(file: str | Path) -> tuple[Camera, ...]:
    """Read cameras from a TOML file with one table ``[[cameras]]`` per camera.

    A table contains ``intrinsics`` and optionally ``distortion`` and ``resolution``. Its pose is either ``pose`` (world
    from camera) or ``rotation`` and ``translation`` (camera from world, as in OpenCV). Lengths are in m.

    Raises
    ------
    DefinitionError
        The file cannot be read, a key is unknown, or :class:`Camera` refuses a table, which the message names.
    """
    path = Path(file)
    tables = at(path, "", lambda: read([_TABLE], read_toml(path).get("cameras"), "cameras"))
    return tuple(at(path, f"cameras[{k}]", partial(_camera, table)) for k, table in enumerate(tables))


def _camera(table: dict[str, Any]) -> Camera:
    if "pose" not in table:
        return Camera.from_opencv(**table)
    if "rotation" in table or "translation" in table:
        raise DefinitionError("pose is given together with rotation or translation: give one of them")
    return Camera(**table)
