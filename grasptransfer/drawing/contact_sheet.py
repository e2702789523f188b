"""Portraits of objects in their own materials, and many of them on one sheet, each from a few sides."""

from collections.abc import Sequence

import numpy as np
import trimesh
from jaxtyping import Float, UInt8

from grasptransfer.camera import Camera
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.sheet import sheet
from grasptransfer.drawing.views import look_at

# (azimuth, elevation) in degrees: three-quarter view from the front, from the side.
VIEWS = ((40.0, 25.0), (90.0, 5.0))
GROUND = (196, 202, 208)
AWAY = 8.0  # distance of the camera in radii of the object: perspective then hardly shows


def portrait(
    scene: trimesh.Scene | trimesh.Trimesh,
    renderer: Renderer,
    side: int,
    *,
    view: tuple[float, float] = VIEWS[0],
    extent: float | None = None,
    ground: tuple[int, int, int] = GROUND,
) -> UInt8[np.ndarray, "side side 3"]:
    """A square picture of one upright object, its bounding box in the middle.

    Args:
        scene: object frame [m].
        side: width and height [px].
        view: azimuth about z from +x, and elevation [degrees].
        extent: what the width spans at the object's middle [m]; None fits the object.
        ground: colour behind it.
    """
    low, high = scene.bounds
    middle, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    camera_from_object = look_at(AWAY * radius, np.deg2rad(view[0]), np.deg2rad(view[1]))
    camera_from_object[:3, 3] -= camera_from_object[:3, :3] @ middle
    extent = extent or 1.08 * _seen_extent(scene, middle, camera_from_object)
    focal = side * AWAY * radius / extent
    camera = Camera(focal, focal, (side - 1) / 2, (side - 1) / 2, side, side)
    backdrop = np.broadcast_to(np.array(ground, np.uint8), (side, side, 3))
    return renderer.render(scene, camera, camera_from_object).over(backdrop)


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
        scenes: object frame, metres.
        views: azimuth about z from +x, and elevation [degrees].
        side: side of one picture [px].
    """
    pictures = [
        np.concatenate([portrait(scene, renderer, side, view=view) for view in views], axis=1)
        for scene in scenes
    ]
    return sheet(pictures, columns)


def _seen_extent(
    scene: trimesh.Scene | trimesh.Trimesh,
    middle: Float[np.ndarray, "3"],
    camera_from_object: Float[np.ndarray, "4 4"],
) -> float:
    """Width and height of what the camera sees of the object about its middle, the larger one [m]."""
    whole = scene if isinstance(scene, trimesh.Trimesh) else scene.to_mesh()
    vertices = np.asarray(whole.vertices)
    seen = (vertices - middle) @ camera_from_object[:2, :3].T
    return float(2 * np.abs(seen).max())
