"""A two-finger gripper.

Frames: `base` is the URDF link the robot's wrist carries; `gripper` is the TCP, between the finger
pads, +z approach, +x closing. `base_from_tcp` is fixed: where a linkage moves its pads along the
approach while it closes (Robotiq 2F-85), or one jaw moves towards one that stands, the TCP stays.

The opening is the distance between the centres of the two pad faces along TCP x [m]. Joints follow a
single driver, `joint = ratio * driver + offset`; the opening that belongs to a driver value comes from
forward kinematics, so prismatic fingers, linkages and turning jaws are described alike.
"""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import GripperError
from grasptransfer.frames import invert, transform_points
from grasptransfer.grasping.gripper.coupling import FingerJoint
from grasptransfer.grasping.gripper.links import FingerLink
from grasptransfer.grasping.gripper.pads import Pad, PadFaces, PadTable, moving_with, pad_table

if TYPE_CHECKING:
    import trimesh

PAD_SAMPLES = 65  # of where the pads are, over the stroke
APPROACH_CLEARANCE = 0.01  # m each side: room for the usual pose error of a seen object


@dataclass(frozen=True, eq=False)
class Gripper:
    """A two-finger gripper; build it with `load_gripper`. Compared and hashed by identity.

    Args:
        name: its name.
        path: the YAML file it was read from.
        urdf_path: its URDF.
        base_link: URDF link that the wrist carries.
        base_from_tcp: rigid transform (4, 4) [m].
        finger_joints: joints that open and close it; the first one drives.
        opening: smallest and largest distance between the pads [m].
        force_limit: largest grip force [N].
        pads: the pad on the TCP's -x side, then the one on its +x side.
        links: geometry and kinematic chain of every link below the base.
        driver_table, opening_table: driver values and the openings that belong to them, rising.
    """

    name: str
    path: Path
    urdf_path: Path
    base_link: str
    base_from_tcp: Float[np.ndarray, "4 4"]
    finger_joints: tuple[FingerJoint, ...]
    opening: tuple[float, float]
    force_limit: float
    pads: tuple[Pad, Pad]
    links: tuple[FingerLink, ...] = field(repr=False)
    driver_table: Float[np.ndarray, "t"] = field(repr=False)
    opening_table: Float[np.ndarray, "t"] = field(repr=False)

    @property
    def max_width(self) -> float:
        """Largest opening [m]."""
        return self.opening[1]

    def joint_positions(self, width: float) -> dict[str, float]:
        """Joint values, metres or radians, that put the pads `width` [m] apart.

        Raises:
            GripperError: the width lies outside the opening range.
        """
        low, high = self.opening
        if not low - 1e-6 <= width <= high + 1e-6:
            raise GripperError(
                f"opening must lie between {low:g} and {high:g} m", key="width", value=float(width)
            )
        driver = float(np.interp(width, self.opening_table, self.driver_table))
        return {joint.name: joint.position(driver) for joint in self.finger_joints}

    def opening_of(self, positions: dict[str, float]) -> float | None:
        """Distance between the pads [m] that belongs to the driver's value among these; None without it."""
        driver = self.finger_joints[0]
        if driver.name not in positions:
            return None
        value = (positions[driver.name] - driver.offset) / driver.ratio
        order = np.argsort(self.driver_table)
        return float(np.interp(value, self.driver_table[order], self.opening_table[order]))

    def link_poses(self, width: float) -> dict[str, Float[np.ndarray, "4 4"]]:
        """`tcp_from_link` of every link at this opening [m]."""
        tcp_from_base, positions = invert(self.base_from_tcp), self.joint_positions(width)
        return {link.name: tcp_from_base @ link.base_from_link(positions) for link in self.links}

    def link_meshes(self, width: float, *, visual: bool = False) -> "dict[str, trimesh.Trimesh]":
        """Mesh of every link that has geometry, in the TCP frame [m], at this opening [m]."""
        meshes = {}
        for link in self.links:
            mesh = link.visual if visual else link.collision
            if mesh is not None:
                meshes[link.name] = mesh.copy()
        poses = self.link_poses(width)
        for name, mesh in meshes.items():
            mesh.apply_transform(poses[name])
        return meshes

    def pad_centres(self, width: float) -> Float[np.ndarray, "2 3"]:
        """Centres of the two pad faces (-x, +x) in the TCP frame [m]."""
        poses = self.link_poses(width)
        return np.stack([transform_points(poses[pad.link], pad.centre) for pad in self.pads])

    def pad_middle(self, openings: Float[np.ndarray, "g"]) -> Float[np.ndarray, "g"]:
        """x of the middle between the pads at each opening [m], TCP frame [m].

        It is 0 where the pads mirror each other; where one jaw stands, the middle moves with the other.
        """
        return self._pad_table.middle(openings)

    def pad_faces(self, openings: Float[np.ndarray, "g"]) -> PadFaces:
        """How the pads stand at each opening [m]; a linkage moves them along z, a jaw turns them."""
        return self._pad_table.faces(openings)

    @cached_property
    def narrowest(self) -> float:
        """Width of the thinnest object that both pads reach [m].

        It is the smallest opening, less by how far the edges of tilted faces stand out.
        """
        low = self.opening[0]
        slopes = np.abs(self.pad_faces(np.array([low])).slopes[0])
        stand_out = sum(float(slope @ pad.size) / 2 for slope, pad in zip(slopes, self.pads, strict=True))
        return max(low - stand_out, 0.0)

    @property
    def pads_mirror(self) -> bool:
        """Whether the pads are at equal distances from the TCP at every opening."""
        return self._pad_table.mirror

    @property
    def pads_turn(self) -> bool:
        """Whether the pads' faces are not always square to TCP x."""
        return self._pad_table.turns

    @cached_property
    def pad_bodies(self) -> tuple[frozenset[str], frozenset[str]]:
        """Names of the links that move with the -x pad, and of those that move with the +x pad."""
        by_name = {link.name: link for link in self.links}
        first, second = (
            frozenset(link.name for link in moving_with(by_name[pad.link], self.links)) for pad in self.pads
        )
        return first, second

    @cached_property
    def finger_links(self) -> frozenset[str]:
        """Names of the links that move with a pad."""
        return self.pad_bodies[0] | self.pad_bodies[1]

    @cached_property
    def _pad_table(self) -> PadTable:
        return pad_table(self.pads, np.linspace(*self.opening, PAD_SAMPLES), self.link_poses)

    def approach_opening(self, width: float) -> float:
        """Opening [m] with which to approach something `width` [m] wide: 1 cm of room on each side."""
        return float(np.clip(width + 2 * APPROACH_CLEARANCE, *self.opening))
