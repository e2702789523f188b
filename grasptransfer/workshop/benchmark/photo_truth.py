"""What is known of the object in a photograph, and how predicted pixels meet it."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from grasptransfer.camera import Camera
from grasptransfer.category import Category
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import ImageError
from grasptransfer.meshes import load_mesh
from grasptransfer.perception.estimate import ShapeEstimate
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.reconstruction import reconstruct
from grasptransfer.workshop.benchmark.errors_of_shape import TRUE_POINTS, TrueSurface, outer_surface
from grasptransfer.workshop.benchmark.photo_files import Photo


@dataclass(frozen=True)
class PhotoTruth:
    """What is known of the object in a photograph.

    Args:
        mesh: its own frame [m], or None.
        surface: surface of the mesh; None without mesh.
        silhouette: (h, w) pixels of its mesh at the true pose, hidden ones too; None without mesh.
        visible: (h, w) its visible pixels; None where no mask is on file.
    """

    mesh: trimesh.Trimesh | None
    surface: TrueSurface | None
    camera: Camera
    silhouette: np.ndarray | None
    visible: np.ndarray | None

    @classmethod
    def of(cls, photo: Photo, folder: Path, seen: Observation, renderer: Renderer) -> "PhotoTruth":
        mesh, surface, silhouette = None, None, None
        if photo.mesh is not None:
            mesh, surface = _known_mesh(folder / photo.mesh)
            silhouette = renderer.depth(mesh, seen.camera, np.array(photo.camera_from_object)) > 0
        visible = None
        if photo.mask is not None:
            visible = np.asarray(open_picture(folder / photo.mask).convert("L")) > 127
        return cls(mesh, surface, seen.camera, silhouette, visible)

    def overlap(self, estimate: ShapeEstimate, category: Category, renderer: Renderer) -> float | None:
        """Of the predicted mask and what is visible; where that is unknown, of both whole silhouettes."""
        if self.visible is not None:
            return overlap(estimate.mask, self.visible)
        return overlap(silhouette_of(estimate, category, self.camera, renderer), self.silhouette)


def overlap(mask: np.ndarray | None, true: np.ndarray | None) -> float | None:
    """Intersection over union."""
    if mask is None or true is None:
        return None
    return float((mask & true).sum() / max((mask | true).sum(), 1))


def silhouette_of(
    estimate: ShapeEstimate, category: Category, camera: Camera, renderer: Renderer
) -> np.ndarray:
    """(h, w) pixels of the whole reconstruction, hidden ones too."""
    mesh = reconstruct(category, estimate.field, latent=estimate.latent)
    return renderer.depth(mesh, camera, estimate.camera_from_object) > 0


@lru_cache(maxsize=8)
def _known_mesh(path: Path) -> tuple[trimesh.Trimesh, TrueSurface]:
    mesh = load_mesh(path)
    return mesh, TrueSurface(outer_surface(mesh, TRUE_POINTS))


def open_picture(path: Path) -> Image.Image:
    try:
        return Image.open(path)
    except OSError as error:
        raise ImageError("cannot be read as a picture", path=path, fix=str(error)) from error
