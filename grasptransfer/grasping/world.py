"""An object, the obstacles around it and an opened gripper: who touches whom, and how deep.

Surfaces are met by FCL (triangle hierarchies), a support plane by the distances of the gripper's
corners, and what lies wholly inside a closed body by the parity of ray hits.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from grasptransfer.frames import check_rigid, invert, transform_points
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.grasping.obstacles import surface_mesh
from grasptransfer.grasping.scene import Scene
from grasptransfer.grasping.surface import Surface, bvh_of
from grasptransfer.grasping.surface_places import SURFACE_POINTS, SurfacePlaces

if TYPE_CHECKING:
    import trimesh

SUPPORT = "support plane"


@dataclass(frozen=True)
class Touch:
    """A link that overlaps an obstacle, and how deep [m]."""

    link: str
    obstacle: str
    depth: float


@dataclass(frozen=True)
class Beside:
    """What stands beside an opened gripper: one row for each link and each near obstacle.

    Args:
        distance: between their nearest points [m]; 0 where they overlap.
        away: unit vectors from the obstacle to the link, gripper frame; 0 where they overlap.
        links, obstacles: their names.
    """

    distance: Float[np.ndarray, "n"]
    away: Float[np.ndarray, "n 3"]
    links: tuple[str, ...]
    obstacles: tuple[str, ...]

    def after(self, shifts: Float[np.ndarray, "c 3"]) -> Float[np.ndarray, "c"]:
        """Room left after each small shift, gripper frame [m]; infinite where nothing is near."""
        if not len(self.distance):
            return np.full(len(shifts), np.inf)
        return (self.distance + shifts @ self.away.T).min(axis=1)


@dataclass(frozen=True)
class _LinkParts:
    """A link prepared for collision, in its own frame."""

    name: str
    bvh: Any
    hulls: tuple[Float[np.ndarray, "_ 4"], ...]
    corners: Float[np.ndarray, "v 3"]


@lru_cache(maxsize=8)
def _link_parts(gripper: Gripper) -> tuple[_LinkParts, ...]:
    import fcl
    from scipy.spatial import ConvexHull

    parts = []
    for link in gripper.links:
        if link.collision is None:
            continue
        hulls = []
        for shape in link.shapes:
            equations = ConvexHull(shape.mesh.vertices).equations
            # Planes n.p + d <= 0 of the shape, moved into the link's frame.
            normals = equations[:, :3] @ shape.link_from_shape[:3, :3].T
            offsets = equations[:, 3] - normals @ shape.link_from_shape[:3, 3]
            hulls.append(np.unique(np.round(np.column_stack([normals, offsets]), 9), axis=0))
        corners = np.asarray(link.collision.vertices, dtype=float)
        parts.append(_LinkParts(link.name, bvh_of(fcl, link.collision), tuple(hulls), corners))
    return tuple(parts)


class OpenedGripper:
    """A gripper at one opening [m], in its own frame; the world is moved instead, which has fewer bodies.

    Raises:
        GripperError: the opening is out of range.
    """

    def __init__(self, gripper: Gripper, opening: float):
        import fcl

        poses = gripper.link_poses(opening)
        self.parts = _link_parts(gripper)
        self.gripper_from_link = [poses[part.name] for part in self.parts]
        self.bodies = [
            fcl.CollisionObject(part.bvh, fcl.Transform(pose[:3, :3], pose[:3, 3]))
            for pose, part in zip(self.gripper_from_link, self.parts, strict=True)
        ]

    @cached_property
    def corners(self) -> list[Float[np.ndarray, "_ 3"]]:
        """Of every link, gripper frame [m]."""
        return [
            transform_points(pose, part.corners)
            for pose, part in zip(self.gripper_from_link, self.parts, strict=True)
        ]


class CollisionWorld:
    """An object and what stands around it, prepared once to check many grasps.

    Args:
        mesh: the object's surface, object frame [m].
        scene: obstacles and support plane, camera frame.
        camera_from_object: pose of the object (4, 4) [m]; matters with a scene only.
        points: spread over the object's surface, its frame [m]; None: some are spread here.

    Raises:
        MeshError, PoseError: a mesh or the pose is not usable.
    """

    def __init__(
        self,
        mesh: "trimesh.Trimesh | Surface",
        scene: Scene | None = None,
        camera_from_object: Float[np.ndarray, "4 4"] | None = None,
        *,
        points: Float[np.ndarray, "m 3"] | None = None,
    ):
        import fcl

        self.surface = mesh if isinstance(mesh, Surface) else Surface(mesh)
        spread = SurfacePlaces.spread(self.surface.mesh, SURFACE_POINTS) if points is None else None
        self.points = points if spread is None else spread.points(self.surface.mesh)
        pose = np.eye(4) if camera_from_object is None else camera_from_object
        object_from_camera = invert(check_rigid(pose, "camera_from_object"))
        scene = Scene() if scene is None else scene
        self.bodies = [(self.surface.name, self.surface, np.eye(4))]
        for name, obstacle, camera_from_obstacle in scene.obstacles:
            placed = object_from_camera @ camera_from_obstacle
            own = self.points
            shape, placed = surface_mesh(obstacle, placed, own)  # pyright: ignore[reportArgumentType]
            if shape is not None:
                self.bodies.append((name, Surface(shape, name=name), placed))
        self._fcl = [
            fcl.CollisionObject(surface.bvh, fcl.Transform(placed[:3, :3], placed[:3, 3]))
            for _, surface, placed in self.bodies
        ]
        self._request = fcl.CollisionRequest(num_max_contacts=1, enable_contact=False)
        self.support_plane = None
        if scene.support_plane is not None:
            point, normal = scene.support_plane
            point = transform_points(object_from_camera, point)
            self.support_plane = (point, object_from_camera[:3, :3] @ normal)

    def touching(
        self, object_from_gripper: Float[np.ndarray, "4 4"], opened: OpenedGripper
    ) -> list[tuple[int, int]]:
        """Pairs (link index, body index) whose surfaces meet; body -1 is the support plane."""
        import fcl

        gripper_from_object = invert(object_from_gripper)
        for body, (_, _, placed) in zip(self._fcl, self.bodies, strict=True):
            pose = gripper_from_object @ placed
            body.setTransform(fcl.Transform(pose[:3, :3], pose[:3, 3]))
        pairs = [
            (i, j)
            for i, link in enumerate(opened.bodies)
            for j, body in enumerate(self._fcl)
            if fcl.collide(link, body, self._request, fcl.CollisionResult())
        ]
        if self.support_plane is not None:
            depths = self._plane_depths(object_from_gripper, opened)
            pairs += [(i, -1) for i, depth in enumerate(depths) if depth > 0]
        return pairs

    @property
    def up(self) -> Float[np.ndarray, "3"]:
        """Unit, object frame: away from the support plane, or without one the object's z axis."""
        return np.array([0.0, 0.0, 1.0]) if self.support_plane is None else self.support_plane[1]

    @property
    def has_obstacles(self) -> bool:
        """Whether anything but the object is there."""
        return len(self.bodies) > 1 or self.support_plane is not None

    def room(self, object_from_gripper: Float[np.ndarray, "4 4"], opened: OpenedGripper) -> float:
        """Distance to the nearest obstacle or the support plane [m]; infinite where there is none."""
        if not self.has_obstacles:
            return np.inf
        return float(self.beside(object_from_gripper, opened).distance.min())

    def beside(self, object_from_gripper: Float[np.ndarray, "4 4"], opened: OpenedGripper) -> Beside:
        """How far each link is from each obstacle and the support plane; the object itself is none."""
        import fcl

        gripper_from_object, rows = invert(object_from_gripper), []
        for (name, _, placed), body in zip(self.bodies[1:], self._fcl[1:], strict=True):
            pose = gripper_from_object @ placed
            body.setTransform(fcl.Transform(pose[:3, :3], pose[:3, 3]))
            for part, link in zip(opened.parts, opened.bodies, strict=True):
                result = fcl.DistanceResult()
                distance = fcl.distance(link, body, fcl.DistanceRequest(enable_nearest_points=True), result)
                first, second = result.nearest_points if distance > 0 else (0.0, np.zeros(3))
                away = np.subtract(first, second)  # pyright: ignore[reportCallIssue, reportArgumentType]
                rows.append((max(distance, 0.0), away / max(np.linalg.norm(away), 1e-9), part.name, name))
        if self.support_plane is not None:
            normal = object_from_gripper[:3, :3].T @ self.support_plane[1]
            depths = self._plane_depths(object_from_gripper, opened)
            rows += [
                (max(-depth, 0.0), normal, part.name, SUPPORT)
                for part, depth in zip(opened.parts, depths, strict=True)
            ]
        if not rows:
            return Beside(np.zeros(0), np.zeros((0, 3)), (), ())
        distance, away, links, obstacles = zip(*rows, strict=True)
        return Beside(np.array(distance), np.stack(away), links, obstacles)

    def swallowed(
        self, object_from_gripper: Float[np.ndarray, "4 4"], opened: OpenedGripper
    ) -> list[tuple[int, int]]:
        """Pairs (link index, body index) where the link's middle lies inside a closed body."""
        middles = np.stack([corners.mean(axis=0) for corners in opened.corners])
        middles = transform_points(object_from_gripper, middles)
        pairs = []
        for j, (_, surface, placed) in enumerate(self.bodies):
            inside = surface.contains(transform_points(invert(placed), middles))
            pairs += [(int(i), j) for i in np.flatnonzero(inside)]
        return pairs

    def deepest(
        self,
        object_from_gripper: Float[np.ndarray, "4 4"],
        opened: OpenedGripper,
        pairs: Iterable[tuple[int, int]],
    ) -> Touch:
        """The pair that overlaps most, and by how much."""
        touches = []
        for i, j in pairs:
            part = opened.parts[i]
            if j < 0:
                depth, name = self._plane_depths(object_from_gripper, opened)[i], SUPPORT
            else:
                name, surface, placed = self.bodies[j]
                object_from_link = object_from_gripper @ opened.gripper_from_link[i]
                points = transform_points(invert(object_from_link) @ placed, surface.samples)
                depth = max(-(points @ hull[:, :3].T + hull[:, 3]).max(axis=1).min() for hull in part.hulls)
            touches.append(Touch(part.name, name, max(float(depth), 0.0)))
        return max(touches, key=lambda touch: touch.depth)

    def _plane_depths(
        self, object_from_gripper: Float[np.ndarray, "4 4"], opened: OpenedGripper
    ) -> list[float]:
        """How far each link reaches below the support plane [m]; negative above it."""
        assert self.support_plane is not None
        point, normal = self.support_plane
        normal_gripper = object_from_gripper[:3, :3].T @ normal
        height = float((object_from_gripper[:3, 3] - point) @ normal)
        return [-float(height + (corners @ normal_gripper).min()) for corners in opened.corners]


def as_world(
    mesh: "trimesh.Trimesh | Surface | CollisionWorld",
    scene: Scene | None,
    camera_from_object: Float[np.ndarray, "4 4"] | None,
) -> CollisionWorld:
    """The world given, or a new one around the mesh."""
    return mesh if isinstance(mesh, CollisionWorld) else CollisionWorld(mesh, scene, camera_from_object)
