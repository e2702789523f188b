"""Boxes (u0, v0, u1, v1) in pixels, from pixel centre to pixel centre."""

import numpy as np
from jaxtyping import Float

from grasptransfer.camera import Camera
from grasptransfer.frames import transform_points

Box = tuple[float, float, float, float]


def projected_box(
    points_object: Float[np.ndarray, "m 3"], camera: Camera, camera_from_object: Float[np.ndarray, "4 4"]
) -> Box:
    """The box around the projection of `points_object` [m]."""
    pixels = camera.project(transform_points(camera_from_object, points_object))
    u0, v0 = pixels.min(0)
    u1, v1 = pixels.max(0)
    return float(u0), float(v0), float(u1), float(v1)


def union(a: Box, b: Box) -> Box:
    """The smallest box that holds both."""
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])


def overlap(a: Box, b: Box) -> float:
    """Intersection over union of two boxes; 0 where they do not meet."""
    width, height = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
    if width <= 0 or height <= 0:
        return 0.0
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (a, b)]
    return width * height / (sum(areas) - width * height)


def enlarge(box: Box, factor: float) -> Box:
    """The box about the same centre with sides `factor` times as long."""
    u, v = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
    half_u, half_v = (box[2] - box[0]) / 2 * factor, (box[3] - box[1]) / 2 * factor
    return u - half_u, v - half_v, u + half_u, v + half_v
