"""The canonical model seen at the given pose: half of the network's input, and where its cells lie."""

from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Float32, UInt8

from grasptransfer.camera import Camera
from grasptransfer.perception.networks import CELL_PIXEL, STRIDE
from grasptransfer.perception.rendering import Renderer, position_image


@dataclass(frozen=True)
class CanonicalView:
    """One view of the canonical model.

    Args:
        coordinates: (h, w, 3) position on the model as a colour: 1 to 255 between the corners of its
            bounding box along x, y, z; 0 outside the model.
        cell_points: (c, 3) canonical positions [m] of the visible cells.
        cell_pixels: (c, 2) their zoomed pixels (u, v).
        cell_mask: (h / 8, w / 8) which cells are visible.
    """

    coordinates: UInt8[np.ndarray, "h w 3"]
    cell_points: Float[np.ndarray, "c 3"]
    cell_pixels: Float[np.ndarray, "c 2"]
    cell_mask: Bool[np.ndarray, "hc wc"]


def view_canonical(
    mesh: trimesh.Trimesh | trimesh.Scene,
    camera: Camera,
    camera_from_object: Float[np.ndarray, "4 4"],
    *,
    renderer: Renderer,
) -> CanonicalView:
    """See the canonical model `mesh` through the zoomed `camera` at the given pose."""
    depth = renderer.depth(mesh, camera, camera_from_object)
    positions = position_image(depth, camera, camera_from_object)
    rows, columns = cell_centres(camera)
    cells = positions[np.ix_(rows, columns)]
    mask = np.isfinite(cells).all(-1)
    v, u = np.nonzero(mask)
    pixels = np.stack([columns[u], rows[v]], -1).astype(float)
    return CanonicalView(_as_colours(positions, mesh.bounds), cells[mask].astype(float), pixels, mask)


def cell_centres(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the zoomed pixels that the network's cells stand for."""
    return np.arange(CELL_PIXEL, camera.height, STRIDE), np.arange(CELL_PIXEL, camera.width, STRIDE)


def _as_colours(
    positions: Float32[np.ndarray, "h w 3"], bounds: Float[np.ndarray, "2 3"]
) -> UInt8[np.ndarray, "h w 3"]:
    share = (positions - bounds[0]) / (bounds[1] - bounds[0])
    return np.nan_to_num(1 + 254 * np.clip(share, 0, 1), nan=0).round().astype(np.uint8)
