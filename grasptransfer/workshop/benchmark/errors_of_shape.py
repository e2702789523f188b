"""How far a reconstruction is from the truth: the paper's E, RMS and chamfer distance."""

from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from grasptransfer.registration import DeformationField
from grasptransfer.registration.kernels import gaussian

CANONICAL_POINTS = 8000  # of the canonical model's outer surface, whose images are the reconstruction
TRUE_POINTS = 4000
KEPT_KERNELS = 4  # 40 MB each


@dataclass(frozen=True)
class ShapeError:
    """Errors of one reconstruction.

    Args:
        E: mean squared distance from each true point to the nearest reconstructed point [1e-6 m^2].
        rms_mm: square root of that mean [mm].
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
        low, high = (size, high) if len(_first_in_voxels(points, size)) > count else (low, size)
    return points[np.sort(_first_in_voxels(points, high))]


def _first_in_voxels(points: Float[np.ndarray, "m 3"], size: float) -> Int[np.ndarray, "c"]:
    """Index of the first point in each voxel that holds any."""
    cells = np.floor(points / size).astype(np.int64)
    cells -= cells.min(0)
    sides = cells.max(0) + 1
    # One number for each voxel: rows take fifteen times as long to sort.
    return np.unique((cells[:, 0] * sides[1] + cells[:, 1]) * sides[2] + cells[:, 2], return_index=True)[1]


class TrueSurface:
    """The true outer surface, to compare many reconstructions with.

    Args:
        points: (m, 3) points of the surface, object frame [m].
    """

    def __init__(self, points: Float[np.ndarray, "m 3"]):
        self.points = points
        self._tree = KDTree(points)

    def error(self, points: Float[np.ndarray, "p 3"]) -> ShapeError:
        """Compare with points of a reconstruction, same frame [m]."""
        to_model = KDTree(points).query(self.points)[0]
        to_truth = self._tree.query(points)[0]
        mean_squared = float(np.mean(to_model**2))
        chamfer = float(to_model.mean() + to_truth.mean()) / 2
        return ShapeError(mean_squared * 1e6, float(np.sqrt(mean_squared)) * 1e3, chamfer * 1e3)


def shape_error(true_points: Float[np.ndarray, "m 3"], points: Float[np.ndarray, "p 3"]) -> ShapeError:
    """Compare points of the true outer surface with points of the reconstruction, same frame [m]."""
    return TrueSurface(true_points).error(points)


class CanonicalSurface:
    """Points of the canonical model's outer surface, warped by one field after the other.

    The kernel between them and the control points is most of the work, and fields of one kind share it.
    """

    def __init__(self, points: Float[np.ndarray, "p 3"]):
        self.points = points
        self._kernels: dict[tuple, Float[np.ndarray, "p n"]] = {}

    def warped(self, field: DeformationField) -> Float[np.ndarray, "p 3"]:
        """`field(points)` [m]."""
        key = (field.beta, field.scale, field.centre.tobytes(), field.control_points.tobytes())
        if key not in self._kernels:
            normaliser = field.normaliser
            while len(self._kernels) >= KEPT_KERNELS:
                self._kernels.pop(next(iter(self._kernels)))
            self._kernels[key] = gaussian(
                normaliser(self.points), normaliser(field.control_points), field.beta
            )
        return self.points + field.scale * (self._kernels[key] @ field.weights)
