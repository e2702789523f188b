"""Viewpoints: the 74 of the paper, others by their angles, and the turn towards a point."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

RINGS, MERIDIANS = 6, 12
VIEWPOINTS = RINGS * MERIDIANS + 2  # with the two poles: 74 vertices of a tessellated sphere


def sphere_views(distance: float) -> Float[np.ndarray, "74 4 4"]:
    """`camera_from_object` of 74 cameras on a tessellated sphere that look at the object's origin.

    Args:
        distance: distance from the camera to the origin [m].
    """
    elevations = np.linspace(-np.pi / 2, np.pi / 2, RINGS + 2)[1:-1]
    azimuths = np.arange(MERIDIANS) * (2 * np.pi / MERIDIANS)
    views = [look_at(distance, 0.0, -np.pi / 2), look_at(distance, 0.0, np.pi / 2)]
    views[1:1] = [look_at(distance, azimuth, elevation) for elevation in elevations for azimuth in azimuths]
    return np.stack(views)


def look_at(
    distance: float, azimuth: float, elevation: float, *, roll: float = 0.0
) -> Float[np.ndarray, "4 4"]:
    """`camera_from_object` of a camera that looks at the object's origin, the object upright in it.

    Args:
        distance: distance from camera to origin [m].
        azimuth: azimuth of the camera about the object's z axis, 0 in front (+x) [rad].
        elevation: elevation of the camera above the object's xy plane [rad].
        roll: turn of the picture about the optical axis [rad].
    """
    to_camera = np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    rotation = np.stack([right, np.cross(-to_camera, right), -to_camera])
    turn = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    camera_from_object = np.eye(4)
    camera_from_object[:3, :3] = turn @ rotation
    camera_from_object[2, 3] = distance
    return camera_from_object


def towards(point: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The least rotation that takes the optical axis to the ray through `point`."""
    return Rotation.align_vectors([point / np.linalg.norm(point)], [[0.0, 0.0, 1.0]])[0].as_matrix()
