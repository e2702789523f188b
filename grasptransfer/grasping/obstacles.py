"""Obstacles as meshes or clouds of points, and the cloud that a depth picture shows.

A cloud becomes small boxes, one in each cell of a grid that holds a point, so that it is met like any mesh.
It says where something is, never what is free behind it. What lies on the object is the object's: a cloud
need not be cut out, where the reconstruction is right to within `OWN`.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float

from grasptransfer.camera import Camera
from grasptransfer.errors import SceneError, in_millimetres
from grasptransfer.frames import check_rigid, transform_points
from grasptransfer.grasping.surface import LARGEST_EXTENT

if TYPE_CHECKING:
    import trimesh

Obstacle = tuple[str, "trimesh.Trimesh | trimesh.PointCloud", np.ndarray]
CELL = 0.006  # m: less than half a finger's thickness
NEARBY = 0.35  # m around the object's origin: no gripper of a table robot is larger
OWN = 0.015  # m from the reconstruction: its own usual error, and some of a depth camera's


def checked_obstacle(given: object) -> Obstacle:
    """Name, mesh or cloud, and pose of an obstacle.

    Raises:
        SceneError: something else, nothing in it, or not in metres.
        PoseError: its pose is not rigid.
    """
    import trimesh

    if not isinstance(given, list | tuple) or len(given) != 3 or not isinstance(given[0], str):
        fix = "Give (name, mesh, camera_from_obstacle)"
        raise SceneError("is no obstacle", key="obstacles", value=type(given).__name__, fix=fix)
    name, shape, pose = given
    key = f"obstacles.{name}"
    if isinstance(shape, trimesh.Scene):
        shape = shape.to_mesh()
    if isinstance(shape, np.ndarray) and shape.ndim == 2 and shape.shape[1] == 3 and len(shape):
        shape = trimesh.PointCloud(shape.astype(float))
    if not isinstance(shape, trimesh.Trimesh | trimesh.PointCloud):
        choices = ("a trimesh mesh", "a cloud", "points (m, 3)")
        raise SceneError("must be a mesh or a cloud", key=key, value=type(shape).__name__, choices=choices)
    points = np.asarray(shape.vertices)
    if not len(points) or (isinstance(shape, trimesh.Trimesh) and not len(shape.faces)):
        raise SceneError("is empty", key=key, value=shape)
    if not np.isfinite(points).all():
        raise SceneError("has points that are NaN or infinite", key=key)
    size = float(np.ptp(points, axis=0).max())
    if size > LARGEST_EXTENT:
        raise in_millimetres(SceneError, key=key, value=f"{size:g} long")
    return name, shape, check_rigid(pose, f"{key}.camera_from_obstacle")


def cells_of(
    points: Float[np.ndarray, "m 3"], own: Float[np.ndarray, "n 3"], *, cell: float = CELL
) -> "trimesh.Trimesh | None":
    """Boxes where a cloud's points are, near the object and not on it; None where there are none.

    Args:
        points: of the cloud, object frame [m].
        own: of the object's surface [m].
        cell: edge of the boxes [m].
    """
    import trimesh
    from scipy.spatial import KDTree

    points = points[np.linalg.norm(points, axis=1) < NEARBY]
    middles = (np.unique(np.floor(points / cell).astype(int), axis=0) + 0.5) * cell
    if len(middles):
        middles = middles[KDTree(own).query(middles)[0] > OWN]
    if not len(middles):
        return None
    # A little smaller than the cells, so that no two boxes share a corner, and each is closed by itself.
    box = trimesh.creation.box(extents=[0.999 * cell] * 3)
    vertices = (middles[:, None] + box.vertices).reshape(-1, 3)
    faces = (np.arange(len(middles))[:, None, None] * len(box.vertices) + box.faces).reshape(-1, 3)
    return trimesh.Trimesh(vertices, faces, process=False)


def depth_cloud(
    depth: Float[np.ndarray, "h w"], camera: Camera, *, without: Bool[np.ndarray, "h w"] | None = None
) -> "trimesh.PointCloud":
    """The points that a depth picture shows, camera frame [m].

    Args:
        depth: along the optical axis [m]; 0 or not finite: missing.
        without: pixels that are left out, such as the object's and the robot's own.

    Raises:
        SceneError: the sizes differ, or no pixel is left.
    """
    import trimesh

    depth = np.asarray(depth, dtype=float)
    if depth.shape != (camera.height, camera.width):
        size = (camera.height, camera.width)
        raise SceneError("must have the camera's size", key="depth", value=depth.shape, choices=[size])
    seen = np.isfinite(depth) & (depth > 0)
    if without is not None:
        if without.shape != depth.shape:
            raise SceneError("must have the depth's size", key="without", value=without.shape)
        seen &= ~without
    v, u = np.nonzero(seen)
    if not len(u):
        raise SceneError("shows nothing", key="depth")
    z = depth[v, u]
    if np.median(z) > LARGEST_EXTENT:
        raise in_millimetres(SceneError, key="depth", value=f"{np.median(z):g} away")
    points = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=1)
    return trimesh.PointCloud(points)


def surface_mesh(shape: Any, placed: Float[np.ndarray, "4 4"], own: Float[np.ndarray, "n 3"]) -> tuple:
    """The mesh by which an obstacle is met and its pose in the object frame; no mesh where none is near.

    Args:
        shape: mesh or cloud.
        placed: (4, 4) `object_from_obstacle` [m].
        own: points of the object's surface [m].
    """
    import trimesh

    if not isinstance(shape, trimesh.PointCloud):
        return shape, placed
    return cells_of(transform_points(placed, np.asarray(shape.vertices)), own), np.eye(4)
