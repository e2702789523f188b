"""Links of a URDF below a base link: their geometry and their kinematic chains."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import GripperError
from grasptransfer.frames import transform_points

if TYPE_CHECKING:
    import trimesh

MOVING = ("prismatic", "revolute", "continuous")


@dataclass(frozen=True, eq=False)
class Joint:
    """One joint of a chain.

    Args:
        kind: `fixed`, `prismatic`, `revolute` or `continuous`.
        parent_from_joint: its origin (4, 4) [m].
        axis: unit axis in the joint's frame.
        limits: lower and upper value, metres or radians.
    """

    name: str
    kind: str
    parent_from_joint: Float[np.ndarray, "4 4"]
    axis: Float[np.ndarray, "3"]
    limits: tuple[float, float]

    def parent_from_child(self, position: float) -> Float[np.ndarray, "4 4"]:
        """Transform at this joint value, metres or radians."""
        moved = np.eye(4)
        if self.kind == "prismatic":
            moved[:3, 3] = self.axis * position
        elif self.kind != "fixed":
            x, y, z = self.axis
            cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            moved[:3, :3] += np.sin(position) * cross + (1 - np.cos(position)) * cross @ cross
        return self.parent_from_joint @ moved


@dataclass(frozen=True, eq=False)
class Shape:
    """A convex primitive, or a mesh, in its link's frame.

    Args:
        kind: `box` (size x, y, z), `cylinder` (radius, length along z), `sphere` (radius) or `mesh`.
        size: the numbers above [m]; empty for a mesh.
        link_from_shape: (4, 4) [m].
        mesh: the surface, in the shape's frame.
    """

    kind: str
    size: tuple[float, ...]
    link_from_shape: Float[np.ndarray, "4 4"]
    mesh: "trimesh.Trimesh" = field(repr=False)


@dataclass(frozen=True, eq=False)
class FingerLink:
    """A link, its geometry in its own frame, and its chain of joints from the base."""

    name: str
    chain: tuple[Joint, ...]
    shapes: tuple[Shape, ...]
    collision: "trimesh.Trimesh | None" = field(repr=False)
    visual: "trimesh.Trimesh | None" = field(repr=False)

    def base_from_link(self, positions: dict[str, float]) -> Float[np.ndarray, "4 4"]:
        """Forward kinematics; `positions` holds each moving joint's value."""
        base_from_link = np.eye(4)
        for joint in self.chain:
            base_from_link = base_from_link @ joint.parent_from_child(positions.get(joint.name, 0.0))
        return base_from_link


def read_links(urdf_path: Path, base_link: str) -> tuple[FingerLink, ...]:
    """Every link at and below `base_link`.

    Raises:
        GripperError: unreadable URDF, unknown link, unsupported joint or geometry.
    """
    from yourdfpy import URDF

    if not urdf_path.is_file():
        raise GripperError("the URDF does not exist", path=urdf_path)
    try:
        urdf = URDF.load(str(urdf_path), load_meshes=False, build_scene_graph=False)
        robot = urdf.robot
    except (ValueError, SyntaxError, KeyError, TypeError, AttributeError) as error:
        raise GripperError(f"is not a readable URDF: {error}", path=urdf_path) from error
    names = {link.name: link for link in robot.links}
    if base_link not in names:
        raise GripperError(
            "is not a link of the URDF", path=urdf_path, key="base_link", value=base_link, choices=names
        )
    chains: dict[str, tuple[Joint, ...]] = {base_link: ()}
    pending = [base_link]
    while pending:
        parent = pending.pop(0)
        for joint in robot.joints:
            if joint.parent == parent:
                chains[joint.child] = (*chains[parent], _joint(joint, urdf_path))
                pending.append(joint.child)
    return tuple(_link(names[name], chain, urdf_path) for name, chain in chains.items())


def _joint(joint, path: Path) -> Joint:
    if joint.type not in (*MOVING, "fixed"):
        raise GripperError(
            "joint type is not supported",
            path=path,
            key=joint.name,
            value=joint.type,
            choices=(*MOVING, "fixed"),
        )
    origin = np.eye(4) if joint.origin is None else np.array(joint.origin, dtype=float)
    axis = np.array([1.0, 0, 0] if joint.axis is None else joint.axis, dtype=float)
    limits = (-np.pi, np.pi) if joint.type == "continuous" else (0.0, 0.0)
    if joint.limit is not None and joint.limit.upper is not None and joint.limit.lower is not None:
        limits = (float(joint.limit.lower), float(joint.limit.upper))
    if joint.type in MOVING and limits[0] >= limits[1]:
        raise GripperError(
            "joint needs rising lower and upper limits", path=path, key=joint.name, value=limits
        )
    return Joint(joint.name, joint.type, origin, axis / np.linalg.norm(axis), limits)


def _link(link, chain: tuple[Joint, ...], path: Path) -> FingerLink:
    collision = tuple(_shape(part, link.name, path) for part in link.collisions)
    visual = tuple(_shape(part, link.name, path) for part in link.visuals) or collision
    collision = collision or visual
    return FingerLink(link.name, chain, collision, _together(collision), _together(visual))


def _together(shapes: tuple[Shape, ...]) -> "trimesh.Trimesh | None":
    import trimesh

    if not shapes:
        return None
    vertices, faces, count = [], [], 0
    for shape in shapes:
        vertices.append(transform_points(shape.link_from_shape, shape.mesh.vertices))
        faces.append(shape.mesh.faces + count)
        count += len(shape.mesh.vertices)
    return trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=False)


def _shape(part, link: str, path: Path) -> Shape:
    import trimesh

    origin = np.eye(4) if part.origin is None else np.array(part.origin, dtype=float)
    geometry = part.geometry
    if geometry.box is not None:
        size = tuple(float(value) for value in geometry.box.size)
        return Shape("box", size, origin, trimesh.creation.box(extents=size))
    if geometry.cylinder is not None:
        radius, length = float(geometry.cylinder.radius), float(geometry.cylinder.length)
        mesh = trimesh.creation.cylinder(radius=radius, height=length, sections=32)
        return Shape("cylinder", (radius, length), origin, mesh)
    if geometry.sphere is not None:
        radius = float(geometry.sphere.radius)
        return Shape("sphere", (radius,), origin, trimesh.creation.icosphere(subdivisions=2, radius=radius))
    if geometry.mesh is not None:
        return Shape("mesh", (), origin, _mesh(geometry.mesh, link, path))
    raise GripperError(
        "geometry is not supported", path=path, key=link, choices=("box", "cylinder", "sphere", "mesh")
    )


def _mesh(geometry, link: str, path: Path) -> "trimesh.Trimesh":
    import trimesh

    name = geometry.filename
    relative = name.split("://", 1)[1] if "://" in name else name
    # package:// and model:// are resolved against the URDF's folder and those above it.
    candidates = [path.parent / relative]
    parts = Path(relative).parts
    candidates += [folder.joinpath(*parts[1:]) for folder in (path.parent, *path.parent.parents[:2])]
    found = next((candidate for candidate in candidates if candidate.is_file()), None)
    if found is None:
        raise GripperError("mesh file not found", path=path, key=link, value=name)
    mesh = trimesh.load_mesh(found)
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise GripperError("mesh file holds no triangles", path=found, key=link)
    if geometry.scale is not None:
        mesh.apply_scale(geometry.scale)
    return mesh
