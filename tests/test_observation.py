"""Every wrong picture, mask, depth and pose is refused with its reason; lossless ones are converted."""

import logging

import numpy as np
import pytest
from PIL import ExifTags, Image

from grasptransfer.camera import Camera
from grasptransfer.errors import GraspTransferError, ImageError, PoseError
from grasptransfer.frames import rigid
from grasptransfer.perception.observation import observe, read_image

RGB = np.random.default_rng(0).integers(0, 255, (120, 160, 3), np.uint8)
CAMERA = Camera.from_fov(160, 120, 1.0)
POSE = rigid(np.eye(3), np.array([0, 0, 0.5]))


@pytest.mark.parametrize(
    ("image", "word"),
    [
        (RGB.astype(float) / 255, "uint8"),
        (RGB.astype(np.uint16), "uint8"),
        (RGB[:8, :8], "between"),
        (np.zeros((0, 0, 3), np.uint8), "between"),
        (np.zeros((40, 20_000, 3), np.uint8), "between"),
        (np.zeros((4, 60, 60, 3), np.uint8), "shape"),
        (np.zeros((60, 60, 2), np.uint8), "shape"),
        (np.dstack([RGB, np.full((120, 160), 100, np.uint8)]), "see-through"),
        (Image.fromarray(RGB).convert("CMYK"), "mode"),
        ("no/such/picture.png", "does not exist"),
        (12, "path"),
    ],
)
def test_a_wrong_picture_is_refused(image, word):
    with pytest.raises(ImageError, match=word):
        observe(image, POSE, camera=None)


def test_a_file_that_is_no_picture_is_named(tmp_path):
    path = tmp_path / "notes.png"
    path.write_text("hello")
    with pytest.raises(ImageError, match=r"notes\.png"):
        read_image(path)


@pytest.mark.parametrize("opened", [False, True])
def test_a_picture_stored_turned_is_refused(tmp_path, opened):
    path, exif = tmp_path / "turned.jpg", Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    Image.fromarray(RGB).save(path, exif=exif)
    with pytest.raises(ImageError, match="orientation"):
        read_image(Image.open(path) if opened else path)


def test_a_picture_of_too_many_pixels_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "huge.png"
    Image.fromarray(RGB).save(path)
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    with pytest.raises(ImageError, match=r"huge\.png"):
        read_image(path)


def test_what_was_observed_stays_when_the_camera_writes_its_next_picture():
    buffer, pose, depth = RGB.copy(), POSE.copy(), np.full((120, 160), 0.7)
    observation = observe(buffer, pose, camera=CAMERA, depth=depth, mask=np.ones((120, 160), np.uint8))
    buffer[:], pose[:], depth[:] = 7, 0, 0
    np.testing.assert_array_equal(observation.image, RGB)
    np.testing.assert_array_equal(observation.camera_from_object, POSE)
    assert observation.mask.all()
    assert (observation.depth == 0.7).all()
    with pytest.raises(ValueError, match="read-only"):
        observation.image[0] = 0


def test_grey_and_opaque_rgba_are_converted_with_a_note(caplog):
    with caplog.at_level(logging.WARNING):
        grey = read_image(RGB[..., 0])
        opaque = read_image(np.dstack([RGB, np.full((120, 160), 255, np.uint8)]))
    assert "grey" in caplog.text
    assert "alpha" in caplog.text
    np.testing.assert_array_equal(grey, np.repeat(RGB[..., :1], 3, 2))
    np.testing.assert_array_equal(opaque, RGB)


def test_a_camera_may_be_a_file(tmp_path):
    path = tmp_path / "camera.yaml"
    names = ("fx", "fy", "cx", "cy", "width", "height")
    path.write_text("".join(f"{name}: {getattr(CAMERA, name)}\n" for name in names))
    assert observe(RGB, POSE, camera=path).camera == CAMERA


def test_a_missing_camera_is_assumed_with_a_warning(caplog):
    with caplog.at_level(logging.WARNING):
        observation = observe(RGB, POSE)
    assert "60 degrees" in caplog.text
    assert observation.camera == Camera.from_fov(160, 120, np.deg2rad(60))


@pytest.mark.parametrize(
    ("translation", "word"),
    [((0, 0, -0.5), "behind"), ((5.0, 0, 0.5), "outside"), ((0, 0, 700.0), "millimetres")],
)
def test_a_pose_out_of_view_is_refused(translation, word):
    with pytest.raises(PoseError, match=word):
        observe(RGB, rigid(np.eye(3), np.array(translation)), camera=CAMERA)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"mask": np.zeros((120, 160), bool)}, "empty"),
        ({"mask": np.zeros((10, 10), bool)}, "120"),
        ({"mask": (50, 50, 40, 60)}, "u0 < u1"),
        ({"box": (90, 60, 40, 50)}, r"u0 \+ width"),
        ({"box": (0.2, 0.3, 0.6, 0.9)}, "shares of the picture"),
        ({"mask": lambda picture: None}, "found no object"),
        ({"mask": lambda picture: picture[:5, :5, 0] > 0}, "120"),
        ({"mask": (1000, 1000, 1100, 1100)}, "outside"),
        ({"mask": (0, 0, 20_000, 20_000)}, "beyond"),
        ({"mask": ("a", "b", "c", "d")}, "numbers"),
        ({"depth": np.zeros((10, 10))}, "120"),
        ({"depth": np.full((120, 160), 650.0)}, "millimetres"),
        ({"camera": Camera.from_fov(320, 240, 1.0)}, "320 x 240"),
        ({"camera": np.eye(4)}, "3x3"),
    ],
)
def test_a_wrong_side_input_is_refused(arguments, word):
    with pytest.raises(GraspTransferError, match=word):
        observe(RGB, POSE, **({"camera": CAMERA} | arguments))


def test_a_mask_gives_its_box():
    mask = np.zeros((120, 160), np.uint8)
    mask[20:40, 30:70] = 255
    observation = observe(RGB, POSE, camera=CAMERA, mask=mask)
    assert observation.box == (30, 20, 69, 39)
    assert observation.mask.dtype == bool


def test_a_segmenter_or_detector_is_a_callable_of_the_picture():
    def segment(picture):
        mask = picture.max(2) < 256
        mask[:, :50] = False
        picture[:] = 0  # what it writes does not reach the observation
        return mask

    observation = observe(RGB, POSE, camera=CAMERA, mask=segment)
    assert observation.box == (50, 0, 159, 119)
    np.testing.assert_array_equal(observation.image, RGB)
    detected = observe(RGB, POSE, camera=CAMERA, mask=lambda picture: (10, 20, 60, 70))
    assert detected.box == (10, 20, 60, 70)
    assert detected.mask is None


def test_missing_depth_becomes_zero():
    depth = np.full((120, 160), 0.7)
    depth[:5] = np.nan
    assert (observe(RGB, POSE, camera=CAMERA, depth=depth).depth[:5] == 0).all()


def test_the_camera_of_a_photograph_is_read_from_its_exif_data(tmp_path, caplog):
    path, exif = tmp_path / "photo.jpg", Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = 30
    Image.fromarray(RGB).save(path, exif=exif)
    for image in (path, Image.open(path)):
        with caplog.at_level(logging.WARNING):
            camera = observe(image, POSE).camera
        assert camera.fx == pytest.approx(30 / np.hypot(36, 24) * 200)
        assert "EXIF" in caplog.text
    assert observe(path, POSE, camera=CAMERA).camera == CAMERA


def test_a_matrix_in_a_file_takes_the_size_of_the_picture(tmp_path):
    np.savetxt(tmp_path / "cam_K.txt", CAMERA.matrix)
    assert observe(RGB, POSE, camera=tmp_path / "cam_K.txt").camera == CAMERA


@pytest.mark.parametrize(
    ("camera", "reason"),
    [
        (CAMERA.resized(320, 240), r"resized: give camera\.resized\(160, 120\)"),
        (Camera.from_fov(120, 160, 1.0), "turned by 90 degrees"),
        (Camera.from_fov(500, 200, 1.0), r"camera\.crop"),
    ],
)
def test_the_camera_of_another_picture_is_refused_with_the_likely_reason(camera, reason):
    with pytest.raises(ImageError, match=reason):
        observe(RGB, POSE, camera=camera)
