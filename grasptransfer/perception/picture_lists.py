"""One picture or a list of them, with poses, cameras, boxes, masks and depth of each: checked."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from grasptransfer.errors import CameraError, GraspTransferError, ImageError, PoseError
from grasptransfer.perception.observation import Observation, observe, read_image
from grasptransfer.perception.several_pictures import MOVED_CAMERA, check_views

# Arguments that come once for each picture, with the errors that they raise. Of these, a camera serves all
# pictures, too, and so does the uncertainty of the poses.
EACH: dict[str, type[GraspTransferError]] = {
    "pose": PoseError,
    "box": ImageError,
    "mask": ImageError,
    "depth": ImageError,
}


def observe_all(image, pose, *, views=MOVED_CAMERA, camera=None, pose_sigma=None, **each) -> Observation:
    """Check a user's picture, or several of one object.

    Args:
        image: as of `observation.observe`, or a list of such; then `pose`, and `box`, `mask` and `depth`
            where they are given, are lists of the same length.
        pose: (4, 4) `camera_from_object` [m], or a list of them.
        views: one of `several_pictures.VIEWS`.
        camera: as of `observe`, for all pictures, or a list.
        pose_sigma: as of `observe`, for all poses, or a list.
        each: `box`, `mask` and `depth`, as of `observe`, or lists.

    Raises:
        ImageError, CameraError, PoseError: as `observe`, with the number of the picture; lists of different
            lengths; pictures of different sizes without a camera of each.
        SettingsError: unknown `views`.
    """
    views = check_views(views)
    if not isinstance(image, list | tuple):
        return replace(observe(image, pose, camera=camera, pose_sigma=pose_sigma, **each), views=views)
    if len(image) == 0:
        raise ImageError("holds no picture", key="image", value=image)
    count = len(image)
    lists: dict[str, list[Any]] = {"pose": _list_of(pose, "pose", count)}
    lists |= {key: [None] * count if one is None else _list_of(one, key, count) for key, one in each.items()}
    lists["pose_sigma"] = _sigmas(pose_sigma, count)
    lists["camera"] = _cameras(image, camera, count)
    pictures = []
    for number, one in enumerate(image):
        with _numbered(number, count):
            pictures.append(observe(one, **{key: values[number] for key, values in lists.items()}))
    return replace(pictures[0], further=tuple(pictures[1:]), views=views)


def _list_of(value: Any, key: str, count: int) -> list[Any]:
    """A value for each picture; a segmenter or detector serves all."""
    if callable(value):
        return [value] * count
    stack = isinstance(value, np.ndarray) and value.ndim == 3
    if not (isinstance(value, list | tuple) or stack):
        raise EACH[key](
            f"must be a list of {count}, one for each picture", key=key, value=type(value).__name__
        )
    if len(value) != count:
        raise EACH[key](
            f"must be a list of {count}, one for each picture", key=key, value=f"{len(value)} of them"
        )
    return list(value)


def _cameras(images: Sequence[Any], camera: Any, count: int) -> list[Any]:
    """A camera of each picture; one for all serves pictures of one size."""
    # A list of three rows is a matrix, as 3x3 intrinsics may be written.
    matrix = isinstance(camera, list | tuple) and len(camera) == 3 and np.shape(camera[0]) == (3,)
    if isinstance(camera, list | tuple) and not matrix:
        if len(camera) != count:
            raise CameraError(
                f"must be one camera for all pictures, or a list of {count}",
                key="camera",
                value=f"{len(camera)} of them",
            )
        return list(camera)
    sizes = [read_image(image).shape[1::-1] for image in images]
    if len(set(sizes)) > 1:
        raise CameraError(
            "pictures of different sizes need a camera each",
            key="camera",
            value=[f"{width} x {height}" for width, height in sizes],
            fix=f"Give a list of {count} cameras",
        )
    return [camera] * count


def _sigmas(pose_sigma: Any, count: int) -> list[Any]:
    """An uncertainty of each pose; two numbers, or six rows of six, are one for all."""
    if not isinstance(pose_sigma, list | tuple) or len(pose_sigma) != count:
        return [pose_sigma] * count
    numbers = all(np.ndim(one) == 0 and one is not None for one in pose_sigma)
    rows = count == 6 and all(np.shape(one) == (6,) for one in pose_sigma)
    return [pose_sigma] * count if numbers or rows else list(pose_sigma)


@contextmanager
def _numbered(number: int, count: int) -> Iterator[None]:
    """Errors name the picture."""
    try:
        yield
    except GraspTransferError as error:
        key = "image" if error.key is None and error.path is None else error.key
        if key is not None and count > 1:
            raise error.at(error.path, key=f"{key}[{number}]") from error
        raise
