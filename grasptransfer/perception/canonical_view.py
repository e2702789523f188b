"""The canonical model seen at the given pose: half of the network's input, and where its cells lie.

The model may be displaced by what is already known of the shape: the picture then shows the displaced
model, coloured by where its points lie on the undisplaced one.
"""

from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Float32, Int, UInt8

from grasptransfer.camera import Camera
from grasptransfer.drawing.visible import visible_faces
from grasptransfer.perception.networks import CELL_PIXEL, STRIDE


@dataclass(frozen=True)
class CanonicalView:
    """One view of the canonical model.

    Args:
        coordinates: (h, w, 3) position on the undisplaced model as a colour: 1 to 255 between the corners
            of its bounding box along x, y, z; 0 outside the model.
        cell_points: (c, 3) undisplaced positions [m] of the visible cells.
        cell_places: (c, 3) displaced positions [m].
        cell_faces: (c,) faces they lie on.
        cell_pixels: (c, 2) their zoomed pixels (u, v).
        cell_mask: (h / 8, w / 8) which cells are visible.
    """

    coordinates: UInt8[np.ndarray, "h w 3"]
    cell_points: Float[np.ndarray, "c 3"]
    cell_places: Float[np.ndarray, "c 3"]
    cell_faces: Int[np.ndarray, "c"]
    cell_pixels: Float[np.ndarray, "c 2"]
    cell_mask: Bool[np.ndarray, "hc wc"]


def view_canonical(
    mesh: trimesh.Trimesh,
    camera: Camera,
    camera_from_object: Float[np.ndarray, "4 4"],
    *,
    vertices: Float[np.ndarray, "v 3"] | None = None,
) -> CanonicalView:
    """See the canonical model `mesh` through the zoomed `camera` at the given pose.

    Args:
        vertices: displaced vertices [m]; None shows the model as it is.
    """
    rest = np.asarray(mesh.vertices)
    shown = rest if vertices is None else vertices
    seen = visible_faces(shown, np.asarray(mesh.faces), camera, camera_from_object)
    face, share, hit = seen.face, seen.share, seen.mask
    coordinates = np.zeros((camera.height, camera.width, 3), np.uint8)
    coordinates[hit] = _as_colours(_on_faces(rest, mesh.faces, face[hit], share[hit]), mesh.bounds)
    rows, columns = cell_centres(camera)
    cells = np.ix_(rows, columns)
    mask = hit[cells]
    v, u = np.nonzero(mask)
    faces, shares = face[cells][mask], share[cells][mask]
    return CanonicalView(
        coordinates,
        _on_faces(rest, mesh.faces, faces, shares),
        _on_faces(shown, mesh.faces, faces, shares),
        faces,
        np.stack([columns[u], rows[v]], -1).astype(float),
        mask,
    )


def cell_centres(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the zoomed pixels that the network's cells stand for."""
    return np.arange(CELL_PIXEL, camera.height, STRIDE), np.arange(CELL_PIXEL, camera.width, STRIDE)


def _on_faces(vertices, faces, chosen, shares) -> Float[np.ndarray, "p 3"]:
    return np.einsum("pc,pcd->pd", shares, np.asarray(vertices)[faces[chosen]])


def _as_colours(
    positions: Float[np.ndarray, "p 3"], bounds: Float[np.ndarray, "2 3"]
) -> Float32[np.ndarray, "p 3"]:
    share = (positions - bounds[0]) / (bounds[1] - bounds[0])
    return (1 + 254 * np.clip(share, 0, 1)).round().astype(np.float32)
