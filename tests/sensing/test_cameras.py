"""Cameras against the equations of pinhole and lens written out in numpy."""

import sys

import numpy as np
import pytest

from ctr_opt.errors import DefinitionError, MissingExtraError
from ctr_opt.sensing import Camera, load_cameras
from tests.support.sensing_samples import DISTORTION, brown_conrady, cloud, rigid, stereo, turn

K = [[800.0, 0.0, 512.0], [0.0, 810.0, 384.0], [0.0, 0.0, 1.0]]
LENSES = pytest.mark.parametrize("distortion", [(), DISTORTION[:4], DISTORTION], ids=["none", "four", "five"])


@LENSES
def test_projection_is_that_of_brown_and_conrady(distortion):
    for camera in stereo(distortion):
        # rounding: 1e-16 of 1000 px, some ten operations
        np.testing.assert_allclose(camera.project(cloud(50)), brown_conrady(camera, cloud(50)), atol=1e-10)


def test_derivatives_of_pixels_by_points():
    camera, points, h = stereo()[0], cloud(20), 1e-5
    _, jacobian = camera.linearized(points)
    for axis in range(3):
        step = h * np.eye(3)[axis]
        difference = (brown_conrady(camera, points + step) - brown_conrady(camera, points - step)) / (2 * h)
        # third derivatives of some 1e4 px/m^3 times h^2, and rounding of 1e-13 px over h
        np.testing.assert_allclose(jacobian[:, :, axis], difference, atol=1e-5)


@LENSES
def test_undistortion_inverts_the_lens_in_all_of_the_image(distortion):
    camera = Camera(K, distortion=distortion, resolution=(1024, 768))
    pixels = np.stack(np.meshgrid(np.linspace(0, 1023, 15), np.linspace(0, 767, 11)), axis=-1).reshape(-1, 2)
    flat = camera.undistort(pixels)
    again = brown_conrady(camera, np.column_stack((flat, np.ones(len(flat)))))
    np.testing.assert_allclose(again, pixels, atol=1e-7)  # what is promised


def test_strong_pincushion_distortion_is_undone():
    """Where the fixed point that OpenCV iterates need not converge."""
    camera, flat = Camera(K, distortion=[1.2, 0, 0, 0]), np.column_stack((np.linspace(-0.9, 0.9, 7), np.full(7, 0.5)))
    pixels = brown_conrady(camera, np.column_stack((flat, np.ones(7))))
    np.testing.assert_allclose(camera.undistort(pixels), flat, atol=1e-9)  # 1e-7 px over a focal length of 800 px


def test_rays_go_through_the_points_they_show():
    camera, points = stereo()[1], cloud(30)
    rays = camera.rays(brown_conrady(camera, points))
    expected = points - camera.position
    np.testing.assert_allclose(rays, expected / np.linalg.norm(expected, axis=1, keepdims=True), atol=1e-12)


@pytest.mark.parametrize("as_vector", [True, False])
def test_the_conventions_of_opencv(as_vector):
    vector, translation = np.array([0.3, -0.2, 0.5]), [0.02, -0.03, 0.8]
    camera = Camera.from_opencv(
        K, [[0.1, 0.02, 1e-3, 2e-3, 0.0]], rotation=vector if as_vector else turn(vector), translation=translation
    )
    np.testing.assert_allclose(camera.in_frame(cloud(5)), cloud(5) @ turn(vector).T + translation, atol=1e-15)
    assert camera.distortion.shape == (5,)


def test_a_moved_camera_sees_the_moved_points_where_it_saw_them():
    camera, pose = stereo()[0], rigid([0.4, 1.0, -0.3], [0.5, -0.2, 0.1])
    moved = cloud(8) @ pose[:3, :3].T + pose[:3, 3]
    np.testing.assert_allclose(camera.moved(pose).project(moved), camera.project(cloud(8)), atol=1e-9)


def test_what_a_camera_sees():
    camera = Camera(K, resolution=(1024, 768))
    points = [[0, 0, 1.0], [0, 0, -1.0], [0.65, 0, 1.0], [0, -0.48, 1.0]]  # in the image, behind, right of it, above it
    assert camera.sees(points).tolist() == [True, False, False, False]
    assert Camera(K).sees(points).tolist() == [True, False, True, True]


def test_cameras_from_a_file(tmp_path):
    file = tmp_path / "cameras.toml"
    file.write_text(
        f"[[cameras]]\nintrinsics = {K}\nresolution = [1024, 768]\n"
        f"[[cameras]]\nintrinsics = {K}\ndistortion = [-0.2, 0.1, 0, 0]\n"
        "rotation = [0, 0.2, 0]\ntranslation = [-0.2, 0, 0]\n"
        f"[[cameras]]\nintrinsics = {K}\npose = {rigid([0, 0.1, 0], [1, 2, 3]).tolist()}\n"
    )
    first, second, third = load_cameras(file)
    assert first == Camera(K, resolution=[1024, 768])
    np.testing.assert_allclose(second.pose, np.linalg.inv(rigid([0, 0.2, 0], [-0.2, 0, 0])), atol=1e-15)
    np.testing.assert_allclose(third.position, [1, 2, 3])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"must be tables \[\[cameras\]\]"),
        ("[[cameras]]\npose = 1", r"cameras\[0\].intrinsics is missing"),
        (f"[[cameras]]\nintrinsics = {K}\nfocus = 1", "unknown key 'focus'"),
        (f"[[cameras]]\nintrinsics = {K}\npose = 1\nrotation = [0, 0, 0]", "give one of them"),
        (f"[[cameras]]\nintrinsics = {K}\ntranslation = [0, 0]", r"cameras\[0\]: translation has shape \(2,\)"),
    ],
)
def test_wrong_files(text, message, tmp_path):
    file = tmp_path / "cameras.toml"
    file.write_text(text)
    with pytest.raises(DefinitionError, match=message):
        load_cameras(file)


def test_without_opencv_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'ctr_opt\[sensing\]'"):
        Camera(K).project([[0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"intrinsics": np.eye(4)}, "intrinsics has shape"),
        ({"intrinsics": np.diag([800.0, -800.0, 1.0])}, "must be above 0"),
        ({"intrinsics": [[800, 1, 512], [0, 800, 384], [0, 0, 1]]}, "without skew"),
        ({"pose": np.diag([2.0, 1.0, 1.0, 1.0])}, "pose: .* not a rotation"),
        ({"distortion": [0.1, 0.2]}, "distortion has 2 coefficients"),
        ({"distortion": [0.1, np.nan, 0, 0]}, "must be a finite number"),
        ({"resolution": [0, 10]}, "resolution"),
    ],
)
def test_wrong_cameras(arguments, message):
    with pytest.raises(DefinitionError, match=message):
        Camera(**{"intrinsics": K, **arguments})


def test_wrong_points_and_pixels():
    camera = Camera(K, resolution=(1024, 768))
    with pytest.raises(DefinitionError, match=r"points\[1\] is behind the camera: z = -1 m"):
        camera.project([[0, 0, 1.0], [0, 0, -1.0]])
    with pytest.raises(
        DefinitionError, match=r"pixels\[0\] = \[1100.0, 3.0\] px is outside the image of 1024 x 768 px"
    ):
        camera.undistort([[1100.0, 3.0]])
    # x (1 - 0.5 x^2) is at most 0.54, 435 px right of the centre
    with pytest.raises(DefinitionError, match=r"pixels\[0\] .* cannot result from this distortion"):
        Camera(K, distortion=[-0.5, 0, 0, 0]).undistort([[512.0 + 500.0, 384.0]])
