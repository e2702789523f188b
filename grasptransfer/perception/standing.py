"""An object that stands on a known plane: its lowest points lie on it.

The points are the corners of the face of its convex hull on which it rests: the largest flat part within
`STEEPEST` of facing the plane, or its lowest point where no part is flat. Their residuals are heights above
the plane, so the plane decides how far away the object is, and how it leans. All of them together count as
three measured by themselves, the fewest on which anything stands.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull

from grasptransfer.registration import DisplacementModel, motion_along

STEEPEST = np.deg2rad(20)  # between the plane and the face of the hull: given poses lean less
FLAT = np.deg2rad(3)  # triangles of the hull whose normals differ by less lie in one face
INDEPENDENT_CONTACTS = 3.0


@dataclass(frozen=True)
class Support:
    """A plane on which the object stands.

    Args:
        point: a point on the plane, camera frame [m].
        normal: unit, towards the object, camera frame.
        sigma: standard deviation of the height of a contact above the plane [m].
    """

    point: Float[np.ndarray, "3"]
    normal: Float[np.ndarray, "3"]
    sigma: float


@dataclass
class Standing:
    """The model's surface, and the plane on which it stands.

    Args:
        support: the plane, in the camera of the fit's first pose.
        points: (v, 3) canonical surface points [m].
        model: their displacement by the latent.
    """

    support: Support
    points: Float[np.ndarray, "v 3"]
    model: DisplacementModel
    _contacts: Int[np.ndarray, "p"] | None = None

    def search(self, pose: Float[np.ndarray, "4 4"], latent: Float[np.ndarray, "k"]) -> None:
        """Find the points on which the shape with this latent stands."""
        down = -pose[:3, :3].T @ self.support.normal
        self._contacts = contacts(self.model.displaced(self.points, latent), down)

    def quadratic(
        self, pose: Float[np.ndarray, "4 4"], latent: Float[np.ndarray, "k"]
    ) -> tuple[Float[np.ndarray, "s s"], Float[np.ndarray, "s"]]:
        """Hessian and gradient over turn, shift and latent."""
        if self._contacts is None:
            self.search(pose, latent)
        chosen, normal = self._contacts, self.support.normal
        model = self.model.take(chosen)
        turned = model.displaced(self.points[chosen], latent) @ pose[:3, :3].T
        height = (turned + pose[:3, 3] - self.support.point) @ normal
        jacobian = motion_along(np.tile(normal, (len(turned), 1)), turned, model.basis, pose[:3, :3])
        weight = INDEPENDENT_CONTACTS / len(turned) / self.support.sigma**2
        return weight * jacobian.T @ jacobian, weight * jacobian.T @ height


def contacts(points: Float[np.ndarray, "v 3"], down: Float[np.ndarray, "3"]) -> Int[np.ndarray, "p"]:
    """Indices of the points on which a body rests when `down` points towards the floor."""
    hull = ConvexHull(points)
    normals = hull.equations[:, :3]
    below = np.flatnonzero(normals @ down > np.cos(STEEPEST))
    if len(below) == 0:
        return np.array([int(np.argmax(points @ down))])
    corners = points[hull.simplices[below]]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    together = normals[below] @ normals[below].T > np.cos(FLAT)
    largest = int(np.argmax(together @ areas))
    return np.unique(hull.simplices[below[together[largest]]])
