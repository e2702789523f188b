"""What is known of the object in a photograph, and how predicted pixels meet it."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float
from PIL import Image

from grasptransfer.camera import Camera
from grasptransfer.category import Category
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import ImageError
from grasptransfer.meshes import load_mesh
from grasptransfer.perception.estimate import ShapeEstimate
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.reconstruction import reconstruct
from grasptransfer.perception.signs import overlap_of
from grasptransfer.workshop.benchmark.errors_of_shape import TRUE_POINTS, TrueSurface, outer_surface
from grasptransfer.workshop.benchmark.photo_files import Photo
from grasptransfer.workshop.benchmark.placed_boxes import PlacedTruth, summarise_placed


@dataclass(frozen=True)
class PhotoTruth:
    """What is known of the object in a photograph.

    Args:
        mesh: its own frame [m], or None.
        surface: surface of the mesh; None without mesh.
        silhouette: (h, w) pixels of its mesh at the true pose, hidden ones too; None without mesh.
        visible: (h, w) its visible pixels; None where no mask is on file.
        box: of the mesh; None without mesh.
    """

    mesh: trimesh.Trimesh | None
    surface: TrueSurface | None
    camera: Camera
    silhouette: np.ndarray | None
    visible: np.ndarray | None
    box: PlacedTruth | None

    @classmethod
    def of(cls, photo: Photo, folder: Path, seen: Observation, renderer: Renderer) -> "PhotoTruth":
        mesh, surface, silhouette, box = None, None, None, None
        if photo.mesh is not None:
            mesh, surface, box = _known_mesh(folder / photo.mesh)
            silhouette = renderer.depth(mesh, seen.camera, np.array(photo.camera_from_object)) > 0
        visible = None
        if photo.mask is not None:
            visible = np.asarray(open_picture(folder / photo.mask).convert("L")) > 127
        return cls(mesh, surface, seen.camera, silhouette, visible, box)

    def overlap(self, estimate: ShapeEstimate, category: Category, renderer: Renderer) -> float | None:
        """Of the predicted mask and what is visible; where that is unknown, of both whole silhouettes."""
        if self.visible is not None:
            return overlap(estimate.mask, self.visible)
        return overlap(silhouette_of(estimate, category, self.camera, renderer), self.silhouette)

    def placed(
        self,
        estimate: ShapeEstimate,
        category: Category,
        *,
        given: Observation,
        true_pose: Float[np.ndarray, "4 4"],
    ) -> dict[str, float]:
        """How well the object's box was placed, after refinement and before; nothing without mesh."""
        if self.box is None:
            return {}
        mesh = reconstruct(category, estimate.field, latent=estimate.latent)
        after = self.box.score(estimate.camera_from_object, np.asarray(mesh.bounds), true_pose)
        before = self.box.score(given.camera_from_object, np.asarray(category.canonical.bounds), true_pose)
        return summarise_placed([after]) | summarise_placed([before], "_before")


def overlap(mask: np.ndarray | None, true: np.ndarray | None) -> float | None:
    """Intersection over union."""
    if mask is None or true is None:
        return None
    return overlap_of(mask, true)


def silhouette_of(
    estimate: ShapeEstimate, category: Category, camera: Camera, renderer: Renderer
) -> np.ndarray:
    """(h, w) pixels of the whole reconstruction, hidden ones too."""
    mesh = reconstruct(category, estimate.field, latent=estimate.latent)
    return renderer.depth(mesh, camera, estimate.camera_from_object) > 0


@lru_cache(maxsize=8)
def _known_mesh(path: Path) -> tuple[trimesh.Trimesh, TrueSurface, PlacedTruth]:
    mesh = load_mesh(path)
    return mesh, TrueSurface(outer_surface(mesh, TRUE_POINTS)), PlacedTruth.of(mesh)


def open_picture(path: Path) -> Image.Image:
    try:
        return Image.open(path)
    except OSError as error:
        raise ImageError("cannot be read as a picture", path=path, fix=str(error)) from error
