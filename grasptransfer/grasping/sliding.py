"""Grasps too wide for the gripper, slid along the object to where it fits between the pads.

A wine bottle is wider than the canonical one, and so is every grasp around its body; a hand's width
higher, at the shoulder, a gripper gets around it. The approach and the closing direction stay.
"""

from collections.abc import Sequence

import numpy as np

from grasptransfer.grasping.closing import close_pads
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.grasping.surface import Surface
from grasptransfer.grasping.warping import WarpedGrasp

FARTHEST = 0.045  # m: farther along, it would be a grasp of another part
STEP = 0.003  # m
ROOM = 0.003  # m on each side of the object: the usual error of a reconstruction
STEEPEST = np.deg2rad(28)  # of a touched surface: friction holds more, and a seen shape errs
BESIDE = 0.03  # m outside the expected width, from where the pads look for the surface


def slide_where_too_wide(
    grasps: Sequence[WarpedGrasp], surface: Surface, gripper: Gripper
) -> tuple[WarpedGrasp, ...]:
    """Move each grasp that is too wide for the gripper along the pads' y axis; others stay.

    Args:
        grasps: grasps in the surface's frame.

    Returns:
        The grasps; one that fits nowhere near stays as it was.
    """
    return tuple(
        _slid(grasp, surface, gripper) if grasp.width + 2 * ROOM > gripper.max_width else grasp
        for grasp in grasps
    )


def _slid(grasp: WarpedGrasp, surface: Surface, gripper: Gripper) -> WarpedGrasp:
    ways = np.arange(-FARTHEST, FARTHEST + STEP / 2, STEP)
    ways = ways[np.argsort(np.abs(ways), kind="stable")]
    poses = np.tile(grasp.object_from_gripper, (len(ways), 1, 1))
    poses[:, :3, 3] += ways[:, None] * grasp.object_from_gripper[:3, 1]
    outside = np.full(len(ways), grasp.width + 2 * BESIDE)
    closing = close_pads(surface, poses, outside, gripper, expected=np.full(len(ways), gripper.max_width))
    flat = closing.cosines.min(axis=1) > np.cos(STEEPEST)
    fits = closing.touching.all(axis=1) & flat & (closing.width + 2 * ROOM <= gripper.max_width)
    if not fits.any():
        return grasp
    nearest = int(np.argmax(fits))
    pose = poses[nearest]
    # Between the pads as they will be opened around what is found.
    opened = gripper.pad_middle(np.array([gripper.approach_opening(float(closing.width[nearest]))]))
    pose[:3, 3] += pose[:3, 0] * (closing.local[nearest, :, 0].mean() - opened[0])
    return grasp.closing_at(pose, float(closing.width[nearest]), closing.points[nearest])
