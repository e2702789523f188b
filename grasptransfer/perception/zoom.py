"""The zoom of the paper (section IV-B): one box that holds both objects, cut from the picture and resized."""

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8
from PIL import Image

from grasptransfer.camera import Camera
from grasptransfer.drawing.boxes import Box, projected_box

ZOOM_WIDTH, ZOOM_HEIGHT = 256, 192  # the network's input [px]
MASK_STRIDE = 4  # zoomed pixels to a cell of the network's mask
MARGIN = 1.15  # the box is this much larger than what it must hold


def centre_on_box(
    points_object: Float[np.ndarray, "m 3"],
    camera: Camera,
    camera_from_object: Float[np.ndarray, "4 4"],
    box: Box,
) -> Float[np.ndarray, "4 4"]:
    """The pose shifted across the view until the projection of `points_object` [m] has the box's centre."""
    pose = camera_from_object.copy()
    for _ in range(2):  # the second undoes what perspective left
        u0, v0, u1, v1 = projected_box(points_object, camera, pose)
        pose[0, 3] += ((box[0] + box[2]) - (u0 + u1)) / 2 * pose[2, 3] / camera.fx
        pose[1, 3] += ((box[1] + box[3]) - (v0 + v1)) / 2 * pose[2, 3] / camera.fy
    return pose


def zoom_box(box: Box) -> Box:
    """The box of the network's aspect ratio around `box`, with a margin."""
    u, v = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
    width = max(box[2] - box[0], (box[3] - box[1]) * ZOOM_WIDTH / ZOOM_HEIGHT, 8.0) * MARGIN
    height = width * ZOOM_HEIGHT / ZOOM_WIDTH
    return u - width / 2, v - height / 2, u + width / 2, v + height / 2


def zoom_camera(camera: Camera, box: Box) -> Camera:
    """The camera of the zoomed picture."""
    return camera.crop(box, ZOOM_WIDTH, ZOOM_HEIGHT)


def zoom_picture(image: UInt8[np.ndarray, "h w 3"], box: Box) -> UInt8[np.ndarray, "192 256 3"]:
    """Cut `box` out of the picture and resize it bilinearly (antialiased where it shrinks).

    What lies outside the picture repeats its border.
    """
    u0, v0, u1, v1 = (value + 0.5 for value in box)  # from pixel centres to outer edges
    height, width = image.shape[:2]
    left, top = max(0, int(np.ceil(-u0))), max(0, int(np.ceil(-v0)))
    right, bottom = max(0, int(np.ceil(u1 - width))), max(0, int(np.ceil(v1 - height)))
    if left or top or right or bottom:
        image = np.pad(image, ((top, bottom), (left, right), (0, 0)), mode="edge")
    corners = (u0 + left, v0 + top, u1 + left, v1 + top)
    size = (ZOOM_WIDTH, ZOOM_HEIGHT)
    return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BILINEAR, box=corners))


def zoom_mask(mask: Bool[np.ndarray, "h w"], box: Box) -> Float32[np.ndarray, "48 64"]:
    """The share of each mask cell of the zoomed picture that `mask` covers."""
    picture = zoom_picture(np.repeat(mask[..., None].astype(np.uint8) * 255, 3, axis=2), box)[..., 0]
    return mask_cells(picture.astype(np.float32) / 255)


def mask_cells(mask: Float32[np.ndarray, "192 256"]) -> Float32[np.ndarray, "48 64"]:
    """Mean of a zoomed mask over each cell of the network's."""
    return mask.reshape(ZOOM_HEIGHT // MASK_STRIDE, MASK_STRIDE, -1, MASK_STRIDE).mean((1, 3))


def whole_mask(
    probability: Float[np.ndarray, "hm wm"], zoomed: Camera, camera: Camera
) -> Bool[np.ndarray, "h w"]:
    """The cells of a zoomed picture that rather show the object, put back into the whole picture.

    Args:
        probability: probability of each cell.
        zoomed: camera of the zoomed picture.
        camera: camera of the whole picture.
    """
    scale_u, scale_v = zoomed.fx / camera.fx, zoomed.fy / camera.fy
    left = camera.cx - (zoomed.cx + 0.5) / scale_u
    top = camera.cy - (zoomed.cy + 0.5) / scale_v
    # PIL's affine map takes output pixel corners to input pixel corners.
    step_u, step_v = scale_u / MASK_STRIDE, scale_v / MASK_STRIDE
    matrix = (step_u, 0, -(left + 0.5) * step_u, 0, step_v, -(top + 0.5) * step_v)
    whole = Image.fromarray(probability.astype(np.float32)).transform(
        (camera.width, camera.height), Image.Transform.AFFINE, matrix, Image.Resampling.BILINEAR, fillcolor=0
    )
    return np.asarray(whole) > 0.5
