"""Lights of a rendered picture."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Lighting:
    """Lights of a picture.

    Args:
        ambient: strength of the light from everywhere.
        directions_camera: (lights, 3) where each light comes from, camera frame.
        colours: (lights, 3) linear RGB times intensity of each directional light.
    """

    ambient: float = 0.35
    directions_camera: Float[np.ndarray, "lights 3"] = field(
        default_factory=lambda: np.array([[-0.4, -0.7, -0.6], [0.7, -0.2, -0.7]])
    )
    colours: Float[np.ndarray, "lights 3"] = field(
        default_factory=lambda: np.array([[2.6, 2.6, 2.5], [1.2, 1.2, 1.3]])
    )


def pose_shining_from(direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """A pose whose z axis points to where the light comes from (an OpenGL light shines along -z)."""
    z = direction / np.linalg.norm(direction)
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    return pose
