"""Objects that a picture leaves possible: surface points of the reconstruction, moved draw by draw.

The posterior is Gaussian over pose and latent together: seen along one ray, a larger object farther away
looks like a smaller one nearby. Displacements are linear in the latent, so the points of a drawn instance
are `mean + basis x`, with no new field to evaluate; a drawn pose moves them as a whole. Draws come in
pairs, one on either side of the estimate, so that their mean is the estimate.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32

from grasptransfer.grasping.surface import Surface

if TYPE_CHECKING:
    import trimesh

    from grasptransfer.category import Category
    from grasptransfer.perception.estimate import ShapeEstimate

SURFACE_POINTS = 3000  # about 4 mm apart on a mug: some ten under each pad
MASS_LIMITS = (0.05, 1.0)  # kg, as the simulation protocols clamp it
LARGEST_GROWTH = (0.5, 2.0)  # of a drawn volume: beyond, its motion is not small


@dataclass(frozen=True)
class UnknownErrors:
    """How plausible objects are drawn.

    Args:
        draws: shapes and poses per call.
        shift, turn: standard deviation, along each axis, of the pose's errors that no estimate knows of:
            the hand's, and those of a given pose that was not refined [m, rad].
        density: of the object [kg/m3], the simulation protocols' guess.
    """

    draws: int = 24
    shift: float = 0.001
    turn: float = 0.01
    density: float = 500.0


@dataclass(frozen=True)
class PlausibleObjects:
    """Surface points of each drawn object, object frame of the estimate.

    Args:
        points, normals: of the surface [m], unit; the same places of the surface in every draw.
        centres: centre of mass of each draw [m].
        mass: of each draw [kg].
    """

    points: Float[np.ndarray, "s m 3"]
    normals: Float[np.ndarray, "s m 3"]
    centres: Float[np.ndarray, "s 3"]
    mass: Float[np.ndarray, "s"]

    @staticmethod
    def draw(
        mesh: "trimesh.Trimesh",
        category: "Category | None" = None,
        estimate: "ShapeEstimate | None" = None,
        *,
        seed: int = 0,
        unknown: UnknownErrors | None = None,
    ) -> "PlausibleObjects":
        """Draw around a reconstruction.

        Args:
            mesh: the reconstruction, object frame [m].
            category, estimate: whose posterior is drawn from; without them only `unknown` varies the pose.
            seed: of the draws.
        """
        import trimesh

        unknown, rng = unknown or UnknownErrors(), np.random.default_rng(seed)
        sampled = trimesh.sample.sample_surface(mesh, SURFACE_POINTS, seed=0)
        points, faces = np.asarray(sampled[0]), np.asarray(sampled[1])
        motions = _rigid(_pairs(rng, unknown.draws, np.diag([unknown.turn**2] * 3 + [unknown.shift**2] * 3)))
        shaped = np.tile(points, (unknown.draws, 1, 1))
        if category is not None and estimate is not None and estimate.covariance is not None:
            drawn = _pairs(rng, unknown.draws, estimate.covariance)
            motions = _rigid(_turned(drawn[:, :6], estimate.camera_from_object)) @ motions
            basis = _basis(points, faces, mesh, category)
            shaped += (basis.reshape(-1, basis.shape[2]) @ drawn[:, 6:].T).T.reshape(shaped.shape)
        volumes, centres = enclosed(shaped - points, points, faces, mesh, _body(mesh, category))
        turns, shifts = motions[:, :3, :3].transpose(0, 2, 1), motions[:, None, :3, 3]
        return PlausibleObjects(
            points=shaped @ turns + shifts,
            normals=mesh.face_normals[faces] @ turns,
            centres=(centres[:, None] @ turns + shifts)[:, 0],
            mass=np.clip(unknown.density * volumes, *MASS_LIMITS),
        )

    def some(self, count: int) -> "PlausibleObjects":
        """At most this many of the draws, in the pairs in which they were drawn."""
        half, pairs = (len(self.points) + 1) // 2, min(count // 2, len(self.points) // 2)
        chosen = np.concatenate([np.arange(pairs), half + np.arange(pairs)])
        return PlausibleObjects(
            self.points[chosen], self.normals[chosen], self.centres[chosen], self.mass[chosen]
        )

    @cached_property
    def rows(self) -> tuple[Float32[np.ndarray, "3 p"], Float32[np.ndarray, "3 p"]]:
        """Points and normals of all draws, one after the other, component by component: quick to search."""
        together = (self.points.reshape(-1, 3).T, self.normals.reshape(-1, 3).T)
        return np.ascontiguousarray(together[0], np.float32), np.ascontiguousarray(together[1], np.float32)


def _pairs(rng: np.random.Generator, draws: int, covariance: Float[np.ndarray, "d d"]) -> np.ndarray:
    """(draws, d) normal with this covariance, each beside its opposite.

    By the symmetric root of the covariance, which moves little when that does; eigenvectors, or a factor made
    of them, may change sign, and every draw with them.
    """
    variances, axes = np.linalg.eigh(covariance)
    root = (axes * np.sqrt(np.maximum(variances, 0))) @ axes.T
    half = rng.normal(size=((draws + 1) // 2, len(covariance))) @ root
    return np.concatenate([half, -half])[:draws]


def _turned(
    motions_camera: Float[np.ndarray, "s 6"], camera_from_object: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "s 6"]:
    """Turn and shift along the object's axes instead of the camera's."""
    rotation = camera_from_object[:3, :3]
    return np.concatenate([motions_camera[:, :3] @ rotation, motions_camera[:, 3:] @ rotation], axis=1)


def _rigid(motions: Float[np.ndarray, "s 6"]) -> Float[np.ndarray, "s 4 4"]:
    """Of turns [rad] about the origin, and shifts [m]."""
    from scipy.spatial.transform import Rotation

    matrices = np.tile(np.eye(4), (len(motions), 1, 1))
    matrices[:, :3, :3] = Rotation.from_rotvec(motions[:, :3]).as_matrix()
    matrices[:, :3, 3] = motions[:, 3:]
    return matrices


def _basis(points, faces, mesh: "trimesh.Trimesh", category: "Category") -> Float[np.ndarray, "m 3 k"]:
    """How the latent moves points of the reconstruction [m]."""
    import trimesh

    corners, basis = np.asarray(mesh.faces)[faces], category.vertices_by_latent.basis
    weights = trimesh.triangles.points_to_barycentric(np.asarray(mesh.vertices)[corners], points)
    return np.sum([weights[:, c, None, None] * basis[corners[:, c]] for c in range(3)], axis=0)


def enclosed(
    moved: Float[np.ndarray, "s m 3"], points, faces, mesh: "trimesh.Trimesh", body: tuple
) -> tuple[Float[np.ndarray, "s"], Float[np.ndarray, "s 3"]]:
    """Volume [m3] and centre of mass [m] of what the moved surface points enclose.

    Of small motions, by Gauss's theorem: a surface that moves outwards adds the volume that it sweeps.

    Args:
        moved: how far each draw moves each point [m].
        body: volume and centre of mass of the mesh.
    """
    volume, centre = body
    swept = np.einsum("smi,mi->sm", moved, mesh.face_normals[faces]) * mesh.area / volume
    grown = np.clip(1 + swept.mean(axis=1), *LARGEST_GROWTH)
    drift = swept @ (points - centre) / len(points)
    return volume * grown, centre + drift / grown[:, None]


def _body(
    mesh: "trimesh.Trimesh", category: "Category | None" = None
) -> tuple[float, Float[np.ndarray, "3"]]:
    """Volume [m3] and centre of mass [m]; what two overlapping parts fill counts once.

    Parts of a reconstruction overlap as those of the canonical model do, whose union is made only once:
    counted twice, a camera would weigh a fifth too much.
    """
    if category is None:
        return _united(_closed(mesh))
    if category.canonical_sha256 not in _OVERLAPS:
        canonical = _closed(category.canonical)
        volume, centre = _united(canonical)
        of_parts, centre_of_parts = _moments(canonical)
        as_it_is = len(canonical.faces) == len(category.canonical.faces)
        _OVERLAPS[category.canonical_sha256] = volume / of_parts, centre - centre_of_parts, as_it_is
    share, shift, as_it_is = _OVERLAPS[category.canonical_sha256]
    volume, centre = _moments(mesh if as_it_is else _closed(mesh))
    return share * volume, centre + shift


# Of a canonical model, by its checksum: the union's share of its parts' volumes, how far its centre is from
# theirs [m], and whether its faces are closed as they are.
_OVERLAPS: dict[str, tuple[float, Float[np.ndarray, "3"], bool]] = {}


def _moments(mesh: "trimesh.Trimesh") -> tuple[float, Float[np.ndarray, "3"]]:
    """Volume [m3] and centre of mass [m] of what closed parts enclose, by the divergence theorem."""
    a, b, c = np.asarray(mesh.vertices)[np.asarray(mesh.faces)].transpose(1, 0, 2)
    sixfold = np.einsum("fi,fi->f", a, np.cross(b, c))
    return abs(float(sixfold.sum())) / 6, (a + b + c).T @ sixfold / (4 * sixfold.sum())


def _united(closed: "trimesh.Trimesh") -> tuple[float, Float[np.ndarray, "3"]]:
    """Volume [m3] and centre of mass [m] of the union of all solid parts, less their cavities."""
    import trimesh

    parts = closed.split(only_watertight=True)
    solids = [part for part in parts if part.volume > 0]
    if len(solids) < 2:
        return abs(closed.volume), np.asarray(closed.center_mass)
    union = trimesh.boolean.union(solids, engine="manifold")
    pieces = [union, *(part for part in parts if part.volume <= 0)]  # a cavity is a part turned inwards
    volumes = np.array([piece.volume for piece in pieces])
    centres = np.stack([piece.center_mass for piece in pieces])
    return float(volumes.sum()), volumes @ centres / volumes.sum()


def _closed(mesh: "trimesh.Trimesh") -> "trimesh.Trimesh":
    """A closed surface, for mass and its centre."""
    closed = Surface(mesh).mesh
    return closed if closed.is_watertight else closed.convex_hull
