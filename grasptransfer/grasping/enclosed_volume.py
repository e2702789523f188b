"""What the surface of an instance encloses: volume and centre of mass, of many drawn surfaces at once."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import MeshError
from grasptransfer.grasping.surface import Surface

if TYPE_CHECKING:
    import trimesh

    from grasptransfer.category import Category

LARGEST_GROWTH = (0.5, 2.0)  # of a drawn volume: beyond, its motion is not small


def enclosed(
    moved: Float[np.ndarray, "s m 3"],
    points: Float[np.ndarray, "m 3"],
    outward: Float[np.ndarray, "m 3"],
    body: tuple[float, Float[np.ndarray, "3"]],
) -> tuple[Float[np.ndarray, "s"], Float[np.ndarray, "s 3"]]:
    """Volume [m3] and centre of mass [m] of what the moved surface points enclose.

    Of small motions, by Gauss's theorem: a surface that moves outwards adds the volume that it sweeps.

    Args:
        moved: how far each draw moves each point [m].
        points: of the surface [m].
        outward: their normals, as long as the area that each point stands for [m2].
        body: volume and centre of mass of the surface where it has not moved.
    """
    volume, centre = body
    swept = np.einsum("smi,mi->sm", moved, outward) / volume
    grown = np.clip(1 + swept.sum(axis=1), *LARGEST_GROWTH)
    drift = swept @ (points - centre)
    return volume * grown, centre + drift / grown[:, None]


def volume_and_centre(
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
    if closed.is_watertight:
        return closed
    if np.linalg.matrix_rank(closed.vertices - closed.vertices.mean(axis=0), tol=1e-6) < 3:
        raise MeshError("is flat: it encloses nothing", key="mesh", value=closed.extents.tolist())
    return closed.convex_hull
