"""Links of a URDF at and below a base link: their geometry and their kinematic chains."""

import logging
import re
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import GripperError
from grasptransfer.grasping.gripper.shapes import (
    FARTHEST_ORIGIN,
    Shape,
    origin_of,
    solid_shapes,
    together,
    visual_surface,
)

if TYPE_CHECKING:
    import trimesh

LOG = logging.getLogger(__name__)
MOVING = ("prismatic", "revolute", "continuous")
MANY_TURNS = 1000.0  # rad
OTHER_ROOTS = {"sdf": "SDF", "mujoco": "MJCF", "COLLADA": "COLLADA", "robotModel": "MoveIt"}


@dataclass(frozen=True)
class Mimic:
    """A URDF's `<mimic>`: this joint's value is `ratio * value of joint + offset`."""

    joint: str
    ratio: float
    offset: float


@dataclass(frozen=True, eq=False)
class Joint:
    """One joint of a chain.

    Args:
        kind: `fixed`, `prismatic`, `revolute` or `continuous`.
        parent_from_joint: its origin (4, 4) [m].
        axis: unit axis in the joint's frame.
        limits: lower and upper value, metres or radians; None where the URDF gives none.
        mimic: the joint that it follows, by the URDF.
    """

    name: str
    kind: str
    parent_from_joint: Float[np.ndarray, "4 4"]
    axis: Float[np.ndarray, "3"]
    limits: tuple[float, float] | None
    mimic: Mimic | None = None

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
class FingerLink:
    """A link, its geometry in its own frame, and its chain of joints from the base.

    Args:
        shapes: convex solids that collide, in planning and in execution.
        collision: their surface; None where nothing collides.
        visual: what is drawn; None where nothing is.
    """

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


def read_links(
    urdf_path: Path,
    base_link: str,
    *,
    ignored: Collection[str] = (),
    solid_visuals: Collection[str] = (),
) -> tuple[FingerLink, ...]:
    """Every link at and below `base_link`.

    Args:
        ignored: links that collide with nothing.
        solid_visuals: links whose `<visual>` stands in for the `<collision>` that they lack.

    Raises:
        GripperError: unreadable URDF, unknown link, unsupported joint or geometry.
    """
    robot = _read(urdf_path)
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
            if joint.parent != parent:
                continue
            if joint.child not in names or joint.child in chains:
                what = "has two parents" if joint.child in chains else "is not a link of the URDF"
                raise GripperError(f"its child {joint.child} {what}", path=urdf_path, key=joint.name)
            chains[joint.child] = (*chains[parent], _joint(joint, urdf_path))
            pending.append(joint.child)
    for key, chosen in (("ignore_links", ignored), ("solid_visuals", solid_visuals)):
        for name in chosen:
            if name not in chains:
                raise GripperError("is not a link below the base link", key=key, value=name, choices=chains)
    return tuple(
        _link(names[name], chain, urdf_path, collides=name not in ignored, solid_visual=name in solid_visuals)
        for name, chain in chains.items()
    )


def _read(path: Path) -> Any:
    """The URDF's content as yourdfpy reads it, without meshes."""
    from yourdfpy import URDF

    if not path.is_file():
        raise GripperError("the URDF does not exist", path=path)
    _check_kind(path)
    try:
        return URDF.load(str(path), load_meshes=False, build_scene_graph=False).robot
    except (ValueError, SyntaxError, KeyError, TypeError, AttributeError, IndexError, OSError) as error:
        raise GripperError(f"is not a readable URDF: {error}", path=path) from error


def _check_kind(path: Path) -> None:
    """Refuse other descriptions of robots: a xacro file would read as a URDF with hardly anything in it."""
    text = path.read_text(encoding="utf-8", errors="replace")
    root = re.search(r"<([A-Za-z_][\w:.-]*)", re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL))
    if root is not None and root.group(1) in OTHER_ROOTS:
        raise GripperError(f"is a {OTHER_ROOTS[root.group(1)]} file, not a URDF", path=path)
    if "<xacro:" in text:
        raise GripperError(
            "is a xacro file, not a URDF",
            path=path,
            fix=f"Expand it first: xacro {path.name} > {path.name.split('.')[0]}.urdf",
        )


def _joint(joint: Any, path: Path) -> Joint:
    name = joint.name
    if joint.type not in (*MOVING, "fixed"):
        choices = (*MOVING, "fixed")
        raise GripperError(
            "joint type is not supported", path=path, key=name, value=joint.type, choices=choices
        )
    origin = origin_of(joint, name, path)
    if joint.type == "fixed":
        return Joint(name, "fixed", origin, np.array([1.0, 0, 0]), None)
    axis = np.array([1.0, 0, 0] if joint.axis is None else joint.axis, dtype=float)
    length = np.linalg.norm(axis) if axis.shape == (3,) else np.nan
    if not (np.isfinite(length) and length > 1e-6):
        raise GripperError(
            "its axis has no length", path=path, key=name, value=axis.tolist(), fix="Give <axis xyz=...>"
        )
    return Joint(name, joint.type, origin, axis / length, _limits(joint, path), _mimic(joint, path))


def _limits(joint: Any, path: Path) -> tuple[float, float] | None:
    """Lower and upper value; None where there are none, or both are 0 as some exporters write them."""
    if joint.type == "continuous" or joint.limit is None:
        return None
    low, high = (0.0 if value is None else float(value) for value in (joint.limit.lower, joint.limit.upper))
    if (low, high) == (0.0, 0.0):
        return None
    if not (np.isfinite([low, high]).all() and low < high):
        text = "joint needs rising lower and upper limits"
        raise GripperError(text, path=path, key=joint.name, value=(low, high))
    if joint.type == "prismatic" and max(abs(low), abs(high)) > FARTHEST_ORIGIN:
        text = f"a sliding joint's limits must lie within {FARTHEST_ORIGIN:g} m"
        raise GripperError(text, path=path, key=joint.name, value=(low, high))
    if joint.type == "revolute" and max(abs(low), abs(high)) > MANY_TURNS:
        return None  # Some exporters write such limits for a joint that turns without end.
    return low, high


def _mimic(joint: Any, path: Path) -> Mimic | None:
    if joint.mimic is None:
        return None
    mimic = joint.mimic
    ratio = 1.0 if mimic.multiplier is None else float(mimic.multiplier)
    offset = 0.0 if mimic.offset is None else float(mimic.offset)
    if not mimic.joint or not np.isfinite([ratio, offset]).all():
        raise GripperError("its <mimic> needs a joint and finite numbers", path=path, key=joint.name)
    return Mimic(mimic.joint, ratio, offset)


def _link(
    link: Any, chain: tuple[Joint, ...], path: Path, *, collides: bool, solid_visual: bool
) -> FingerLink:
    _check_mass(link, path)
    solid = link.collisions or (link.visuals if solid_visual else ())
    shapes = tuple(s for part in solid for s in solid_shapes(part, link.name, path)) if collides else ()
    collision = together([s.mesh for s in shapes], [s.link_from_shape for s in shapes]) if shapes else None
    visual = _visual(link, path)
    return FingerLink(link.name, chain, shapes, collision, collision if visual is None else visual)


def _check_mass(link: Any, path: Path) -> None:
    """Refuse masses and moments that no body has; 0 is what exporters write for a frame."""
    inertial = link.inertial
    if inertial is None:
        return
    mass = 0.0 if inertial.mass is None else float(inertial.mass)
    moments = np.zeros((3, 3)) if inertial.inertia is None else np.asarray(inertial.inertia, dtype=float)
    if not (np.isfinite(mass) and mass >= 0 and np.isfinite(moments).all() and (np.diag(moments) >= 0).all()):
        text = "its mass and moments of inertia must be finite and not negative"
        raise GripperError(text, path=path, key=link.name, value=mass)


def _visual(link: Any, path: Path) -> "trimesh.Trimesh | None":
    """What is drawn; a mesh that only the drawing wants, and that is not there, is no reason to refuse."""
    try:
        surfaces = [visual_surface(part, link.name, path) for part in link.visuals]
    except GripperError as error:
        if not link.collisions:
            raise
        LOG.warning("%s: the link is drawn as it collides", error)
        return None
    return together(surfaces, [np.eye(4)] * len(surfaces)) if surfaces else None
