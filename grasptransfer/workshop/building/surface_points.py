"""Point clouds of surfaces: rays from a tessellated sphere, then a voxel filter (section III-A).

Only what can be seen from outside is hit: the inside of a mug, but not the inside of a closed shell.
"""

import numpy as np
import trimesh
from jaxtyping import Float, Int

from grasptransfer.errors import MeshError

SPHERE_SUBDIVISIONS = 2  # 162 viewpoints
RAYS_ACROSS = 48  # rays along each side of a viewpoint's square grid
VOXEL_TOLERANCE = 0.02  # The number of points may differ from the wanted one by this share.


def visible_surface(
    mesh: trimesh.Trimesh,
) -> tuple[Float[np.ndarray, "m 3"], Int[np.ndarray, "m"]]:
    """Points where parallel rays from every vertex of a sphere around the mesh first meet it.

    Args:
        mesh: any frame, any unit.

    Returns:
        points: (m, 3) in the frame and unit of the mesh.
        faces: (m,) face of each point.

    Raises:
        MeshError: no ray meets the mesh.
    """
    centre, radius = mesh.bounds.mean(0), float(np.linalg.norm(mesh.extents)) / 2
    if not radius > 0:
        raise MeshError("has no extent")
    # embree works in single precision: rays are cast at an object of unit size.
    unit = trimesh.Trimesh((mesh.vertices - centre) / radius, mesh.faces, process=False)
    corners = unit.triangles
    across = (np.arange(RAYS_ACROSS) + 0.5) * (2 / RAYS_ACROSS) - 1
    grid = np.stack(np.meshgrid(across, across, indexing="ij"), -1).reshape(-1, 2)
    grid = grid[(grid**2).sum(1) < 1]
    points, faces = [], []
    for direction in trimesh.creation.icosphere(subdivisions=SPHERE_SUBDIVISIONS).vertices:
        origins = 1.5 * direction + grid @ _plane_across(direction)
        directions = np.broadcast_to(-direction, origins.shape)
        hit = unit.ray.intersects_first(origins, directions)
        rows = np.flatnonzero(hit >= 0)
        places, inside = _on_planes(corners[hit[rows]], origins[rows], directions[rows])
        points.append(places[inside])
        faces.append(hit[rows][inside])
    points, faces = np.concatenate(points), np.concatenate(faces)
    if not len(points):
        raise MeshError("no ray from outside meets the mesh")
    return points * radius + centre, faces


def voxel_filter(points: Float[np.ndarray, "m 3"], voxel: float) -> Int[np.ndarray, "n"]:
    """Indices of one point for each occupied voxel: the one nearest to the mean of the voxel's points.

    Args:
        points: (m, 3) [m].
        voxel: edge of a voxel [m].
    """
    cells = np.floor((points - points.min(0)) / voxel).astype(np.int64)
    sizes = cells.max(0) + 1
    numbers = (cells[:, 0] * sizes[1] + cells[:, 1]) * sizes[2] + cells[:, 2]
    _, cell, count = np.unique(numbers, return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(cell, points[:, i]) for i in range(3)], -1) / count[:, None]
    distance = np.linalg.norm(points - means[cell], axis=1)
    order = np.lexsort((distance, cell))
    return order[np.concatenate([[0], np.cumsum(count)[:-1]])]


def voxel_for(points: Float[np.ndarray, "m 3"], count: int) -> float:
    """Edge of the voxels [m] that leave about `count` points."""
    low, high = 0.0, float(np.ptp(points, axis=0).max())
    # A surface: the number of voxels goes with the square of their size. From there, halve.
    voxel = high / np.sqrt(count)
    for _ in range(40):
        left = len(voxel_filter(points, voxel))
        if abs(left - count) <= VOXEL_TOLERANCE * count:
            break
        low, high = (voxel, high) if left > count else (low, voxel)
        guess = voxel * np.sqrt(left / count)
        voxel = guess if low < guess < high else (low + high) / 2
    return voxel


def _plane_across(direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2 3"]:
    """Two unit vectors across `direction` and each other."""
    axis = np.eye(3)[np.abs(direction).argmin()]
    first = np.cross(direction, axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])


def _on_planes(corners, origins, directions):
    """Where rays meet the planes of their triangles, and which of them do so inside the object."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    slope = (normals * directions).sum(1)
    # A ray that grazes its triangle says little about where it is.
    steep = np.abs(slope) > 1e-3 * np.linalg.norm(normals, axis=1)
    distance = (normals * (corners[:, 0] - origins)).sum(1) / np.where(steep, slope, 1.0)
    return origins + distance[:, None] * directions, steep & (distance > 0) & (distance < 3)
