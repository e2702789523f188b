"""Objects that a picture leaves possible: surface points of the reconstruction, moved draw by draw.

The posterior is Gaussian over pose and latent together: seen along one ray, a larger object farther away
looks like a smaller one nearby. Displacements are linear in the latent, so the points of a drawn instance
are `mean + basis x`, with no new field to evaluate; a drawn pose moves them as a whole. Mass, friction and
force are drawn along with them. Draws come in pairs, one on either side of the estimate, so that their mean
is the estimate.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32

from grasptransfer.category import DENSITY
from grasptransfer.grasping.draws import paired_draws
from grasptransfer.grasping.enclosed_volume import enclosed, volume_and_centre
from grasptransfer.grasping.experience import pose_share
from grasptransfer.grasping.physics import Physics
from grasptransfer.grasping.surface_places import SURFACE_POINTS, SurfacePlaces

if TYPE_CHECKING:
    import trimesh

    from grasptransfer.category import Category
    from grasptransfer.perception.estimate import ShapeEstimate

EVERY = 12  # of these points tell which direction of the posterior moves the object most
LEAST_MASS = 0.05  # kg: nothing that is grasped weighs less


@dataclass(frozen=True)
class UnknownErrors:
    """How plausible objects are drawn.

    Args:
        draws: shapes and poses per call.
        shift, turn: standard deviation, along each axis, of the pose's errors that no estimate knows of:
            the hand's, and those of a given pose that was not refined [m, rad].
        pose: share of the stated covariance of a refined pose with which drawn poses differ; None: the one
            that executed grasps bear out (`experience.pose_share`).
    """

    draws: int = 64
    shift: float = 0.001
    turn: float = 0.01
    pose: float | None = None

    def drawn_from(self, posterior: Float[np.ndarray, "s s"]) -> Float[np.ndarray, "s s"]:
        """The covariance over turn, shift and latent of what is drawn around an estimate with this one."""
        scale = np.ones(len(posterior))
        scale[:6] = np.sqrt(pose_share() if self.pose is None else self.pose)
        return posterior * np.outer(scale, scale)


def _upright() -> Float[np.ndarray, "3"]:
    return np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class PlausibleObjects:
    """Surface points of each drawn object, object frame of the estimate.

    Args:
        points, normals: surface points [m] and unit normals; the same places of the surface in every draw.
        centres: centre of mass of each draw [m].
        mass: mass of each draw [kg].
        grip: friction times force of each pad, of each draw [N]; None: those of the simulation protocols.
        up: unit, against gravity.
    """

    points: Float[np.ndarray, "s m 3"]
    normals: Float[np.ndarray, "s m 3"]
    centres: Float[np.ndarray, "s 3"]
    mass: Float[np.ndarray, "s"]
    grip: Float[np.ndarray, "s"] | None = None
    up: Float[np.ndarray, "3"] = field(default_factory=_upright)

    @staticmethod
    def draw(
        mesh: "trimesh.Trimesh",
        category: "Category | None" = None,
        estimate: "ShapeEstimate | None" = None,
        *,
        seed: int = 0,
        physics: Physics | None = None,
        up: Float[np.ndarray, "3"] | None = None,
        unknown: UnknownErrors | None = None,
    ) -> "PlausibleObjects":
        """Draw around a reconstruction.

        Args:
            mesh: the reconstruction, object frame [m].
            category, estimate: whose posterior is drawn from; without them only `unknown` varies the pose.
            seed: seed of the draws.
            physics: mass, friction and force, and how sure they are.
            up: against gravity, object frame; None: the object's z axis.
            unknown: number of draws, and the errors that no estimate knows of.
        """
        unknown, physics = unknown or UnknownErrors(), physics or Physics()
        places, basis = surface_places(mesh, category)
        points, normals = places.points(mesh), places.normals(mesh)
        rotation, covariance = np.eye(3), np.zeros((6, 6))
        if category is not None and estimate is not None and estimate.covariance is not None:
            rotation = estimate.camera_from_object[:3, :3]
            covariance = unknown.drawn_from(estimate.covariance)
        covariance[:6, :6] += np.diag([unknown.turn**2] * 3 + [unknown.shift**2] * 3)
        basis = basis[..., : len(covariance) - 6]
        effect = _effect(points[::EVERY], basis[::EVERY], rotation)
        drawn, others = paired_draws(covariance, effect, unknown.draws, others=3, seed=seed)
        grown = np.einsum("mik,sk->smi", basis, drawn[:, 6:], optimize=True)
        outward = normals * places.areas(mesh)[:, None]
        volumes, centres = enclosed(grown, points, outward, volume_and_centre(mesh, category))
        turns, shifts = _rigid(drawn[:, :6], rotation)
        density = DENSITY if category is None else category.density
        mass, friction, force = physics.drawn(np.maximum(density * volumes, LEAST_MASS), others)
        return PlausibleObjects(
            points=(points + grown) @ turns + shifts,
            normals=normals @ turns,
            centres=(centres[:, None] @ turns + shifts)[:, 0],
            mass=mass,
            grip=friction * force,
            up=_upright() if up is None else up / np.linalg.norm(up),
        )

    def half(self) -> "PlausibleObjects":
        """Every other draw and its opposite: enough to compare places of one grasp."""
        pairs = len(self.points) // 2
        chosen = np.concatenate([np.arange(0, pairs, 2), np.arange(pairs, 2 * pairs, 2)])
        grip = None if self.grip is None else self.grip[chosen]
        return PlausibleObjects(
            self.points[chosen], self.normals[chosen], self.centres[chosen], self.mass[chosen], grip, self.up
        )

    @cached_property
    def rows(self) -> tuple[Float32[np.ndarray, "3 m s"], Float32[np.ndarray, "3 m s"]]:
        """Points and normals, component by component, all draws of a place side by side: quick to search."""
        together = (np.asarray(part.transpose(2, 1, 0), np.float32) for part in (self.points, self.normals))
        points, normals = (np.ascontiguousarray(part) for part in together)
        return points, normals

    @cached_property
    def around(self) -> tuple[Float32[np.ndarray, "3 m"], Float32[np.ndarray, "m"]]:
        """Middle of all draws of each place, and how far from it the farthest is [m]."""
        points = self.rows[0]
        low, high = points.min(axis=2), points.max(axis=2)
        return (low + high) / 2, np.sqrt(((high - low) ** 2).sum(axis=0)) / 2


# Of a canonical model, by its checksum: places of its surface, and how the latent moves them [m].
_PLACES: dict[str, tuple[SurfacePlaces, Float[np.ndarray, "m 3 k"]]] = {}


def surface_places(
    mesh: "trimesh.Trimesh", category: "Category | None"
) -> tuple[SurfacePlaces, Float[np.ndarray, "m 3 k"]]:
    """Where the surface is sampled, and how the latent moves each place [m]."""
    if category is None or len(mesh.faces) != len(category.canonical.faces):
        places = SurfacePlaces.spread(mesh, SURFACE_POINTS)
        return places, np.zeros((SURFACE_POINTS, 3, 0))
    if category.canonical_sha256 not in _PLACES:
        places = SurfacePlaces.spread(category.canonical, SURFACE_POINTS)
        faces = np.asarray(category.canonical.faces)
        basis = places.of_corners(category.vertices_by_latent.basis, faces)
        _PLACES[category.canonical_sha256] = places, basis
    return _PLACES[category.canonical_sha256]


def _effect(
    points: Float[np.ndarray, "n 3"], basis: Float[np.ndarray, "n 3 k"], rotation: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "c s"]:
    """How turn, shift (camera axes) and latent move the coordinates of points, object frame."""
    axes = np.broadcast_to(rotation[None], (len(points), 3, 3))  # rows: the camera's axes in the object's
    turned = np.cross(axes, points[:, None]).transpose(0, 2, 1)
    return np.concatenate([turned, axes.transpose(0, 2, 1), basis], axis=2).reshape(3 * len(points), -1)


def _rigid(
    motions_camera: Float[np.ndarray, "s 6"], rotation: Float[np.ndarray, "3 3"]
) -> tuple[Float[np.ndarray, "s 3 3"], Float[np.ndarray, "s 1 3"]]:
    """Turns about the object's origin, for points that are rows, and shifts [m], object frame.

    Args:
        motions_camera: turn [rad] and shift [m] along the camera's axes.
        rotation: the object's in the camera's frame.
    """
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_rotvec(motions_camera[:, :3] @ rotation).as_matrix()
    return turns.transpose(0, 2, 1), (motions_camera[:, 3:] @ rotation)[:, None]
