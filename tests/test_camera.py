"""Pinhole camera: projection laws, crops and camera files."""

import json
import logging

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import ExifTags, Image

from grasptransfer.camera import Camera
from grasptransfer.errors import CameraError

CAMERA = Camera(400.0, 410.0, 300.5, 200.25, 640, 480)
K = CAMERA.matrix
SIZE = (640, 480)
P = np.column_stack([K, np.zeros(3)])


def rows(array):
    return "\n".join(" ".join(f"{value:.18e}" for value in row) for row in array)


def opencv(array):
    shape = f"   rows: {len(array)}\n   cols: {len(array[0])}\n   dt: d\n"
    return f"!!opencv-matrix\n{shape}   data: {np.ravel(array).tolist()}\n"


ROS = {"width": 640, "height": 480, "distortion_model": "plumb_bob", "D": [0.0] * 5}
# Name of a file: its content, and whether it says the picture's size.
SAME = {
    "fx.yaml": ("fx: 4.0e2\nfy: 4.1e2\ncx: 300.5\ncy: 200.25\nwidth: 640\nheight: 480", True),
    "fx.json": (json.dumps({"fx": 400, "fy": 410, "cx": 300.5, "cy": 200.25}, indent="\t"), False),
    "realsense.json": (
        json.dumps(
            {
                "fx": 400,
                "fy": 410,
                "ppx": 300.5,
                "ppy": 200.25,
                "coeffs": [0] * 5,
                "width": 640,
                "height": 480,
            }
        ),
        True,
    ),
    "bop.json": (json.dumps({"cam_K": K.ravel().tolist(), "width": 640, "height": 480}), True),
    "scene_camera.json": (json.dumps({"4": {"cam_K": K.ravel().tolist(), "depth_scale": 0.1}}), False),
    "camera_info.yaml": (
        json.dumps(ROS | {"K": K.ravel().tolist(), "P": P.ravel().tolist()}) + "\n---\n",
        True,
    ),
    "camera_info_ros2.yaml": (json.dumps(ROS | {"k": K.ravel().tolist(), "p": P.ravel().tolist()}), True),
    "calibration.yaml": (
        json.dumps(
            {
                "image_width": 640,
                "image_height": 480,
                "camera_matrix": {"rows": 3, "cols": 3, "data": K.ravel().tolist()},
                "distortion_coefficients": {"rows": 1, "cols": 5, "data": [0] * 5},
            }
        ),
        True,
    ),
    "projection.yaml": (
        json.dumps({"width": 640, "height": 480, "projection_matrix": {"data": P.ravel().tolist()}}),
        True,
    ),
    "opencv.yml": (f"%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: {opencv(K)}", True),
    "camera_data.json": (json.dumps({"K": K.tolist(), "resolution": [480, 640]}), True),
    "open3d.json": (
        json.dumps({"width": 640, "height": 480, "intrinsic_matrix": K.T.ravel().tolist()}),
        True,
    ),
    "camchain.yaml": (
        "cam0:\n  camera_model: pinhole\n  intrinsics: [400, 410, 300.5, 200.25]\n  resolution: [640, 480]\n",
        True,
    ),
    "transforms.json": (
        json.dumps({"fl_x": 400, "fl_y": 410, "cx": 301.0, "cy": 200.75, "w": 640, "h": 480, "frames": [{}]}),
        True,
    ),
    "nested.json": (
        json.dumps(
            {"width": 640, "height": 480, "intrinsics": {"fx": 400, "fy": 410, "cx": 300.5, "cy": 200.25}}
        ),
        True,
    ),
    "camera_intrinsics.json": (json.dumps({"camera_intrinsics": K.tolist()}), False),
    "cam_K.txt": (rows(K), False),
    "P.txt": (rows(P), False),
    "K.json": (json.dumps(K.tolist()), False),
}


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


@pytest.mark.parametrize("name", SAME)
def test_every_camera_file_gives_the_same_camera_and_says_what_was_read(name, tmp_path, caplog):
    text, sized = SAME[name]
    (tmp_path / name).write_text(text)
    with caplog.at_level(logging.WARNING):
        camera = Camera.load(tmp_path / name, size=SIZE)
    for field in ("fx", "fy", "cx", "cy", "width", "height"):
        assert getattr(camera, field) == pytest.approx(getattr(CAMERA, field))
    assert ("was read as" in caplog.text) == (name not in ("fx.yaml", "fx.json", "nested.json"))
    if sized:
        assert Camera.load(tmp_path / name) == camera
    else:
        with pytest.raises(CameraError, match=r"picture's size.*size=\(width, height\)"):
            Camera.load(tmp_path / name)


def test_numpy_files_hold_a_matrix_too(tmp_path):
    np.save(tmp_path / "K.npy", K)
    assert Camera.load(tmp_path / "K.npy", size=SIZE) == CAMERA


def test_half_of_the_field_of_view_gives_the_focal_length_of_nerf(tmp_path):
    (tmp_path / "transforms.json").write_text(json.dumps({"camera_angle_x": 1.1, "w": 640, "h": 480}))
    assert Camera.load(tmp_path / "transforms.json") == Camera.from_fov(640, 480, 1.1)


def test_the_name_of_the_picture_selects_its_camera(tmp_path):
    other = {"cam_K": (2 * K).ravel().tolist()}
    path = tmp_path / "scene_camera.json"
    path.write_text(json.dumps({"0": other, "31": {"cam_K": K.ravel().tolist()}}))
    assert Camera.load(path, size=SIZE, image="rgb/000031.png") == CAMERA
    with pytest.raises(CameraError, match=r"000000\.png, 000031\.png"):
        Camera.load(path, size=SIZE)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{K: [0, 0, 0, 0, 0, 0, 0, 0, 0], width: 640, height: 480}", "no calibration"),
        ("{a: 1}", "known: fx fy cx cy width height"),
        ("{K: [400, 0, 300, 0, 400, 200, 0, 0, 1], width: 640.5, height: 480}", "whole number"),
        ("{K: [400, 0, 300, 0, 400, 200, 0, 0, 1], width: 640}", "height: is missing"),
        ("{P: [0, 400, 9, 0, -400, 0, 9, 0, 0, 0, 1, 0], width: 640, height: 480}", "camera's pose besides"),
        ("{fl_x: 400, w: 640}", "h: is missing"),
        ("1 2\n3 4", "3x3 numbers"),
        ("<?xml version='1.0'?><opencv_storage/>", "is XML"),
    ],
)
def test_a_camera_file_that_cannot_be_used_says_why(tmp_path, text, says):
    (tmp_path / "camera.yaml").write_text(text)
    with pytest.raises(CameraError, match=says):
        Camera.load(tmp_path / "camera.yaml")


def test_distortion_is_told_in_pixels(tmp_path, caplog):
    path = tmp_path / "camera.yaml"
    bent = ROS | {"K": K.ravel().tolist(), "D": [0.1, -0.05, 0, 0, 0]}
    path.write_text(json.dumps(bent))
    with caplog.at_level(logging.WARNING):
        Camera.load(path)
    x, y = 339.5 / 400, 279.75 / 410  # the farthest corner
    moved = (0.1 * (x**2 + y**2) - 0.05 * (x**2 + y**2) ** 2) * np.hypot(400 * x, 410 * y)
    assert f"up to {moved:.0f} pixels" in caplog.text
    caplog.clear()
    path.write_text(json.dumps(bent | {"D": [1e-4, 0, 0, 0, 0]}))
    Camera.load(path)
    assert "pixels" not in caplog.text


def test_the_second_camera_of_a_stereo_pair_is_read_with_a_warning(tmp_path, caplog):
    shifted = P.copy()
    shifted[0, 3] = -48.0
    (tmp_path / "P2.txt").write_text(rows(shifted))
    with caplog.at_level(logging.WARNING):
        assert Camera.load(tmp_path / "P2.txt", size=SIZE) == CAMERA
    assert "frame of this camera" in caplog.text


def photograph(folder, tags, size=(400, 300)):
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif).update(tags)
    path = folder / "photo.jpg"
    Image.new("RGB", size).save(path, exif=exif)
    return path


def test_a_photograph_s_focal_length_is_compared_by_the_diagonal(tmp_path):
    camera = Camera.load(photograph(tmp_path, {ExifTags.Base.FocalLengthIn35mmFilm: 27}))
    assert camera.fx == camera.fy == pytest.approx(27 / np.hypot(36, 24) * 500)
    assert (camera.cx, camera.cy, camera.width, camera.height) == (199.5, 149.5, 400, 300)


def test_a_photograph_s_sensor_gives_its_focal_length_even_when_resized(tmp_path):
    tags = {
        ExifTags.Base.FocalLength: 5.0,
        ExifTags.Base.FocalPlaneXResolution: 800.0,
        ExifTags.Base.FocalPlaneResolutionUnit: 4,  # 800 pixels a millimetre
        ExifTags.Base.ExifImageWidth: 4000,
    }
    assert Camera.load(photograph(tmp_path, tags)).fx == pytest.approx(5.0 * 800 / 10)


def test_a_photograph_that_does_not_say_is_refused_as_a_camera(tmp_path):
    with pytest.raises(CameraError, match="no focal length in EXIF"):
        Camera.load(photograph(tmp_path, {}))
    with pytest.raises(CameraError, match="does not exist"):
        Camera.load(tmp_path / "gone.jpg")


@pytest.mark.parametrize(
    ("intrinsics", "size", "reason"),
    [
        ((800, 800, 639.5, 359.5), (640, 360), r"of about 1280 x 720: multiply them by 0\.5"),
        ((400, 400, 159.5, 119.5), (640, 480), r"of about 320 x 240: multiply them by 2"),
        ((600, 600, 239.5, 319.5), (640, 480), "turned by 90 degrees"),
        ((600, 600, 0, 0), (640, 480), r"from the middle\? Add 319\.5 and 239\.5"),
        ((600, 600, 500, 20), (640, 480), "cut out of a larger one"),
        ((600, 600, -30, 239.5), (640, 480), "cut out of a larger one"),
        ((600, 150, 320, 240), (640, 480), "differ more than any pixel's sides"),
    ],
)
def test_intrinsics_of_another_picture_are_refused_with_the_likely_reason(intrinsics, size, reason):
    fx, fy, cx, cy = intrinsics
    with pytest.raises(CameraError, match=reason):
        Camera.from_matrix([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], *size)


def test_what_is_cropped_by_hand_is_a_camera_all_the_same():
    cropped = CAMERA.crop((400, 300, 639.5, 479.5), 240, 180)
    assert cropped.cx < 0
    with pytest.raises(CameraError, match="far from the middle"):
        cropped.check_fits()


def test_resizing_keeps_every_point_at_its_share_of_the_picture():
    half = CAMERA.resized(320, 240)
    point = np.array([0.1, -0.05, 0.7])
    np.testing.assert_allclose((half.project(point) + 0.5) * 2, CAMERA.project(point) + 0.5)
