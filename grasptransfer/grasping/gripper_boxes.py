"""Every part of an opened gripper as a box, and how far points are from them, many poses at once."""

from dataclasses import dataclass
from functools import lru_cache
from typing import no_type_check

import numpy as np
from jaxtyping import Float, Float32
from numba import njit

from grasptransfer.frames import rigid
from grasptransfer.grasping.gripper import Gripper

COMPILE = {"nogil": True, "cache": True, "error_model": "numpy"}
NOTHING = np.float32(0)


@dataclass(frozen=True)
class GripperBoxes:
    """Every part of an opened gripper as a box, single precision.

    Args:
        turns, places: `box_from_gripper`, rotation and place of the TCP [m].
        halves: half of each size [m].
        each: low and high corner of what holds each box, gripper frame [m].
    """

    turns: Float32[np.ndarray, "b 3 3"]
    places: Float32[np.ndarray, "b 3"]
    halves: Float32[np.ndarray, "b 3"]
    each: Float[np.ndarray, "2 b 3"]

    @property
    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Low and high corner of what holds all boxes, gripper frame [m]."""
        return np.stack([self.each[0].min(axis=0), self.each[1].max(axis=0)])


@lru_cache(maxsize=512)
def gripper_boxes(gripper: Gripper, opening: float) -> GripperBoxes:
    links, link_from_boxes, halves = _boxes_on_links(gripper)
    poses = gripper.link_poses(opening)
    gripper_from_boxes = np.stack([poses[link] for link in links]) @ link_from_boxes
    turns, middles = gripper_from_boxes[:, :3, :3].transpose(0, 2, 1), gripper_from_boxes[:, :3, 3]
    around = np.einsum("bij,bi->bj", np.abs(turns), halves)
    places = -np.einsum("bij,bj->bi", turns, middles)
    turns, places, halves = (np.ascontiguousarray(part, np.float32) for part in (turns, places, halves))
    return GripperBoxes(turns, places, halves, np.stack([middles - around, middles + around]))


@lru_cache(maxsize=8)
def _boxes_on_links(
    gripper: Gripper,
) -> tuple[tuple[str, ...], Float[np.ndarray, "b 4 4"], Float[np.ndarray, "b 3"]]:
    """Of every box the name of its link, its place on that [m] and half of its size [m]."""
    links, placed, halves = [], [], []
    for link in gripper.links:
        for shape in link.shapes if link.collision is not None else ():
            low, high = np.asarray(shape.mesh.bounds)
            links.append(link.name)
            placed.append(shape.link_from_shape @ rigid(np.eye(3), (low + high) / 2))
            halves.append((high - low) / 2)
    return tuple(links), np.stack(placed), np.stack(halves)


def swept(
    corners: Float[np.ndarray, "2 *b 3"], margin: float, shifts: Float[np.ndarray, "c 3"]
) -> Float32[np.ndarray, "2 *b 3"]:
    """Low and high corners of what boxes sweep under these shifts, and a margin around it [m]."""
    low, high = corners[0] + shifts.min(axis=0) - margin, corners[1] + shifts.max(axis=0) + margin
    return np.stack([low, high]).astype(np.float32)


def points_within(
    points: Float[np.ndarray, "m 3"],
    object_from_gripper: Float[np.ndarray, "4 4"],
    boxes: GripperBoxes,
    *,
    margin: float,
) -> Float32[np.ndarray, "n 3"]:
    """The points (object frame) that lie within a margin [m] of what holds all boxes at a pose."""
    local = (points - object_from_gripper[:3, 3]) @ object_from_gripper[:3, :3]
    low, high = boxes.bounds
    near = ((low - margin < local) & (local < high + margin)).all(axis=1)
    return points[near].astype(np.float32)


def clearances(
    points: Float32[np.ndarray, "m 3"],
    object_from_gripper: Float[np.ndarray, "c 4 4"],
    boxes: GripperBoxes,
    *,
    far: float,
) -> Float[np.ndarray, "c"]:
    """Signed distance of the nearest point to an opened gripper at each pose [m]; `far` where none is nearer.

    Args:
        points: of a surface, object frame [m].
        far: most that is measured [m].
    """
    turns = np.ascontiguousarray(object_from_gripper[:, :3, :3].transpose(0, 2, 1), np.float32)
    places = np.ascontiguousarray(object_from_gripper[:, :3, 3], np.float32)
    nearest = np.full(len(turns), far)
    corners = np.concatenate([boxes.each, boxes.bounds[:, None]], axis=1)
    corners = np.stack([corners[0] - far, corners[1] + far]).astype(np.float32)
    _nearest(points, turns, places, (boxes.turns, boxes.places, boxes.halves), corners,
             nearest)  # fmt: skip
    return nearest


@njit(**COMPILE)
@no_type_check
def _nearest(points, turns, places, boxes, corners, nearest):
    """Lower each pose's entry of `nearest` to the signed distance of the points to the nearest box [m].

    Args:
        corners: (2, b + 1, 3) of what is near each box, and last of what is near any.
    """
    turned, moved, halves = boxes
    parts = len(halves)
    for c in range(len(turns)):
        for p in range(len(points)):
            dx, dy, dz = points[p, 0] - places[c, 0], points[p, 1] - places[c, 1], points[p, 2] - places[c, 2]
            x = turns[c, 0, 0] * dx + turns[c, 0, 1] * dy + turns[c, 0, 2] * dz
            y = turns[c, 1, 0] * dx + turns[c, 1, 1] * dy + turns[c, 1, 2] * dz
            z = turns[c, 2, 0] * dx + turns[c, 2, 1] * dy + turns[c, 2, 2] * dz
            if not (corners[0, parts, 0] < x < corners[1, parts, 0]
                    and corners[0, parts, 1] < y < corners[1, parts, 1]
                    and corners[0, parts, 2] < z < corners[1, parts, 2]):  # fmt: skip
                continue
            for b in range(parts):
                if not (corners[0, b, 0] < x < corners[1, b, 0] and corners[0, b, 1] < y < corners[1, b, 1]
                        and corners[0, b, 2] < z < corners[1, b, 2]):  # fmt: skip
                    continue
                along = turned[b, 0, 0] * x + turned[b, 0, 1] * y + turned[b, 0, 2] * z + moved[b, 0]
                across = turned[b, 1, 0] * x + turned[b, 1, 1] * y + turned[b, 1, 2] * z + moved[b, 1]
                up = turned[b, 2, 0] * x + turned[b, 2, 1] * y + turned[b, 2, 2] * z + moved[b, 2]
                dx, dy, dz = abs(along) - halves[b, 0], abs(across) - halves[b, 1], abs(up) - halves[b, 2]
                distance = max(dx, max(dy, dz))
                if distance > 0:
                    dx, dy, dz = max(dx, NOTHING), max(dy, NOTHING), max(dz, NOTHING)
                    distance = np.sqrt(dx * dx + dy * dy + dz * dz)
                if distance < nearest[c]:
                    nearest[c] = distance
