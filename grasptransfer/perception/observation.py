"""What the robot saw, checked: the input of every estimator."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import ExifTags, Image, UnidentifiedImageError

from grasptransfer.camera import Camera
from grasptransfer.drawing.boxes import Box
from grasptransfer.errors import NOT_NUMBERS, ImageError
from grasptransfer.frames import check_rigid
from grasptransfer.perception.earlier_pictures import ObjectPosterior
from grasptransfer.perception.picture_camera import camera_of
from grasptransfer.perception.several_pictures import MOVED_CAMERA
from grasptransfer.perception.standing import Support
from grasptransfer.poses import check_in_view, covariance_of

SMALLEST_SIDE, LARGEST_SIDE = 32, 16384  # px
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Observation:
    """An RGB picture of an instance, or several, with approximate poses; made by `observe`, arrays read-only.

    The fields are those of the first picture, in whose camera the answer is.

    Args:
        image: (h, w, 3) RGB.
        camera: intrinsics of the whole picture.
        camera_from_object: (4, 4) OpenCV axes, metres.
        mask: (h, w) visible pixels of the object, if known.
        box: (u0, v0, u1, v1) around the object [px], if known.
        depth: (h, w) along the optical axis [m], 0 = missing, if measured.
        pose_covariance: (6, 6) of the pose's error, turn [rad], then shift [m], camera axes; 0: the pose is
            exact; None: the pose errs as those of real estimators do (`pose_prior.py`).
        further: the other pictures of the same object.
        views: how their poses go together, one of `several_pictures.VIEWS`.
        support: the plane on which the object stands, if it stands on one.
        earlier: what pictures before these have left known of the object.
    """

    image: UInt8[np.ndarray, "h w 3"]
    camera: Camera
    camera_from_object: Float[np.ndarray, "4 4"]
    mask: Bool[np.ndarray, "h w"] | None = None
    box: Box | None = None
    depth: Float[np.ndarray, "h w"] | None = None
    pose_covariance: Float[np.ndarray, "6 6"] | None = None
    further: "tuple[Observation, ...]" = ()
    views: str = MOVED_CAMERA
    support: Support | None = None
    earlier: ObjectPosterior | None = None

    @property
    def pictures(self) -> "tuple[Observation, ...]":
        """This picture and the further ones."""
        return (self, *self.further)

    def without(self, *names: str) -> "Observation":
        """The same without what these fields hold, such as mask and depth, in every picture."""
        nothing: dict[str, Any] = dict.fromkeys(names)
        further = tuple(picture.without(*names) for picture in self.further)
        return replace(self, **nothing, further=further)


def observe(image, pose, *, camera=None, box=None, mask=None, depth=None, pose_sigma=None) -> Observation:
    """Check a user's picture, pose and camera.

    Args:
        image: path, PIL picture or uint8 (h, w, 3) RGB array.
        pose: (4, 4) `camera_from_object`, OpenCV axes, metres.
        camera: `Camera`, path of a camera file, 3x3 intrinsics [px], or None: the focal length in the
            photograph's EXIF data, else 60 degrees horizontal field of view, with a warning.
        box: (u0, v0, u1, v1) around the object [px], or None.
        mask: bool (h, w) of the object's visible part, or, in place of `box`, its four numbers; or a
            segmenter or detector, a callable that takes the picture, uint8 (h, w, 3) RGB, and gives one of
            the two; or None.
        depth: (h, w) metres, 0 = missing, or None.
        pose_sigma: how sure the pose is, as of `poses.covariance_of`.

    Raises:
        ImageError, CameraError, PoseError: wrong input, with the argument, the value and what to do.
    """
    pixels = read_image(image)
    height, width = pixels.shape[:2]
    camera = camera_of(image, camera, width, height)
    camera_from_object = check_rigid(pose, "pose")
    check_in_view(camera_from_object, camera)
    covariance = covariance_of(pose_sigma)
    around = None
    if callable(mask):
        mask = _segmented(mask, pixels)
    if mask is not None:
        mask, around = _checked_mask(mask, width, height)
    if box is not None:
        around = _box_of(box, width, height)
    if depth is not None:
        depth = _checked_depth(depth, width, height)
    return Observation(
        _kept(pixels),
        camera,
        _kept(camera_from_object),
        None if mask is None else _kept(mask),
        around,
        None if depth is None else _kept(depth),
        None if covariance is None else _kept(covariance),
    )


def _kept(array: np.ndarray) -> np.ndarray:
    """A copy that nobody changes: cameras write one picture after the other into the same buffer."""
    array = array.copy()
    array.setflags(write=False)
    return array


def read_image(image: object) -> UInt8[np.ndarray, "h w 3"]:
    """An RGB array of a path, PIL picture or array; grey and opaque RGBA are converted with a note."""
    source = None
    if isinstance(image, str | Path):
        source = Path(image)
        try:
            with Image.open(source) as opened:
                opened.load()
                image = opened
        except FileNotFoundError as error:
            raise ImageError("does not exist", path=source) from error
        except (UnidentifiedImageError, Image.DecompressionBombError, OSError, ValueError) as error:
            raise ImageError(f"cannot be read as a picture: {error}", path=source) from error
    if isinstance(image, Image.Image):
        _check_upright(image, source)
        image = _pil_to_array(image, source)
    if not isinstance(image, np.ndarray):
        raise ImageError("must be a path, a PIL picture or an array", key="image", value=type(image).__name__)
    pixels = _to_rgb(image, source)
    height, width = pixels.shape[:2]
    if min(height, width) < SMALLEST_SIDE or max(height, width) > LARGEST_SIDE:
        raise ImageError(
            f"sides must lie between {SMALLEST_SIDE} and {LARGEST_SIDE} pixels",
            path=source,
            key="image",
            value=f"{width} x {height}",
        )
    return pixels


def _check_upright(image: Image.Image, source: Path | None):
    """Some programs turn such a picture when they read it, others do not: the pose may be of either."""
    orientation = image.getexif().get(ExifTags.Base.Orientation, 1)
    if orientation != 1:
        raise ImageError(
            "is stored turned, and its EXIF orientation says so: which way the pose was found is not known",
            path=source,
            key="orientation",
            value=orientation,
            fix="Save it upright, as the pose was found, or give an array",
        )


def _pil_to_array(image: Image.Image, source: Path | None) -> np.ndarray:
    if image.mode in ("RGB", "RGBA", "L"):
        return np.array(image)
    if image.mode == "P":
        return np.array(image.convert("RGBA" if "transparency" in image.info else "RGB"))
    raise ImageError(
        "unsupported picture mode",
        path=source,
        key="image",
        value=image.mode,
        choices=["RGB", "RGBA", "L", "P"],
    )


def _to_rgb(image: np.ndarray, source: Path | None) -> UInt8[np.ndarray, "h w 3"]:
    if image.dtype != np.uint8:
        fix = "Multiply by 255 and convert with .astype(np.uint8)" if image.dtype.kind == "f" else None
        raise ImageError("must be uint8", path=source, key="image", value=str(image.dtype), fix=fix)
    if image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 1):
        logger.warning("The picture is grey; it is used with three equal channels.")
        return np.repeat(image.reshape(*image.shape[:2], 1), 3, axis=2)
    if image.ndim == 3 and image.shape[2] == 4:
        if (image[..., 3] < 255).any():
            raise ImageError(
                "RGBA picture with see-through pixels: their colour is not known",
                path=source,
                key="image",
                value=image.shape,
                fix="Put it on a background first and give RGB",
            )
        logger.warning("The picture's alpha channel is opaque everywhere; it is dropped.")
        return np.ascontiguousarray(image[..., :3])
    if image.ndim != 3 or image.shape[2] != 3:
        raise ImageError("must have shape (height, width, 3)", path=source, key="image", value=image.shape)
    return np.ascontiguousarray(image)


def _segmented(segment: Callable, pixels: UInt8[np.ndarray, "h w 3"]) -> object:
    """What a segmenter or detector says of a picture, which it may write into."""
    mask = segment(pixels.copy())
    if mask is None:
        raise ImageError("the callable found no object in the picture", key="mask", value=None)
    return mask


def _checked_mask(mask, width: int, height: int) -> tuple[np.ndarray | None, Box]:
    array = np.asarray(mask)
    if array.dtype.kind not in "biuf":
        raise ImageError("must be bool (h, w) or four numbers", key="mask", value=mask)
    if array.shape == (4,) and array.dtype != bool:
        u0, v0, u1, v1 = (float(value) for value in array)
        return None, _checked_box((u0, v0, u1, v1), width, height)
    if array.shape != (height, width):
        raise ImageError(
            f"must be ({height}, {width}) or a box (u0, v0, u1, v1)", key="mask", value=array.shape
        )
    if array.dtype != bool:
        values = np.unique(array)
        if len(values) > 2 or (len(values) == 2 and values[0] != 0):
            raise ImageError("must be bool, or 0 and one other value", key="mask", value=str(array.dtype))
        array = array != 0
    if not array.any():
        raise ImageError("is empty: no pixel belongs to the object", key="mask")
    rows, columns = np.nonzero(array.any(1))[0], np.nonzero(array.any(0))[0]
    return array, (float(columns[0]), float(rows[0]), float(columns[-1]), float(rows[-1]))


def _box_of(box, width: int, height: int) -> Box:
    """A given box; beside a mask, which may show a part alone, it goes round the whole object."""
    try:
        array = np.asarray(box, float)
    except NOT_NUMBERS:
        array = np.zeros(0)
    if array.shape != (4,):
        raise ImageError("must be four numbers (u0, v0, u1, v1)", key="box", value=box)
    u0, v0, u1, v1 = (float(value) for value in array)
    return _checked_box((u0, v0, u1, v1), width, height, key="box")


def _checked_box(box: Box, width: int, height: int, *, key: str = "mask") -> Box:
    u0, v0, u1, v1 = box
    if not np.isfinite(box).all() or u1 <= u0 or v1 <= v0:
        fix = "Is it (u0, v0, width, height)? Then give (u0, v0, u0 + width, v0 + height)"
        positive = np.isfinite(box).all() and min(box) >= 0
        raise ImageError(
            "box must be (u0, v0, u1, v1) with u0 < u1 and v0 < v1",
            key=key,
            value=box,
            fix=fix if positive else None,
        )
    if max(box) <= 1:
        fix = f"Is it in shares of the picture's sides? Multiply by {width} and {height}"
        raise ImageError("box is smaller than a pixel", key=key, value=box, fix=fix)
    if u1 < 0 or v1 < 0 or u0 > width or v0 > height:
        raise ImageError(f"box lies outside the picture of {width} x {height}", key=key, value=box)
    # An object half in view may be boxed whole; more than a picture beyond is a box of another picture.
    if u0 < -width or v0 < -height or u1 > 2 * width or v1 > 2 * height:
        fix = "Is it in pixels of another size of the picture?"
        raise ImageError(
            f"box goes far beyond the picture of {width} x {height}", key=key, value=box, fix=fix
        )
    return box


def _checked_depth(depth, width: int, height: int) -> Float[np.ndarray, "h w"]:
    array = np.asarray(depth)
    if array.shape != (height, width):
        raise ImageError(f"must be ({height}, {width})", key="depth", value=array.shape)
    if array.dtype.kind not in "fiu":
        raise ImageError("must hold numbers", key="depth", value=str(array.dtype))
    array = np.where(np.isfinite(array), array, 0).astype(float)
    measured = array[array > 0]
    if measured.size and np.median(measured) > 50:
        raise ImageError(
            "looks like millimetres, not metres",
            key="depth",
            value=f"median {np.median(measured):.0f}",
            fix="Divide by 1000",
        )
    return array
