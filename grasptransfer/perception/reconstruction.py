"""The whole instance as a mesh, its hidden side too, from the field of its shape estimate."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    import trimesh

    from grasptransfer.category import Category
    from grasptransfer.registration import DeformationField


def reconstruct(
    category: Category, field: DeformationField, *, latent: Float[np.ndarray, " k"] | None = None
) -> trimesh.Trimesh:
    """The canonical mesh warped by a field, object frame [m] (paper, eq. 6).

    Args:
        category: the category whose canonical mesh is warped.
        field: the field of the instance.
        latent: latent of a field of the category's shape space. Where it is given, the vertices are moved by
            the space's own displacements of them, which is quicker than the field and gives the same.
    """
    mesh = category.canonical.copy()
    vertices = np.asarray(mesh.vertices)
    model = category.vertices_by_latent
    mesh.vertices = field(vertices) if latent is None else model.displaced(vertices, latent)
    return mesh
