"""Mesh files: read, checked and put in metres once, for every room that loads one.

A file's own faults (compressed, unreadable, no faces, NaN, far from its origin in single precision) are kept
apart from those of its unit, which `check_size` judges by the longest side.
"""

import json
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import GraspTransferError, MeshError

if TYPE_CHECKING:
    import trimesh

SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".off")
SMALLEST, LARGEST = 0.005, 2.0  # m: longest side of anything a gripper handles
TYPICAL, UNITS = 0.15, {"millimetres": 0.001, "centimetres": 0.01}  # m; metres in one unit
FLAT = 1e-3  # of the longest side; what is thinner encloses nothing
COARSEST = 1e-3  # of the longest side: a file whose numbers are rounded more has lost the shape
# Extension of glTF: its name, and the package by which it can be read, if any.
COMPRESSIONS = {
    "KHR_draco_mesh_compression": ("Draco", "DracoPy"),
    "EXT_meshopt_compression": ("meshoptimizer", None),
}


@dataclass(frozen=True)
class MeshFile:
    """What a file holds, in its own unit and frame.

    Args:
        mesh: all triangles as one mesh, corners that are nowhere used left out; None: there are none.
        points: (m, 3) corners of the mesh, or points of the cloud.
    """

    mesh: "trimesh.Trimesh | None"
    points: Float[np.ndarray, "m 3"]


@dataclass(frozen=True)
class MeshLimits:
    """What a mesh may be.

    Args:
        scale: metres in one unit of the file, as it was given.
        smallest, largest: least and largest longest side, in metres.
        sheets: whether it may be flat.
    """

    scale: float = 1.0
    smallest: float = 0.0
    largest: float = LARGEST
    sheets: bool = False


ANY_MESH = MeshLimits()


def load_mesh(
    path: str | Path,
    *,
    limits: MeshLimits = ANY_MESH,
    error: type[GraspTransferError] = MeshError,
    key: str | None = None,
) -> "trimesh.Trimesh":
    """A mesh file as one mesh [m], in the frame of the file.

    Args:
        path: path of the file.
        limits: the file's unit, and what is taken for a mesh in metres.
        error: the kind to raise.
        key: argument or key that names the file.

    Raises:
        error: missing, unreadable, compressed, without triangles, not finite, too coarse, flat or in another
            unit.
    """
    return in_metres(read_mesh(path, error=error, key=key), path, limits=limits, error=error, key=key)


def in_metres(
    found: MeshFile,
    path: str | Path,
    *,
    limits: MeshLimits = ANY_MESH,
    error: type[GraspTransferError] = MeshError,
    key: str | None = None,
) -> "trimesh.Trimesh":
    """The mesh of a file that was read, scaled to metres; arguments as of `load_mesh`.

    Raises:
        error: without triangles, flat or in another unit.
    """
    if found.mesh is None:
        raise error("has no triangles", path=path, key=key, fix="It is a cloud of points; make a mesh of it")
    mesh = found.mesh
    if limits.scale != 1.0:
        mesh.apply_scale(limits.scale)
    check_size(mesh.extents, path, limits=limits, error=error, key=key)
    return mesh


def read_mesh(
    path: str | Path, *, error: type[GraspTransferError] = MeshError, key: str | None = None
) -> MeshFile:
    """The triangles of a file, or its points where there are none.

    Raises:
        error: missing, unreadable, compressed, neither triangles nor points, not finite, or too coarse.
    """
    import trimesh

    parts = read_scene(path, error=error, key=key).dump()
    meshes = [part for part in parts if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    if not meshes:
        clouds = [np.asarray(getattr(part, "vertices", ()), float) for part in parts]
        clouds = [cloud for cloud in clouds if len(cloud)]
        if not clouds:
            raise error("holds neither triangles nor points", path=path, key=key)
        points = np.concatenate(clouds)
        check_points(points, path, error=error, key=key)
        return MeshFile(None, points)
    whole: Any = meshes[0] if len(meshes) == 1 else trimesh.util.concatenate(meshes)
    if not np.isfinite(whole.vertices).all():
        whole.remove_unreferenced_vertices()  # viewers do not show them either
    check_points(np.asarray(whole.vertices[np.unique(whole.faces)]), path, error=error, key=key)
    return MeshFile(whole, np.asarray(whole.vertices))


def read_scene(
    path: str | Path, *, error: type[GraspTransferError] = MeshError, key: str | None = None
) -> "trimesh.Scene":
    """A file's parts with their nodes, vertices in the order they were written.

    Raises:
        error: missing, unreadable, or compressed in a way that is not read here.
    """
    import trimesh

    path = Path(path)
    if not path.is_file():
        raise error("is a folder" if path.is_dir() else "does not exist", path=path, key=key)
    _refuse_compressed(path, error, key)
    try:
        # Unmerged vertices: seams, creases and the order of the vertices stay as written.
        scene = trimesh.load_scene(path, process=False)
    except NotImplementedError as cause:
        choices = SUFFIXES
        raise error(
            "cannot be read: its suffix names no mesh", path=path, key=key, choices=choices
        ) from cause
    except Exception as cause:  # The readers of a dozen formats raise whatever a broken file leads them to.
        raise error("cannot be read", path=path, key=key, fix=f"{type(cause).__name__}: {cause}") from cause
    drawn = (trimesh.Trimesh, trimesh.PointCloud)
    scene.delete_geometry([name for name, part in scene.geometry.items() if not isinstance(part, drawn)])
    for part in scene.geometry.values():
        _check_corners(part, path, error, key)
        check_precision(
            np.asarray(getattr(part, "vertices", np.zeros((0, 3))), float), path, error=error, key=key
        )
    return scene


def _check_corners(part: Any, path: Path, error: type[GraspTransferError], key: str | None) -> None:
    """Refuse corners that are no points of space, and faces with corners that do not exist."""
    if np.asarray(part.vertices).ndim != 2 or np.shape(part.vertices)[1] != 3:
        raise error("has corners that are not x, y, z", path=path, key=key, value=np.shape(part.vertices))
    faces, count = np.asarray(getattr(part, "faces", ())), len(part.vertices)
    if faces.size and (faces.min() < 0 or faces.max() >= count):
        wrong = int(faces.max() if faces.max() >= count else faces.min())
        raise error("has a face with a corner that does not exist", path=path, key=key, value=wrong)


def check_size(
    extents: Float[np.ndarray, "3"],
    path: str | Path | None = None,
    *,
    limits: MeshLimits = ANY_MESH,
    error: type[GraspTransferError] = MeshError,
    key: str | None = None,
) -> None:
    """Refuse a size [m] that speaks of another unit, and what is flat.

    Args:
        extents: sides of the bounding box [m], after scaling.
        path: path of the file.
        limits: what it may be; the message corrects its scale.
        error: the kind to raise.
        key: argument or key that names the file.

    Raises:
        error: too large, too small, or flat.
    """
    size = float(np.max(extents))
    where: dict[str, Any] = {"path": path, "key": key}
    if size > limits.largest:
        unit = min(UNITS, key=lambda unit: abs(np.log(UNITS[unit] * size / TYPICAL)))
        fix = f"Give the unit, --scale {limits.scale * UNITS[unit]:g}, or scale the file to metres"
        raise error(f"its longest side is {size:.4g} m: it looks like {unit}, not metres", fix=fix, **where)
    if size < limits.smallest:
        raise error(
            f"its longest side is {size:.4g} m: it looks like another unit, or is scaled down",
            fix=f"Give metres in one unit of the file, such as --scale {limits.scale * 1000:g}",
            **where,
        )
    if not limits.sheets and np.min(extents) < FLAT * size:
        raise error("is flat: it encloses nothing", value=np.round(extents, 6).tolist(), **where)


def check_points(
    points: Float[np.ndarray, "m 3"],
    path: str | Path,
    *,
    error: type[GraspTransferError] = MeshError,
    key: str | None = None,
) -> None:
    """Refuse points of a mesh or cloud that cannot be a body's.

    Raises:
        error: none, NaN or infinite, or all in one place.
    """
    if not len(points):
        raise error("is empty", path=path, key=key)
    if not np.isfinite(points).all():
        raise error("has points that are NaN or infinite", path=path, key=key)
    if not np.ptp(points, axis=0).any():
        place = points[0].tolist()
        problem = f"all its {len(points)} points lie in one place" if len(points) > 1 else "is a single point"
        raise error(problem, path=path, key=key, value=place)


def check_precision(
    points: Float[np.ndarray, "m 3"],
    path: str | Path | None = None,
    *,
    error: type[GraspTransferError] = MeshError,
    key: str | None = None,
) -> None:
    """Refuse numbers of single precision that are so large that their rounding shows in the shape.

    Raises:
        error: neighbouring numbers are farther apart than `COARSEST` of the longest side.
    """
    points = points[np.isfinite(points).all(1)]
    if not len(points) or (points != points.astype(np.float32)).any():
        return  # written in double precision or as text
    size, far = float(np.ptp(points, axis=0).max()), float(np.abs(points).max())
    step = float(np.spacing(np.float32(far)))
    if 0 < size < step / COARSEST:
        raise error(
            f"lies {far:.6g} from its origin, where numbers of single precision are {step:.2g} apart",
            path=path,
            key=key,
            value=f"longest side {size:.4g}",
            fix="Move it to the origin before it is saved, or save it in double precision (OBJ)",
        )


def _refuse_compressed(path: Path, error: type[GraspTransferError], key: str | None) -> None:
    """Refuse glTF compressed by what is not installed or not known: its geometry would be read as zeros."""
    header = _gltf_header(path)
    used = {*header.get("extensionsUsed", []), *header.get("extensionsRequired", [])}
    if all("bufferView" in accessor for accessor in header.get("accessors", [])):
        return  # a plain copy stands beside the compressed one
    for extension, (name, decoder) in COMPRESSIONS.items():
        if extension in used and (decoder is None or find_spec(decoder) is None):
            install = "" if decoder is None else f", or pip install {decoder}"
            fix = f"Export it without compression{install}"
            raise error(f"is compressed with {name} ({extension})", path=path, key=key, fix=fix)


def _gltf_header(path: Path) -> dict[str, Any]:
    """The JSON of a glTF or GLB file; empty of other files, and of broken ones, which the reader explains."""
    suffix = path.suffix.lower()
    if suffix not in (".glb", ".gltf"):
        return {}
    content = path.read_bytes()
    if suffix == ".glb":
        length = int.from_bytes(content[12:16], "little")
        content = content[20 : 20 + length]
    try:
        header = json.loads(content)
    except ValueError:
        return {}
    return header if isinstance(header, dict) else {}
