"""The surface of one mesh, prepared once for many questions: ray casts, collision, points inside."""

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Int

from grasptransfer.errors import MeshError
from grasptransfer.solids.enclosed import united

if TYPE_CHECKING:
    import trimesh

LARGEST_EXTENT = 20.0  # m; beyond it a mesh was given in millimetres
SURFACE_SAMPLES = 4000  # points that measure how deep something reaches in; about 3 mm apart on a mug
# Share of the sphere that a surface hides: beyond, its holes are faults; inside an open bin it is 0.8.
ENCLOSED = 0.9
GRAZING = 1e-6  # m past a hit before the next cast, so that it does not hit the same triangle


class Surface:
    """A mesh with its ray-casting scene and its collision hierarchy, each built on first use.

    Args:
        mesh: triangles [m], any frame: every answer is in that frame.

    Raises:
        MeshError: no triangles, not finite, or in millimetres.
    """

    def __init__(self, mesh: "trimesh.Trimesh", *, name: str = "object"):
        vertices = np.asarray(mesh.vertices, dtype=float)
        if len(mesh.faces) == 0:
            raise MeshError("has no triangles", key=name)
        if not np.isfinite(vertices).all():
            raise MeshError("has vertices that are NaN or infinite", key=name)
        extent = float(np.ptp(vertices, axis=0).max())
        if extent > LARGEST_EXTENT:
            raise MeshError(
                "looks like millimetres, not metres",
                key=name,
                value=f"{extent:.0f}",
                fix="Divide its vertices by 1000",
            )
        import trimesh

        # Texture seams split vertices; merged, a closed surface is closed again. Faces keep their order.
        self.mesh = trimesh.Trimesh(vertices, mesh.faces, process=True)
        if not self.mesh.is_watertight:  # bodies that touch have no inside until they are one
            whole = united(mesh)
            self.mesh = self.mesh if whole is None else whole
        self.name = name

    @cached_property
    def _rays(self) -> Any:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        scene = EmbreeScene()
        vertices = np.ascontiguousarray(self.mesh.vertices, dtype=np.float32)
        TriangleMesh(scene=scene, vertices=vertices, indices=np.ascontiguousarray(self.mesh.faces, np.int32))
        return scene

    @cached_property
    def bvh(self) -> Any:
        """The triangles as an FCL hierarchy."""
        import fcl

        return bvh_of(fcl, self.mesh)

    @cached_property
    def samples(self) -> Float[np.ndarray, "m 3"]:
        """Points spread evenly over the surface [m], the same ones each time."""
        import trimesh

        points = trimesh.sample.sample_surface(self.mesh, SURFACE_SAMPLES, seed=0)[0]
        return np.concatenate([points, self.mesh.vertices])

    @cached_property
    def is_watertight(self) -> bool:
        """Whether inside and outside are defined."""
        return bool(self.mesh.is_watertight)

    def first_hits(
        self, origins: Float[np.ndarray, "m 3"], directions: Float[np.ndarray, "m 3"]
    ) -> tuple[Float[np.ndarray, "m"], Int[np.ndarray, "m"]]:
        """Distance along unit `directions` [m] and triangle of the first hit; infinity and -1 without one."""
        hits = self._rays.run(
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
            output=True,
        )
        faces = hits["primID"].astype(int)
        return np.where(faces >= 0, hits["tfar"].astype(float), np.inf), faces

    def contains(self, points: Float[np.ndarray, "m 3"]) -> Bool[np.ndarray, "m"]:
        """Which points are inside; of a mesh that is not closed, those that it encloses but for small holes.

        Parity of hits along one slanted direction, so that an axis-aligned edge is not met by design;
        without a closed surface, the winding number.
        """
        inside = np.zeros(len(points), dtype=bool)
        if not len(points):
            return inside
        if not self.is_watertight:
            low, high = self.mesh.bounds
            within = np.flatnonzero(((low < points) & (points < high)).all(axis=1))
            inside[within] = [abs(self._winding(point)) > ENCLOSED for point in points[within]]
            return inside
        direction = np.array([0.2672, 0.5345, 0.8018])
        origins, open_ = np.array(points, dtype=float), np.arange(len(points))
        while len(open_):
            distance, faces = self.first_hits(origins[open_], np.tile(direction, (len(open_), 1)))
            hit = faces >= 0
            open_ = open_[hit]
            inside[open_] ^= True
            origins[open_] += (distance[hit, None] + GRAZING) * direction
        return inside

    def _winding(self, point: Float[np.ndarray, "3"]) -> float:
        """Solid angle of the surface seen from a point, as a share of the sphere.

        Van Oosterom and Strackee, "The solid angle of a plane triangle", 1983.
        """
        a, b, c = (np.asarray(self.mesh.triangles) - point).transpose(1, 0, 2)
        lengths = [np.linalg.norm(corner, axis=1) for corner in (a, b, c)]
        dots = [np.einsum("fi,fi->f", *pair) for pair in ((a, b), (b, c), (c, a))]
        numerator = np.einsum("fi,fi->f", a, np.cross(b, c))
        denominator = lengths[0] * lengths[1] * lengths[2]
        denominator += dots[0] * lengths[2] + dots[1] * lengths[0] + dots[2] * lengths[1]
        return float(np.arctan2(numerator, denominator).sum() / (2 * np.pi))


def bvh_of(fcl: Any, mesh: "trimesh.Trimesh") -> Any:
    """FCL hierarchy of a mesh."""
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces))
    model.endModel()
    return model
