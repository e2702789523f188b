"""The same places of a category's surface on every instance: what moves with the shape, and only with it.

Points that are sampled anew on each reconstruction jump to other triangles when the shape changes by nothing
that anybody sees; places that are fixed on the canonical model move as its field does.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

if TYPE_CHECKING:
    import trimesh

SURFACE_POINTS = 3000  # about 4 mm apart on a mug: some ten under each pad
# Of the two-dimensional Kronecker sequence with the lowest discrepancy known: powers of the inverse of the
# plastic number. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018.
PLASTIC = 1.32471795724474602596


@dataclass(frozen=True)
class SurfacePlaces:
    """Places on the triangles of one topology.

    Args:
        faces: (m,) the triangle of each place.
        corners: (m, 3) barycentric coordinates in it.
        share: (m,) part of the triangle's area that the place stands for.
    """

    faces: Int[np.ndarray, "m"]
    corners: Float[np.ndarray, "m 3"]
    share: Float[np.ndarray, "m"]

    @staticmethod
    def spread(mesh: "trimesh.Trimesh", count: int) -> "SurfacePlaces":
        """Places that are spread evenly over a mesh, always the same ones."""
        areas = np.asarray(mesh.area_faces)
        total = np.cumsum(areas)
        number = np.arange(count)
        faces = np.searchsorted(total, (number + 0.5) / count * total[-1])
        u, v = (number[:, None] * np.array([1 / PLASTIC, 1 / PLASTIC**2]) % 1).T
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        corners = np.stack([1 - u - v, u, v], axis=1)
        return SurfacePlaces(faces, corners, total[-1] / count / areas[faces])

    def points(self, mesh: "trimesh.Trimesh") -> Float[np.ndarray, "m 3"]:
        """Where the places are on a mesh of this topology [m]."""
        return np.einsum("mc,mci->mi", self.corners, np.asarray(mesh.triangles[self.faces]))

    def normals(self, mesh: "trimesh.Trimesh") -> Float[np.ndarray, "m 3"]:
        """Unit normals of their triangles."""
        return np.asarray(mesh.face_normals[self.faces])

    def areas(self, mesh: "trimesh.Trimesh") -> Float[np.ndarray, "m"]:
        """Area of the surface that each place stands for [m2]."""
        return self.share * np.asarray(mesh.area_faces[self.faces])

    def of_corners(self, values: Float[np.ndarray, "v *k"], faces: Int[np.ndarray, "f 3"]) -> np.ndarray:
        """What the vertices' values are at the places, (m, *k)."""
        return np.einsum("mc,mc...->m...", self.corners, values[faces[self.faces]])
