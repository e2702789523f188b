"""Where in a picture without a box an object of the category is: windows of several sizes, scored."""

import numpy as np
from jaxtyping import Float
from scipy.special import expit

from grasptransfer.camera import Camera
from grasptransfer.category import Category
from grasptransfer.drawing.boxes import Box, enlarge
from grasptransfer.drawing.views import look_at
from grasptransfer.errors import ImageError
from grasptransfer.perception.canonical_view import view_canonical
from grasptransfer.perception.network_input import NO_BOX_MARGIN, network_input
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.pose_search.grid import pose_in_box
from grasptransfer.perception.pose_search.one_member import OneMember
from grasptransfer.perception.pose_search.traits import around_mask
from grasptransfer.perception.zoom import zoom_box, zoom_camera, zoom_picture

SIZES = (0.7, 0.4, 0.22)  # of the object, shares of the picture's shorter side
STEP = 0.55  # between windows, in sizes of the object
TYPICAL = np.deg2rad((40.0, 25.0))  # azimuth and elevation from which the model stands in for the object
SHARPNESS = 20.0  # of a mask, against the logit of the match
EDGE = 0.03  # share of a window's sides: a mask nearer to its edge may be cut off


def find_box(network: OneMember, category: Category, observation: Observation) -> Box:
    """The box around what looks most like the category.

    Raises:
        ImageError: no window shows it.
    """
    windows = window_boxes(observation.camera)
    crops = [zoom_box(enlarge(window, NO_BOX_MARGIN)) for window in windows]
    prediction = network(_inputs(category, observation, windows, crops))
    masks = expit(prediction.mask_logit[:, 0])
    match = np.zeros(len(windows)) if prediction.match_logit is None else prediction.match_logit
    sure = np.abs(masks - 0.5).mean((1, 2))  # the mask of an object has sharp borders
    for index in np.argsort(-(match + SHARPNESS * sure)):
        box = around_mask(masks[index], crops[index])
        if box is not None and _whole(box, crops[index]):
            return box
    name = category.name.replace("_", " ")
    raise ImageError(f"shows no {name} that could be found", key="image", fix="Give a box around it")


def _inputs(category: Category, observation: Observation, windows: list[Box], crops: list[Box]):
    """Each window with the mean model in it, and no box."""
    rotation = look_at(1.0, *TYPICAL)[:3, :3]
    points = np.asarray(category.canonical.vertices)
    views = [
        view_canonical(
            category.canonical,
            zoom_camera(observation.camera, crop),
            pose_in_box(points, observation.camera, rotation, window),
        )
        for window, crop in zip(windows, crops, strict=True)
    ]
    pictures = np.stack([zoom_picture(observation.image, crop) for crop in crops])
    no_box = np.full((len(crops), 4), np.nan, np.float32)
    return network_input(pictures, no_box, np.stack([view.coordinates for view in views]))


def window_boxes(camera: Camera) -> list[Box]:
    """Boxes of several sizes all over a picture."""
    boxes = []
    for share in SIZES:
        side = share * min(camera.width, camera.height)
        for v in _places(camera.height, side):
            for u in _places(camera.width, side):
                boxes.append((u - side / 2, v - side / 2, u + side / 2, v + side / 2))
    return boxes


def _places(length: int, side: float) -> Float[np.ndarray, "p"]:
    free = max(length - side, 0.0)
    count = 1 + int(np.ceil(free / (STEP * side)))
    return (length - 1) / 2 + (np.linspace(-0.5, 0.5, count) * free if count > 1 else np.zeros(1))


def _whole(box: Box, crop: Box) -> bool:
    """Whether a mask's box lies within its window, not at its edge, where it may be cut off."""
    wide, high = EDGE * (crop[2] - crop[0]), EDGE * (crop[3] - crop[1])
    inner = crop[0] + wide, crop[1] + high, crop[2] - wide, crop[3] - high
    return box[0] > inner[0] and box[1] > inner[1] and box[2] < inner[2] and box[3] < inner[3]
