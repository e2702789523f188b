"""Convex parts of a mesh, for collision checks and for physics engines, which collide nothing else.

Each watertight piece of the mesh is decomposed by itself, so that the thin wall of a mug stays hollow
and its handle keeps its hole; a piece that is convex already is taken as it is. The rest is CoACD
(Wei et al., "Approximate Convex Decomposition for 3D Meshes with Collision-Aware Concavity and Tree
Search", SIGGRAPH 2022), seconds per piece; results are cached by the mesh's content.
"""

import hashlib
import logging
import os
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from grasptransfer.errors import MeshError
from grasptransfer.files import replacing
from grasptransfer.frames import LARGEST_TRANSLATION
from grasptransfer.meshes import check_precision
from grasptransfer.solids.enclosed import SMALLEST_PART, solids_of, union_of
from grasptransfer.solids.reduced_hull import reduced_hull

if TYPE_CHECKING:
    import manifold3d
    import trimesh

LOG = logging.getLogger(__name__)
VERSION = 3  # Raise it when the parts of the same mesh change: cached files of other versions are ignored.
LARGEST_OBJECT = 2.0  # m: a larger mesh is in millimetres.


@dataclass(frozen=True)
class DecompositionSettings:
    """How closely convex parts follow the surface.

    Args:
        concavity: CoACD's threshold, a share of the piece's half extent: 2 mm on a mug.
        simplification: distance by which simplification may move the surface before the decomposition [m].
        convex_excess: a piece whose hull is larger by less than this share is convex.
        part_vertices: most vertices of a part.
        iterations, depth, nodes, resolution: effort of CoACD's search; CoACD's defaults take ten times as
            long.
        seed: seed of CoACD's search.
    """

    concavity: float = 0.04
    simplification: float = 3e-4
    convex_excess: float = 0.01
    part_vertices: int = 96
    iterations: int = 30
    depth: int = 2
    nodes: int = 10
    resolution: int = 500
    seed: int = 0


@dataclass(frozen=True)
class Decomposition:
    """Convex parts of a mesh, and its solid's volume and moments.

    Args:
        parts: vertices (v, 3) of each convex part, the mesh's frame [m].
        volume: volume of the solid [m3].
        centre_of_mass: (3,) position in the mesh's frame [m].
        inertia: (3, 3) inertia about the centre of mass for a density of 1 kg/m3 [kg m2].
        watertight: whether volume and inertia are those of the surface; otherwise they are those of the
            parts.
    """

    parts: tuple[Float[np.ndarray, "_ 3"], ...] = field(repr=False)
    volume: float
    centre_of_mass: Float[np.ndarray, "3"]
    inertia: Float[np.ndarray, "3 3"]
    watertight: bool


def cache_folder() -> Path:
    """The folder of cached decompositions: `$GRASPTRANSFER_CACHE`, or the user's cache folder."""
    chosen = os.environ.get("GRASPTRANSFER_CACHE")
    if chosen:
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "grasptransfer"


def decompose(
    mesh: "trimesh.Trimesh | trimesh.Scene", settings: DecompositionSettings | None = None
) -> Decomposition:
    """Convex parts of `mesh` [m], from the cache where the same surface was decomposed before.

    Raises:
        MeshError: no faces, not finite, flat, or not in metres.
    """
    settings = settings or DecompositionSettings()
    vertices, faces = checked_geometry(mesh)
    key = hashlib.sha256(
        repr((VERSION, settings)).encode() + vertices.tobytes() + faces.tobytes()
    ).hexdigest()
    path = cache_folder() / "decompositions" / f"{key[:32]}.npz"
    known = _read(path)
    if known is not None:
        return known
    found = _decompose(vertices, faces, settings)
    _write(path, found)
    return found


def checked_geometry(
    mesh: "trimesh.Trimesh | trimesh.Scene",
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Vertices [m] and faces as the mesh has them.

    Raises:
        MeshError: no faces, not finite, flat, too coarse, or not in metres.
    """
    import trimesh

    whole = mesh.to_geometry() if isinstance(mesh, trimesh.Scene) else mesh
    if not isinstance(whole, trimesh.Trimesh) or len(whole.faces) == 0:
        raise MeshError("has no triangles", key="mesh")
    vertices, faces = np.array(whole.vertices, float), np.array(whole.faces, np.int64)
    corners = vertices[np.unique(faces)]
    if not np.isfinite(corners).all():
        raise MeshError("holds NaN or infinity", key="mesh")
    check_precision(corners, key="mesh")
    extents = np.ptp(corners, axis=0)
    if extents.max() > LARGEST_OBJECT:
        raise MeshError(
            "is too large for an object in metres",
            key="mesh",
            value=np.round(extents, 3).tolist(),
            fix="Divide millimetres by 1000",
        )
    if extents.min() < 1e-4:
        raise MeshError("is flat: it encloses nothing", key="mesh", value=extents.tolist())
    away = float(np.linalg.norm((corners.min(0) + corners.max(0)) / 2))
    if away > LARGEST_TRANSLATION:
        raise MeshError(
            "lies farther from its origin than any grasp", key="mesh", value=f"{away:.6g} m", fix="Move both"
        )
    return vertices, faces


def _decompose(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], settings: DecompositionSettings
) -> Decomposition:
    import manifold3d

    solids, left = solids_of(vertices, faces)
    parts = [part for solid in solids for part in _convex_parts(solid, settings)]
    if left is not None:
        LOG.warning("the mesh is not watertight: mass and inertia are those of its convex parts")
        hulls = _coacd(*left, settings, watertight=False)
        parts += hulls
        solids += [manifold3d.Manifold.hull_points(part) for part in hulls]
    solid = union_of(solids)
    if solid.volume() < SMALLEST_PART:
        raise MeshError("encloses no volume", key="mesh")
    centre, inertia = _moments(solid)
    return Decomposition(tuple(parts), float(solid.volume()), centre, inertia, left is None)


def _convex_parts(
    solid: "manifold3d.Manifold", settings: DecompositionSettings
) -> list[Float[np.ndarray, "_ 3"]]:
    hull = solid.hull()
    if hull.volume() <= (1 + settings.convex_excess) * solid.volume():
        return [reduced_hull(_vertices(hull), settings.part_vertices)]
    simple = solid.simplify(settings.simplification).to_mesh64()
    vertices = np.asarray(simple.vert_properties)[:, :3]
    return _coacd(vertices, np.asarray(simple.tri_verts), settings, watertight=True)


def _coacd(
    vertices: Float[np.ndarray, "v 3"],
    faces: np.ndarray,
    settings: DecompositionSettings,
    *,
    watertight: bool,
) -> list[Float[np.ndarray, "_ 3"]]:
    import coacd
    import manifold3d

    coacd.set_log_level("error")
    pieces = coacd.run_coacd(
        coacd.Mesh(vertices, faces.astype(np.int32)),
        threshold=settings.concavity,
        preprocess_mode="off" if watertight else "on",
        mcts_iterations=settings.iterations,
        mcts_max_depth=settings.depth,
        mcts_nodes=settings.nodes,
        resolution=settings.resolution,
        seed=settings.seed,
    )
    hulls = [manifold3d.Manifold.hull_points(np.asarray(points, float)) for points, _ in pieces]
    return [
        reduced_hull(_vertices(hull), settings.part_vertices)
        for hull in hulls
        if hull.volume() > SMALLEST_PART
    ]


def _vertices(solid: "manifold3d.Manifold") -> Float[np.ndarray, "_ 3"]:
    return np.asarray(solid.to_mesh64().vert_properties)[:, :3].astype(float)


def _moments(solid: "manifold3d.Manifold") -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    import trimesh

    mesh = solid.to_mesh64()
    surface = trimesh.Trimesh(
        np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts).astype(np.int64), process=False
    )
    return np.array(surface.center_mass), np.array(surface.moment_inertia)


def _read(path: Path) -> Decomposition | None:
    try:
        with np.load(path, allow_pickle=False) as data:
            parts = np.split(data["vertices"], np.cumsum(data["counts"])[:-1])
            return Decomposition(
                tuple(parts),
                float(data["volume"]),
                data["centre_of_mass"],
                data["inertia"],
                bool(data["watertight"]),
            )
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        LOG.warning("a cached decomposition cannot be read and is made again: %s (%s)", path, error)
        return None


def _write(path: Path, found: Decomposition) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        LOG.warning("decompositions cannot be cached: %s", error)
        return
    with replacing(path) as temporary:
        np.savez(
            temporary,
            vertices=np.concatenate(found.parts),
            counts=np.array([len(part) for part in found.parts]),
            volume=found.volume,
            centre_of_mass=found.centre_of_mass,
            inertia=found.inertia,
            watertight=found.watertight,
        )
