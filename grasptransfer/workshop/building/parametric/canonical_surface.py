"""Points of a canonical model that are found again on every sample of its category."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from grasptransfer.workshop.building.surface_points import visible_surface, voxel_filter, voxel_for
from grasptransfer.workshop.objects.correspondence import locator
from grasptransfer.workshop.objects.shape import ParametricObject

CONTROL_POINTS, SURFACE_POINTS = 650, 3000


@dataclass(frozen=True)
class CanonicalPoints:
    """Points of a canonical model that can be found again on every sample.

    Args:
        model: the canonical shape.
        points: (m, 3) seen from outside [m].
        control_points: (n, 3) fewer of them [m].
        voxel: edge of the voxel filter of the control points [m].
        face, barycentric: (m,) and (m, 3) where the points lie on the model.
    """

    model: ParametricObject
    points: Float[np.ndarray, "m 3"]
    control_points: Float[np.ndarray, "n 3"]
    voxel: float
    face: Int[np.ndarray, "m"]
    barycentric: Float[np.ndarray, "m 3"]

    def on(self, shape: ParametricObject) -> Float[np.ndarray, "m 3"]:
        """The same points on a sample [m]."""
        return np.einsum("mc,mcd->md", self.barycentric, shape.vertices[self.model.faces[self.face]])

    def displacements(self, shape: ParametricObject) -> Float[np.ndarray, "m 3"]:
        """How far the points move to a sample [m]."""
        return self.on(shape) - self.points


def surface_of(model: ParametricObject) -> CanonicalPoints:
    """Points and control points of a canonical shape: ray casting, then voxel filters."""
    points, faces = visible_surface(model.mesh())
    points = points[model.corresponds[model.faces[faces]].all(1)]
    dense = points[voxel_filter(points, voxel_for(points, SURFACE_POINTS))]
    voxel = voxel_for(points, CONTROL_POINTS)
    face, barycentric, _ = locator(model).locate(dense)
    return CanonicalPoints(model, dense, points[voxel_filter(points, voxel)], voxel, face, barycentric)
