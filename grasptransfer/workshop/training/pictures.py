"""Pictures of objects as a robot may see them, for fitting what a trained network's answers are worth."""

import numpy as np
import trimesh
from jaxtyping import Bool, Float

from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.views import towards
from grasptransfer.workshop.training.backgrounds import draw_backdrop
from grasptransfer.workshop.training.random_objects import draw_random_object
from grasptransfer.workshop.training.scenes import draw_camera, draw_lighting, draw_pose
from grasptransfer.workshop.training.wrong_inputs import Pictured

OCCLUDED = 0.25  # share of the pictures
HIDDEN = (0.02, 0.35)  # share of the object that an occluder may hide


def radius_of(bounds) -> float:
    """Radius of a sphere about the origin that holds the bounding box [m]."""
    return float(np.linalg.norm(np.abs(bounds).max(0)))


def picture_of(
    scene: trimesh.Scene | trimesh.Trimesh,
    points_object: Float[np.ndarray, "m 3"],
    renderer: Renderer,
    rng: np.random.Generator,
    *,
    least: float,
) -> Pictured:
    """A random picture of an object; sometimes another object stands before it.

    Args:
        scene: the object, about the origin [m].
        points_object: on its surface [m].
        renderer: draws the picture.
        rng: where camera, pose, lights and background are drawn from.
        least: radius of the category's model, which has to lie before the camera, too [m].
    """
    radius = max(radius_of(scene.bounds), least)
    camera = draw_camera(rng)
    pose = draw_pose(camera, radius, rng)
    picture = renderer.render(scene, camera, pose, lighting=draw_lighting(rng))
    pixels = picture.over(draw_backdrop(rng, camera.width, camera.height))
    if rng.random() < OCCLUDED:
        pixels = _occluded(pixels, picture.mask, camera, pose, radius, renderer, rng)
    return Pictured.of(pixels, camera, pose, points_object)


def _occluded(
    pixels, mask: Bool[np.ndarray, "h w"], camera, pose, radius: float, renderer: Renderer, rng
) -> np.ndarray:
    """The picture with an occluder before the object's rim, unless it would hide too much or nothing."""
    thing = draw_random_object(rng)
    nearer = pose.copy()
    nearer[:3, 3] *= 0.75
    nearer[:2, 3] += rng.uniform(-radius, radius, 2)
    nearer[:3, :3] = towards(nearer[:3, 3])
    front = renderer.render(thing, camera, nearer, lighting=draw_lighting(rng))
    hidden = (front.mask & mask).sum() / max(mask.sum(), 1)
    return front.over(pixels) if HIDDEN[0] < hidden < HIDDEN[1] else pixels
