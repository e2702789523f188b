"""Pinhole camera: projection laws, crops and camera files."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptransfer.camera import Camera
from grasptransfer.errors import CameraError

CAMERA = Camera(400.0, 410.0, 300.5, 200.25, 640, 480)


@given(st.integers(0, 10_000))
def test_unprojecting_a_projection_gives_the_point_back(seed):
    points = np.random.default_rng(seed).uniform([-1, -1, 0.2], [1, 1, 3], (10, 3))
    np.testing.assert_allclose(CAMERA.unproject(CAMERA.project(points), points[:, 2]), points, atol=1e-12)


@given(st.integers(0, 10_000))
def test_a_crop_sees_each_point_at_the_resized_place(seed):
    rng = np.random.default_rng(seed)
    box = (10.0, 20.0, 10 + rng.uniform(50, 300), 20 + rng.uniform(50, 300))
    points = rng.uniform([-0.5, -0.5, 1], [0.5, 0.5, 2], (6, 3))
    pixels = CAMERA.project(points)
    scale = np.array([256 / (box[2] - box[0]), 192 / (box[3] - box[1])])
    expected = (pixels - box[:2]) * scale - 0.5  # edges of the box become edges of the new picture
    np.testing.assert_allclose(CAMERA.crop(box, 256, 192).project(points), expected, atol=1e-9)


def test_the_field_of_view_spans_the_whole_width():
    camera = Camera.from_fov(640, 480, np.deg2rad(60))
    rays = camera.unproject(np.array([[-0.5, 239.5], [639.5, 239.5]]), np.ones(2))
    angles = np.rad2deg(np.arctan(rays[:, 0]))
    np.testing.assert_allclose(angles, [-30, 30], atol=1e-9)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("fx: 1", "fy"),
        ("[1, 2]", "mapping"),
        ("fx: [", "YAML"),
        ("{fx: -1, fy: 1, cx: 0, cy: 0, width: 2, height: 2}", "positive"),
        ("{fx: a, fy: 1, cx: 0, cy: 0, width: 2, height: 2}", "number"),
        ("{cam_K: [1, 2], width: 2, height: 2}", "9 numbers"),
        ("{cam_K: wide, width: 2, height: 2}", "9 numbers"),
        ("{cam_K: {fx: 1}, width: 2, height: 2}", "9 numbers"),
        ("{cam_K: [1, 0, 0, 0, 1, 0, 0, 0, 1]}", "width"),
    ],
)
def test_a_wrong_camera_file_names_file_and_key(tmp_path, text, word):
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(CameraError, match=word) as raised:
        Camera.load(path)
    assert "camera.yaml" in str(raised.value)


def test_a_picture_given_as_camera_file_is_refused(tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_bytes(b"\x89PNG\r\n\x1a\n")
    with pytest.raises(CameraError, match="text file"):
        Camera.load(path)


def test_a_bop_camera_is_read(tmp_path):
    path = tmp_path / "camera.json"
    path.write_text('{"cam_K": [572.4, 0, 325.3, 0, 573.6, 242.0, 0, 0, 1], "width": 640, "height": 480}')
    assert Camera.load(path) == Camera(572.4, 573.6, 325.3, 242.0, 640, 480)


def test_skewed_intrinsics_are_refused():
    with pytest.raises(CameraError, match="skew"):
        Camera.from_matrix(np.array([[1.0, 0.2, 0], [0, 1, 0], [0, 0, 1]]), 10, 10)


@pytest.mark.parametrize(
    ("matrix", "says"),
    [
        (np.full((3, 3), np.nan), "finite"),
        (np.array([[600, 0, 0], [0, 600, 0], [320, 240, 1.0]]), "Transpose"),
        (np.zeros((3, 3)), "last row"),
        (np.array([[1.08, 0, 0.5], [0, 1.44, 0.5], [0, 0, 1]]), "too short"),
    ],
)
def test_a_wrong_matrix_is_told_by_its_kind(matrix, says):
    with pytest.raises(CameraError, match=says):
        Camera.from_matrix(matrix, 640, 480)
