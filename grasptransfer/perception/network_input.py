"""What a network sees of a picture, and the axes in which it answers: the same in training and later."""

import numpy as np
from jaxtyping import Float, Float32, UInt8

from grasptransfer.drawing.boxes import Box, enlarge, union
from grasptransfer.drawing.views import towards
from grasptransfer.perception.zoom import ZOOM_HEIGHT, ZOOM_WIDTH, zoom_box

NO_BOX_MARGIN = 1.3  # without a detection the canonical's own box, this much larger, is searched


def network_input(
    observed: UInt8[np.ndarray, "b 192 256 3"],
    boxes: Float32[np.ndarray, "b 4"],
    coordinates: UInt8[np.ndarray, "b 192 256 3"],
) -> Float32[np.ndarray, "b 8 192 256"]:
    """Stack what the network sees: observed RGB and box, canonical coordinates and mask, each in [-1, 1].

    Args:
        boxes: (u0, v0, u1, v1) in zoomed pixels; NaN where no box is told (the mask is then 0 everywhere).
    """
    v, u = np.arange(ZOOM_HEIGHT)[:, None], np.arange(ZOOM_WIDTH)[None]
    u0, v0, u1, v1 = (boxes[:, i, None, None] for i in range(4))
    stacked = np.empty((*observed.shape[:3], 8), np.uint8)
    stacked[..., :3], stacked[..., 4:7] = observed, coordinates
    # Comparisons with NaN are false: an untold box gives an empty mask.
    stacked[..., 3] = 255 * ((u >= u0) & (u <= u1) & (v >= v0) & (v <= v1))
    stacked[..., 7] = 255 * ((coordinates[..., 0] | coordinates[..., 1] | coordinates[..., 2]) > 0)
    values = stacked.astype(np.float32)
    values /= 127.5
    values -= 1
    return values.transpose(0, 3, 1, 2)  # channels last in memory, as networks want it


def view_from_object(camera_from_object: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "3 3"]:
    """Rotation from object axes to view axes: z along the ray to the object's origin, x right, y down.

    In view axes an offset's first two components are what moves in the picture, wherever in it the
    object is: far easier to learn than object axes, and the given pose turns them back exactly.
    """
    return towards(camera_from_object[:3, 3]).T @ camera_from_object[:3, :3]


def zoom_for(model_box: Box, box: Box | None) -> tuple[Box, Float32[np.ndarray, "4"]]:
    """The zoom's box in the whole picture, and the told box in zoomed pixels (NaN: none told).

    Args:
        model_box: around the model at the given pose.
        box: around the object; None searches around the model.
    """
    if box is None:
        return zoom_box(enlarge(model_box, NO_BOX_MARGIN)), np.full(4, np.nan, np.float32)
    crop = zoom_box(union(model_box, box))
    scale = ZOOM_WIDTH / (crop[2] - crop[0])
    told = (np.array(box) - [crop[0], crop[1], crop[0], crop[1]]) * scale - 0.5
    return crop, told.astype(np.float32)
