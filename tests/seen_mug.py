"""A mug that no training saw, on grey, seen from a known pose."""

import numpy as np

import grasptransfer as gt
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.views import look_at

CAMERA = gt.Camera.from_fov(320, 240, np.deg2rad(60))
POSE = look_at(0.4, 0.6, 0.6)


def see_mug(category):
    """RGB picture of the second test instance, and what was rendered: its mask and depth."""
    with Renderer() as renderer:
        seen = renderer.render(category.instance_scene(category.test[1]), CAMERA, POSE)
    return seen.over(np.full((CAMERA.height, CAMERA.width, 3), 120, np.uint8)), seen
