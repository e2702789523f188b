"""Small pictures of point clouds, from where `drawing.contact_sheet.portrait` draws objects."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw

from grasptransfer.drawing.contact_sheet import VIEWS
from grasptransfer.drawing.views import look_at


def scatter(
    clouds: Sequence[tuple[Float[np.ndarray, "_ 3"], tuple[int, int, int]]], side: int, *, extent: float
) -> UInt8[np.ndarray, "side side 3"]:
    """Point clouds in their colours on white, the nearer points larger and on top.

    Args:
        clouds: pairs of the points [m] of a cloud about the origin, and its colour (sRGB).
        side: width and height [px].
        extent: what the width of the picture spans [m].
    """
    azimuth, elevation = np.deg2rad(VIEWS[0])
    right_down_away = look_at(1.0, azimuth, elevation)[:3, :3]
    points = np.concatenate([cloud for cloud, _ in clouds]) @ right_down_away.T
    colours = np.concatenate([np.tile(colour, (len(cloud), 1)) for cloud, colour in clouds])
    image = Image.new("RGB", (2 * side, 2 * side), "white")
    draw = ImageDraw.Draw(image)
    for index in np.argsort(-points[:, 2], kind="stable"):
        u, v = side * (1 + 2 * points[index, :2] / extent)
        size = side / 75 * (1 - 0.5 * np.clip(2 * points[index, 2] / extent, -1, 1))
        draw.ellipse((u - size, v - size, u + size, v + size), fill=tuple(int(c) for c in colours[index]))
    return np.asarray(image.resize((side, side), Image.Resampling.BOX))
