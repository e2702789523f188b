"""Contact sheets: many shapes side by side, each from a few sides, as they are drawn for training."""

from collections.abc import Sequence

import numpy as np
import trimesh
from jaxtyping import Float, UInt8

from grasptransfer.camera import Camera
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.views import look_at

# (azimuth, elevation) in degrees: three-quarter view from the front, from the side.
VIEWS = ((40.0, 25.0), (90.0, 5.0))
GROUND = (196, 202, 208)
_FIELD_OF_VIEW = np.deg2rad(30)
_GAP = 4  # px between shapes


def contact_sheet(
    scenes: Sequence[trimesh.Scene | trimesh.Trimesh],
    renderer: Renderer,
    *,
    views: Sequence[tuple[float, float]] = VIEWS,
    columns: int = 5,
    side: int = 150,
) -> UInt8[np.ndarray, "h w 3"]:
    """Pictures of `scenes` in rows of `columns`, each shape as large as fits its cell.

    Args:
        scenes: object frame, metres, centred at the origin.
        views: azimuth about z from +x, and elevation [degrees].
        side: of one picture [px].
    """
    rows = -(-len(scenes) // columns)
    cell = len(views) * side + _GAP
    sheet = np.full((rows * (side + _GAP), columns * cell, 3), 255, np.uint8)
    for index, scene in enumerate(scenes):
        top, left = index // columns * (side + _GAP), index % columns * cell
        for place, view in enumerate(views):
            x = left + place * side
            sheet[top : top + side, x : x + side] = _picture(scene, renderer, view, side)
    return sheet


def _picture(
    scene: trimesh.Scene | trimesh.Trimesh, renderer: Renderer, view: tuple[float, float], side: int
) -> UInt8[np.ndarray, "h w 3"]:
    camera = Camera.from_fov(side, side, _FIELD_OF_VIEW)
    distance = _radius(scene) / np.sin(_FIELD_OF_VIEW / 2)
    pose = look_at(distance, np.deg2rad(view[0]), np.deg2rad(view[1]))
    ground = np.broadcast_to(np.array(GROUND, np.uint8), (side, side, 3))
    return renderer.render(scene, camera, pose).over(ground)


def _radius(scene: trimesh.Scene | trimesh.Trimesh) -> float:
    corners: Float[np.ndarray, "2 3"] = np.abs(scene.bounds)
    return float(np.linalg.norm(corners.max(0)))
