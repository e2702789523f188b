"""A user's meshes and clouds: found, read, checked, repaired where that is safe, and put in the frame."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float

from grasptransfer.errors import CategoryError, MeshError, SettingsError
from grasptransfer.meshes import SMALLEST, SUFFIXES, MeshLimits, check_points, check_size, read_mesh
from grasptransfer.solids.enclosed import united
from grasptransfer.workshop.building.carving import carved_surface
from grasptransfer.workshop.building.cloud_files import read_pcd, read_xyz

ENDINGS = (*SUFFIXES, ".pcd", ".xyz")
FEWEST_POINTS = 50
AXES = {"+x": (1, 0, 0), "+y": (0, 1, 0), "+z": (0, 0, 1)}
AXES |= {f"-{name[1]}": tuple(-number for number in axis) for name, axis in AXES.items()}


@dataclass(frozen=True)
class Source:
    """One file of the user's.

    Args:
        name: name of the instance.
        path: the file.
        test: whether it is to stay out of the shape space.
    """

    name: str
    path: Path
    test: bool


@dataclass(frozen=True)
class Prepared:
    """An instance in the category's frame.

    Args:
        mesh: metres; made from the cloud where there was only a cloud.
        cloud: (m, 3) its points, where it was a cloud [m].
        notes: what was repaired or is worth knowing.
    """

    mesh: trimesh.Trimesh
    cloud: Float[np.ndarray, "m 3"] | None
    notes: tuple[str, ...]


def find_sources(folder: Path, test: tuple[str, ...] = ()) -> list[Source]:
    """Meshes and clouds of a folder: `NAME.obj` or `NAME/mesh.obj`, also below `train/`, `test/`.

    Args:
        folder: folder of the user's files.
        test: names of instances to keep out of the shape space, besides those below `test/`.

    Raises:
        CategoryError: none, two of one name, or a test name that is not there.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise CategoryError("is not a folder", path=folder)
    split = [folder / kind for kind in ("train", "test") if (folder / kind).is_dir()]
    found: dict[str, Source] = {}
    for root in (folder, *split):
        for name, path in _files(root, leave=split):
            if name in found:
                raise CategoryError(
                    f"{path.name} and {found[name].path.name} have one name", path=path.parent, key=name
                )
            found[name] = Source(name, path, root == folder / "test" or name in test)
    if not found:
        raise CategoryError("holds no mesh and no cloud", path=folder, choices=ENDINGS)
    for name in test:
        if name not in found:
            raise CategoryError("is not there", path=folder, key=f"test {name}", choices=found)
    return sorted(found.values(), key=lambda source: source.name)


def _files(root: Path, *, leave: list[Path]) -> Iterator[tuple[str, Path]]:
    """Name and file of each instance of a folder, but for those below the folders to leave."""
    for path in sorted(set(root.iterdir()) - set(leave)):
        if path.is_dir():
            inside = [one for one in sorted(path.iterdir()) if one.suffix.lower() in ENDINGS]
            named = [one for one in inside if one.stem == "mesh"] or inside
            if len(named) > 1:
                raise CategoryError(
                    "holds several meshes", path=path, choices=[one.name for one in named], fix="Leave one"
                )
            if named:
                yield path.name, named[0]
        elif path.suffix.lower() in ENDINGS:
            yield path.stem, path


def frame_rotation(front: str, up: str) -> Float[np.ndarray, "3 3"]:
    """Rotation that takes the sources' front and up axes to +x and +z.

    Args:
        front, up: one of `AXES` each, such as "+y".

    Raises:
        SettingsError: not two axes across each other.
    """
    for key, axis in (("front", front), ("up", up)):
        if axis not in AXES:
            raise SettingsError("is no axis", key=key, value=axis, choices=AXES)
    x, z = np.array(AXES[front], float), np.array(AXES[up], float)
    if abs(x @ z) > 0:
        raise SettingsError("must be across the up axis", key="front", value=front)
    return np.stack([x, np.cross(z, x), z])


def prepare(path: Path, *, scale: float, rotation: Float[np.ndarray, "3 3"]) -> Prepared:
    """Read one file; check and repair it; scale, turn and centre it.

    Args:
        path: path of a mesh or cloud, ending in one of `ENDINGS`.
        scale: metres in one unit of the file.
        rotation: (3, 3) from the file's axes to the category's.

    Raises:
        MeshError, PointCloudError: unreadable, empty, not finite, flat, or of an implausible size.
    """
    mesh, points = _read(path)
    notes: list[str] = []
    if mesh is not None:
        mesh, notes = _repair(mesh, path)
        points = np.asarray(mesh.vertices)
    check_points(points, path)
    check_size(np.ptp(points, axis=0) * scale, path, limits=MeshLimits(scale, SMALLEST))
    matrix = np.eye(4)
    matrix[:3, :3] = scale * rotation
    moved = points @ matrix[:3, :3].T
    matrix[:3, 3] = -(moved.min(0) + moved.max(0)) / 2
    shift = np.linalg.norm(matrix[:3, 3])
    if shift > 1e-3:
        notes.append(f"moved by {1000 * shift:.0f} mm: the centre of its bounding box is the origin now")
    if mesh is None:
        cloud = moved + matrix[:3, 3]
        if len(cloud) < FEWEST_POINTS:
            raise MeshError(f"needs at least {FEWEST_POINTS} points", path=path, value=len(cloud))
        mesh, radius = carved_surface(cloud)
        notes.append(f"a cloud of {len(cloud)} points; hollows below {2000 * radius:.0f} mm are filled")
        return Prepared(mesh, cloud, tuple(notes))
    mesh.apply_transform(matrix)
    return Prepared(mesh, None, tuple(notes))


def _read(path: Path) -> tuple[trimesh.Trimesh | None, Float[np.ndarray, "m 3"]]:
    """A mesh and its points, or the points of a cloud."""
    suffix = path.suffix.lower()
    if suffix == ".pcd":
        return None, read_pcd(path)
    if suffix == ".xyz":
        return None, read_xyz(path)
    found = read_mesh(path)
    return found.mesh, found.points


def _repair(mesh: trimesh.Trimesh, path: Path) -> tuple[trimesh.Trimesh, list[str]]:
    """Take away what has no area or is there twice; turn what is inside out; say so."""
    notes = []
    used = np.unique(mesh.faces)
    before = len(mesh.faces)
    extent = float(np.ptp(mesh.vertices[used], axis=0).max())
    mesh.update_faces(mesh.nondegenerate_faces(height=1e-12 * extent))
    mesh.update_faces(mesh.unique_faces())
    if len(mesh.faces) < before:
        notes.append(f"{before - len(mesh.faces)} faces without area or there twice were dropped")
    if not len(mesh.faces):
        raise MeshError("has no face with an area", path=path)
    mesh.remove_unreferenced_vertices()
    mesh.merge_vertices()
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    solid.merge_vertices(merge_tex=True, merge_norm=True)
    shared = np.bincount(trimesh.grouping.unique_rows(solid.edges_sorted)[1])
    crowded = int((shared > 2).sum())
    if crowded:
        notes.append(f"{crowded} edges belong" * (crowded > 1) or "one edge belongs")
        notes[-1] += " to more than two faces"
    if not solid.is_watertight:
        if united(mesh) is None:
            notes.append("is not watertight")
    elif solid.volume < 0:
        mesh.invert()
        notes.append("was inside out; its faces were turned")
    return mesh, notes
