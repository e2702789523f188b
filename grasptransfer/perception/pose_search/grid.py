"""Views of an object that stands upright before a level camera, and the pose of each that fills a box."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.camera import Camera
from grasptransfer.drawing.boxes import Box, projected_box
from grasptransfer.drawing.views import look_at, towards
from grasptransfer.errors import PoseError
from grasptransfer.frames import rigid
from grasptransfer.perception.zoom import centre_on_box

# The networks were trained with poses turned by up to 10 degrees (`training/scenes.py: WIDE_NOISE`): no view
# is farther than that in azimuth from one of these, nor in elevation.
AZIMUTHS = 18
HEADINGS = 24  # on a table, where elevation and roll are known
ELEVATIONS = (5, 22, 40, 58, 76)  # degrees, of the camera above the object


def view_rotations() -> Float[np.ndarray, "c 3 3"]:
    """Of each view: from object axes to those of a camera that looks at the object."""
    azimuths = np.arange(AZIMUTHS) * (2 * np.pi / AZIMUTHS)
    views = [look_at(1.0, azimuth, np.deg2rad(height)) for height in ELEVATIONS for azimuth in azimuths]
    return np.stack(views)[:, :3, :3]


def pose_in_box(
    points_object: Float[np.ndarray, "m 3"],
    camera: Camera,
    rotation: Float[np.ndarray, "3 3"],
    box: Box,
) -> Float[np.ndarray, "4 4"]:
    """The pose at which the projection of `points_object` [m] has the box's middle and its area.

    Args:
        rotation: rotation from object axes to those of a camera that looks at the box's middle.
    """
    pixel = np.array([box[0] + box[2], box[1] + box[3]]) / 2
    ray = camera.unproject(pixel, np.array(1.0))
    pose = np.eye(4)
    pose[:3, :3] = towards(ray) @ rotation
    farthest = float(np.linalg.norm(points_object, axis=1).max())
    pose[:3, 3] = ray * 10 * farthest
    for _ in range(4):
        pose[:3, 3] *= np.sqrt(_area(projected_box(points_object, camera, pose)) / _area(box))
        pose[:3, 3] *= max(1.0, 1.5 * farthest / pose[2, 3])  # all of the model stays before the camera
        pose = centre_on_box(points_object, camera, pose, box)
    return pose


def poses_on_table(
    points_object: Float[np.ndarray, "m 3"],
    camera: Camera,
    camera_from_table: Float[np.ndarray, "4 4"],
    box: Box,
) -> Float[np.ndarray, "c 4 4"]:
    """Poses of every heading at which the model stands on a table, its middle on the ray of the box's middle.

    Args:
        camera_from_table: z up from the table [m].

    Raises:
        PoseError: the ray does not meet the table from above.
    """
    up, point = camera_from_table[:3, 2], camera_from_table[:3, 3]
    ray = camera.unproject(np.array([box[0] + box[2], box[1] + box[3]]) / 2, np.array(1.0))
    height = -float(points_object[:, 2].min())  # of the model's origin above the table
    distance = float((point @ up + height) / (ray @ up)) if abs(ray @ up) > 1e-6 else -1.0
    if distance <= 0 or point @ up >= 0:
        raise PoseError("does not lie below the camera in the box's direction", key="camera_from_table")
    poses = []
    for heading in np.arange(HEADINGS) * (2 * np.pi / HEADINGS):
        turn = Rotation.from_rotvec([0.0, 0.0, heading]).as_matrix()
        poses.append(rigid(camera_from_table[:3, :3] @ turn, ray * distance))
    return np.stack(poses)


def misfit(points_object: Float[np.ndarray, "m 3"], camera: Camera, pose, box: Box) -> float:
    """Logarithm of how much more slender or squat the projection is than the box."""
    found = projected_box(points_object, camera, pose)
    return abs(float(np.log(_slenderness(found) / _slenderness(box))))


def _area(box: Box) -> float:
    return max((box[2] - box[0]) * (box[3] - box[1]), 1.0)


def _slenderness(box: Box) -> float:
    return max(box[3] - box[1], 1.0) / max(box[2] - box[0], 1.0)
