"""How far a reconstruction is from the truth: the paper's E, RMS and chamfer distance."""

from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import cKDTree

SURFACE_POINTS = 4000


@dataclass(frozen=True)
class ShapeError:
    """Errors of one reconstruction.

    Args:
        E: mean squared distance from each true point to the nearest reconstructed point [1e-6 m^2].
        rms_mm: its root [mm].
        chamfer_mm: mean distance from truth to reconstruction and back, averaged [mm].
    """

    E: float
    rms_mm: float
    chamfer_mm: float


def outer_surface(mesh: trimesh.Trimesh, count: int, *, seed: int = 0) -> Float[np.ndarray, "m 3"]:
    """About `count` points [m] of the surface that can be seen from somewhere outside, evenly spread.

    Rays come from far away on a sphere, many more than needed; a voxel filter evens them out.
    """
    rng = np.random.default_rng(seed)
    radius = float(np.linalg.norm(mesh.bounds, axis=1).max())
    centre = mesh.bounds.mean(0)
    directions = rng.normal(size=(12 * count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    targets = centre + rng.uniform(-1, 1, directions.shape) * (mesh.extents / 2)
    points, _, _ = mesh.ray.intersects_location(
        targets - 4 * radius * directions, directions, multiple_hits=False
    )
    low, high = 0.0, float(mesh.extents.max())
    for _ in range(25):  # bisect the voxel that leaves the wanted number of points
        size = (low + high) / 2
        cells = np.unique(np.floor(points / size).astype(int), axis=0)
        low, high = (size, high) if len(cells) > count else (low, size)
    _, first = np.unique(np.floor(points / high).astype(int), axis=0, return_index=True)
    return points[np.sort(first)]


def shape_error(true_points: Float[np.ndarray, "m 3"], points: Float[np.ndarray, "p 3"]) -> ShapeError:
    """Compare points of the true outer surface with points of the reconstruction, same frame [m]."""
    to_model = cKDTree(points).query(true_points)[0]
    to_truth = cKDTree(true_points).query(points)[0]
    mean_squared = float(np.mean(to_model**2))
    return ShapeError(
        mean_squared * 1e6, float(np.sqrt(mean_squared)) * 1e3, float(to_model.mean() + to_truth.mean()) * 500
    )
