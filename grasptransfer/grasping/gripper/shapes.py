"""Geometry of a URDF's links: primitives, and meshes cut into convex parts."""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import GripperError, MeshError, in_millimetres
from grasptransfer.frames import transform_points
from grasptransfer.meshes import read_mesh
from grasptransfer.solids.decomposition import DecompositionSettings, decompose

if TYPE_CHECKING:
    import trimesh

KINDS = ("box", "cylinder", "sphere", "mesh")
LARGEST_LINK = 1.5  # m; a larger mesh of a gripper's link is in millimetres
FARTHEST_ORIGIN = 10.0  # m; no frame of a hand lies farther from the link that it belongs to
# A pad's face must keep its place to a fraction of a millimetre: half the concavity of an object's parts.
DECOMPOSITION = DecompositionSettings(concavity=0.02)


@dataclass(frozen=True, eq=False)
class Shape:
    """A convex solid in its link's frame.

    Args:
        kind: `box` (size x, y, z), `cylinder` (radius, length along z), `sphere` (radius) or `mesh`.
        size: the numbers above [m]; empty for a mesh.
        link_from_shape: (4, 4) [m].
        mesh: its surface, in the shape's frame.
    """

    kind: str
    size: tuple[float, ...]
    link_from_shape: Float[np.ndarray, "4 4"]
    mesh: "trimesh.Trimesh" = field(repr=False)


def solid_shapes(part: Any, link: str, path: Path) -> tuple[Shape, ...]:
    """The convex solids of a URDF's `<collision>` or `<visual>`; a mesh that is not convex is decomposed.

    Args:
        part: the part as yourdfpy reads it.
        link: its name, for messages.
        path: the URDF.

    Raises:
        GripperError: unsupported geometry, or a mesh that is missing, flat or in millimetres.
    """
    geometry, link_from_shape = part.geometry, origin_of(part, link, path)
    if geometry.mesh is None:
        return (_primitive(geometry, link_from_shape, link, path),)
    mesh, found = _load_mesh(geometry.mesh, link, path)
    try:
        solid = decompose(mesh, DECOMPOSITION)
    except MeshError as error:
        raise error.at(found, kind=GripperError) from error
    return tuple(Shape("mesh", (), link_from_shape, _hull(points)) for points in solid.parts)


def visual_surface(part: Any, link: str, path: Path) -> "trimesh.Trimesh":
    """The surface of a URDF's `<visual>` or `<collision>` as it is drawn, in the link's frame [m].

    Raises:
        GripperError: unsupported geometry, or a mesh that is missing or in millimetres.
    """
    link_from_shape = origin_of(part, link, path)
    if part.geometry.mesh is None:
        shape = _primitive(part.geometry, link_from_shape, link, path)
        return together([shape.mesh], [link_from_shape])
    return together([_load_mesh(part.geometry.mesh, link, path)[0]], [link_from_shape])


def together(
    meshes: "list[trimesh.Trimesh]", a_from_mesh: list[Float[np.ndarray, "4 4"]]
) -> "trimesh.Trimesh":
    """All meshes in one, each moved by its transform [m]."""
    import trimesh

    vertices, faces, count = [], [], 0
    for mesh, pose in zip(meshes, a_from_mesh, strict=True):
        vertices.append(transform_points(pose, mesh.vertices))
        faces.append(mesh.faces + count)
        count += len(mesh.vertices)
    return trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=False)


def origin_of(part: Any, name: str, path: Path) -> Float[np.ndarray, "4 4"]:
    """Where a URDF puts a joint, or the geometry of a link; the identity where it says nothing.

    Raises:
        GripperError: a number is not finite, or lies too far away to be in metres.
    """
    origin = np.eye(4) if part.origin is None else np.array(part.origin, dtype=float)
    if not (np.isfinite(origin).all() and np.abs(origin[:3, 3]).max() <= FARTHEST_ORIGIN):
        text = f"its origin must be finite and within {FARTHEST_ORIGIN:g} m"
        raise GripperError(text, path=path, key=name, value=origin[:3, 3].tolist())
    return origin


def _primitive(geometry: Any, link_from_shape: Float[np.ndarray, "4 4"], link: str, path: Path) -> Shape:
    import trimesh

    if geometry.box is not None:
        size = _lengths(geometry.box.size, link, path)
        if len(size) != 3:
            raise GripperError("a box needs three lengths", path=path, key=link, value=size)
        return Shape("box", size, link_from_shape, trimesh.creation.box(extents=size))
    if geometry.cylinder is not None:
        size = radius, length = _lengths((geometry.cylinder.radius, geometry.cylinder.length), link, path)
        mesh = trimesh.creation.cylinder(radius=radius, height=length, sections=32)
        return Shape("cylinder", size, link_from_shape, mesh)
    if geometry.sphere is not None:
        (radius,) = size = _lengths((geometry.sphere.radius,), link, path)
        mesh = trimesh.creation.icosphere(subdivisions=2, radius=radius)
        return Shape("sphere", size, link_from_shape, mesh)
    raise GripperError("geometry is empty or not supported", path=path, key=link, choices=KINDS)


def _lengths(values: Any, link: str, path: Path) -> tuple[float, ...]:
    lengths = tuple(float(value) for value in values)
    if not all(0 < length <= LARGEST_LINK for length in lengths):
        text = f"its lengths must be above 0 and at most {LARGEST_LINK:g} m"
        raise GripperError(text, path=path, key=link, value=lengths)
    return lengths


def _hull(points: Float[np.ndarray, "_ 3"]) -> "trimesh.Trimesh":
    import trimesh

    return trimesh.convex.convex_hull(points)


def _load_mesh(geometry: Any, link: str, path: Path) -> "tuple[trimesh.Trimesh, Path]":
    """The mesh, scaled to metres, in the shape's frame, and its file."""
    found = _find(geometry.filename, link, path)
    mesh = read_mesh(found, error=GripperError, key=link).mesh
    if mesh is None:
        raise GripperError("mesh file holds no triangles", path=found, key=link)
    if found.suffix.lower() == ".dae" and mesh.units is not None:
        mesh.convert_units("meters")  # COLLADA names its unit; ROS obeys it
    if geometry.scale is not None:
        mesh.apply_scale(geometry.scale)
    if mesh.extents.max() > LARGEST_LINK:
        raise in_millimetres(GripperError, path=found, key=link, value=f"{mesh.extents.max():.0f}")
    return mesh, found


def _package_name(folder: Path) -> str | None:
    """Name in the folder's `package.xml`, which need not be the folder's."""
    path = folder / "package.xml"
    found = (
        re.search(r"<name>\s*([^<\s]+)\s*</name>", path.read_text(errors="replace"))
        if path.is_file()
        else None
    )
    return found.group(1) if found else None


def _find(name: str, link: str, path: Path) -> Path:
    """The file that a URDF names.

    `package://NAME/...` is looked for in every folder above the URDF that is called NAME, by itself or in its
    `package.xml`, or has a folder of that name: as `NAME/urdf/hand.urdf`, and as two packages side by side.
    """
    scheme, _, rest = name.rpartition("://")
    if scheme in ("", "file"):
        candidates = [path.parent / rest]
    else:
        package, *inner = Path(rest).parts or ("",)
        folders = [path.parent.resolve(), *path.parent.resolve().parents]
        named = [folder for folder in folders if package in (folder.name, _package_name(folder))]
        named += [folder / package for folder in folders]
        # A copy of the package's files beside the URDF, without the folder of its name.
        candidates = [folder.joinpath(*inner) for folder in (*named, *folders[:3])]
    found = next((candidate for candidate in candidates if candidate.is_file()), None)
    if found is not None:
        return found
    looked = ", ".join(str(candidate) for candidate in dict.fromkeys(candidates))
    raise GripperError(f"mesh file {name} not found", path=path, key=link, fix=f"Looked for {looked}")
