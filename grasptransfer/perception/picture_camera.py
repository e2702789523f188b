"""The camera of a picture: as it was given, by the photograph's EXIF data, or assumed."""

import logging
from pathlib import Path

import numpy as np
from PIL import Image

from grasptransfer.camera import Camera
from grasptransfer.errors import ImageError
from grasptransfer.exif import focal_length

DEFAULT_FOV = np.deg2rad(60.0)
LOG = logging.getLogger(__name__)


def camera_of(image: object, camera: object, width: int, height: int) -> Camera:
    """The camera of a picture of this size.

    Args:
        image: path, PIL picture or array.
        camera: `Camera`, path of a camera file, 3x3 intrinsics [px], or None: by EXIF, else 60 degrees.
        width, height: size of the picture [px].

    Raises:
        CameraError: a wrong file or matrix, or one that fits no picture of this size.
        ImageError: the camera is that of a picture of another size.
    """
    if camera is None:
        return _by_exif(image, width, height) or _assumed(width, height)
    if isinstance(camera, str | Path):
        named = image if isinstance(image, str | Path) else None
        camera = Camera.load(camera, size=(width, height), image=named)
    if not isinstance(camera, Camera):
        return Camera.from_matrix(camera, width, height)
    if (camera.width, camera.height) != (width, height):
        raise ImageError(
            f"size differs from the camera's {camera.width} x {camera.height}",
            key="image",
            value=f"{width} x {height}",
            fix=_likely(camera, width, height),
        )
    return camera


def _likely(camera: Camera, width: int, height: int) -> str:
    if (camera.width, camera.height) == (height, width):
        return "Was one of them turned by 90 degrees? Turn the picture as it was calibrated"
    if abs(camera.width * height - camera.height * width) < max(camera.width, width):
        return f"The picture was resized: give camera.resized({width}, {height})"
    return "Give the intrinsics of this picture; of a part of a larger one, camera.crop(box, width, height)"


def _assumed(width: int, height: int) -> Camera:
    LOG.warning("No camera given: 60 degrees horizontal field of view is assumed.")
    return Camera.from_fov(width, height, DEFAULT_FOV)


def _by_exif(image: object, width: int, height: int) -> Camera | None:
    """By the focal length that the photograph states; None where it is no photograph, or does not say."""
    if isinstance(image, str | Path):
        with Image.open(image) as picture:
            exif = picture.getexif()
    elif isinstance(image, Image.Image):
        exif = image.getexif()
    else:
        return None
    found = focal_length(exif, (width, height))
    if found is None:
        return None
    focal, how = found
    LOG.warning("No camera given: taken from the %s.", how)
    return Camera(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)
