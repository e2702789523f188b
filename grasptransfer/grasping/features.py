"""What the ranking looks at: points of drawn objects near an opened gripper, shift by shift, draw by draw.

The loops over points are compiled; each point is dropped as soon as one of its coordinates is too far away.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import no_type_check

import numpy as np
from jaxtyping import Float, Float32
from numba import njit

from grasptransfer.grasping.gripper import Gripper, PadFaces
from grasptransfer.grasping.plausible import PlausibleObjects
from grasptransfer.grasping.warping import WarpedGrasp

FAR = 0.003  # m: more clearance than this is no better
WITHIN = 0.012  # m: deeper inside the gripper than this is no worse
UP = np.array([0.0, 0.0, 1.0])  # object frame: categories stand upright
# The weight's lever counts whole across the closing line, and these shares of it above the pads (it topples
# when the hand tilts), below them (it swings), and along the line (one pad bears it all). Of 2969 simulated
# grasps that were reached; tests/test_ranking.py has the order.
ABOVE, BELOW, ASIDE = 0.7, 0.4, 0.4
PATCH = 0.0025  # m behind the first point that a pad meets: one spacing of the points on a curved side
COMPILE = {"nogil": True, "cache": True, "error_model": "numpy"}


def features_around(
    grasp: WarpedGrasp,
    opening: float,
    gripper: Gripper,
    plausible: PlausibleObjects,
    shifts: Float[np.ndarray, "c 3"],
) -> Float[np.ndarray, "c s 4"]:
    """`success_model.FEATURES` of a grasp after each shift, in each draw; NaN where a pad meets nothing.

    Args:
        opening: of the gripper on the way in [m].
        shifts: of the TCP, gripper frame [m].
    """
    pose, draws = grasp.object_from_gripper.astype(np.float32), len(plausible.points)
    points, normals = plausible.rows
    boxes, turn, moved = (
        _boxes(gripper, opening),
        np.ascontiguousarray(pose[:3, :3].T),
        shifts.astype(np.float32),
    )
    local, near = _near(points, turn, turn @ pose[:3, 3], _swept(boxes.bounds, FAR, shifts))
    draw = near // plausible.points.shape[1]
    clearance = np.full((len(shifts), draws), FAR)
    _clear(local, draw, (boxes.turns, boxes.places, boxes.halves), _swept(boxes.each, FAR, shifts), moved,
           clearance)  # fmt: skip
    corridor, faces = _pad_corridor(gripper, opening, grasp.width), gripper.pad_faces(np.array([grasp.width]))
    local, between = _near(local, np.eye(3, dtype=np.float32), np.zeros(3, np.float32),
                           _swept(corridor, 0.0, shifts))  # fmt: skip
    facing = -(faces.normals[0].astype(np.float32) @ turn) @ normals[:, near[between]]
    count, flatness = _meet(local, facing, draw[between], _receding(faces, local[1:]),
                            corridor.astype(np.float32), moved, draws)  # fmt: skip
    columns = [
        np.maximum(clearance, -WITHIN) * 1e3,
        flatness,
        np.minimum(count / 4, 1),
        plausible.mass * _levers(grasp, plausible.centres, shifts) * 100,
    ]
    return np.where(count[..., None] > 0, np.stack(columns, axis=-1), np.nan)


@dataclass(frozen=True)
class _Boxes:
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
def _boxes(gripper: Gripper, opening: float) -> _Boxes:
    poses, placed, halves = gripper.link_poses(opening), [], []
    for link in gripper.links:
        for shape in link.shapes if link.collision is not None else ():
            low, high = np.asarray(shape.mesh.bounds)
            gripper_from_box = poses[link.name] @ shape.link_from_shape
            gripper_from_box[:3, 3] += gripper_from_box[:3, :3] @ (low + high) / 2
            placed.append(gripper_from_box)
            halves.append((high - low) / 2)
    gripper_from_boxes, halves = np.stack(placed), np.stack(halves)
    turns, middles = gripper_from_boxes[:, :3, :3].transpose(0, 2, 1), gripper_from_boxes[:, :3, 3]
    around = np.einsum("bij,bi->bj", np.abs(turns), halves)
    places = -np.einsum("bij,bj->bi", turns, middles)
    turns, places, halves = (np.ascontiguousarray(part, np.float32) for part in (turns, places, halves))
    return _Boxes(turns, places, halves, np.stack([middles - around, middles + around]))


def _swept(
    corners: Float[np.ndarray, "2 *b 3"], margin: float, shifts: Float[np.ndarray, "c 3"]
) -> Float32[np.ndarray, "2 *b 3"]:
    """Low and high corners of what boxes sweep under these shifts, and a margin around it [m]."""
    low, high = corners[0] + shifts.min(axis=0) - margin, corners[1] + shifts.max(axis=0) + margin
    return np.stack([low, high]).astype(np.float32)


def _levers(
    grasp: WarpedGrasp, centres: Float[np.ndarray, "s 3"], shifts: Float[np.ndarray, "c 3"]
) -> Float[np.ndarray, "c s"]:
    """How far the weight lies from where the pads would hold it best [m]: see `ABOVE`, `BELOW`, `ASIDE`."""
    rotation = grasp.object_from_gripper[:3, :3]
    local = ((centres - grasp.object_from_gripper[:3, 3]) @ rotation)[None] - shifts[:, None]
    up = rotation.T @ UP
    across = np.abs(local[..., 1] * up[2] - local[..., 2] * up[1])
    height = local[..., 1:] @ up[1:]
    upright = ABOVE * np.maximum(height, 0) + BELOW * np.maximum(-height, 0)
    return across + upright + ASIDE * np.abs(local[..., 0])


def _pad_corridor(gripper: Gripper, opening: float, width: float) -> Float[np.ndarray, "2 3"]:
    """The box between the pads that they sweep when closing: its low and high corner [m]."""
    middle = float(gripper.pad_middle(np.array([opening]))[0])
    across = gripper.pad_faces(np.array([width])).across[0].mean(axis=0)
    size = np.minimum(gripper.pads[0].size, gripper.pads[1].size)
    low = np.array([middle - opening / 2, *(across - size / 2)])
    high = np.array([middle + opening / 2, *(across + size / 2)])
    return np.stack([low, high])


def _receding(faces: PadFaces, across: Float32[np.ndarray, "2 m"]) -> Float32[np.ndarray, "2 m"]:
    """How far the face of each pad recedes along +x at these y and z, gripper frame [m]."""
    middle = faces.across[0].mean(axis=0).astype(np.float32)
    return faces.slopes[0].astype(np.float32) @ (across - middle[:, None])


@njit(**COMPILE)
@no_type_check
def _near(points, turn, shift, corners):
    """Points (3, p) turned and shifted back, those that then lie between two corners, and their numbers."""
    count = 0
    kept, numbers = np.empty((3, points.shape[1]), np.float32), np.empty(points.shape[1], np.int64)
    for p in range(points.shape[1]):
        inside = True
        for axis in range(3):
            place = turn[axis, 0] * points[0, p] + turn[axis, 1] * points[1, p] + turn[axis, 2] * points[2, p]
            place -= shift[axis]
            if not corners[0, axis] < place < corners[1, axis]:
                inside = False
                break
            kept[axis, count] = place
        if inside:
            numbers[count] = p
            count += 1
    return kept[:, :count].copy(), numbers[:count].copy()


@njit(**COMPILE)
@no_type_check
def _clear(points, draw, boxes, corners, shifts, clearance):
    """Lower each shift's and draw's clearance to the signed distance of its points to the nearest box [m].

    Every other point is near enough to the next for fingers, and they are most of the work.
    """
    turns, places, halves = boxes
    moved, still = np.empty((len(shifts), 3), np.float32), np.empty(3, np.float32)
    for b in range(len(halves)):
        turn, half = turns[b], halves[b]
        for c in range(len(shifts)):
            for axis in range(3):
                moved[c, axis] = (
                    turn[axis, 0] * shifts[c, 0] + turn[axis, 1] * shifts[c, 1] + turn[axis, 2] * shifts[c, 2]
                )
        for p in range(0, points.shape[1], 2):
            x, y, z = points[0, p], points[1, p], points[2, p]
            if not (corners[0, b, 0] < x < corners[1, b, 0] and corners[0, b, 1] < y < corners[1, b, 1]
                    and corners[0, b, 2] < z < corners[1, b, 2]):  # fmt: skip
                continue
            for axis in range(3):
                still[axis] = turn[axis, 0] * x + turn[axis, 1] * y + turn[axis, 2] * z + places[b, axis]
            for c in range(len(shifts)):
                outside, deepest = np.float32(0), np.float32(-np.inf)
                for axis in range(3):
                    beyond = abs(still[axis] - moved[c, axis]) - half[axis]
                    outside += max(beyond, np.float32(0)) ** 2
                    deepest = max(deepest, beyond)
                distance = np.sqrt(outside) + min(deepest, np.float32(0))
                clearance[c, draw[p]] = min(clearance[c, draw[p]], distance)


@njit(**COMPILE)
@no_type_check
def _meet(points, facing, draw, recede, corners, shifts, draws):
    """What closing pads meet: how many points, and how flat they lie; of the pad that meets less.

    Towards -x the -x pad, towards +x the other; a pad's own points are those within `PATCH` of the first.

    Args:
        points: (3, p) gripper frame before the shifts [m].
        facing: (2, p) of the -x and the +x pad: cosine of the angle between its face and their normals.
        draw: (p,) which draw each is of.
        recede: (2, p) how far the face of each pad recedes along +x there, before the shifts [m].
        corners: (2, 3) of what the pads sweep, see `_pad_corridor`.
    """
    count = np.zeros((2, len(shifts), draws), np.int64)
    flatness = np.zeros((2, len(shifts), draws))
    first = np.full((2, draws), -np.inf)
    inside = np.empty(points.shape[1], np.bool_)
    for c in range(len(shifts)):
        first[:] = -np.inf
        for p in range(points.shape[1]):
            inside[p] = True
            for axis in range(3):
                place = points[axis, p] - shifts[c, axis]
                inside[p] &= corners[0, axis] < place < corners[1, axis]
            if inside[p]:
                x = points[0, p] - shifts[c, 0]
                first[0, draw[p]] = max(first[0, draw[p]], recede[0, p] - x)
                first[1, draw[p]] = max(first[1, draw[p]], x - recede[1, p])
        for p in range(points.shape[1]):
            if inside[p]:
                x = points[0, p] - shifts[c, 0]
                for pad in range(2):
                    ahead = recede[0, p] - x if pad == 0 else x - recede[1, p]
                    if ahead > first[pad, draw[p]] - PATCH:
                        count[pad, c, draw[p]] += 1
                        flatness[pad, c, draw[p]] += facing[pad, p]
    flatness /= np.maximum(count, 1)
    return np.minimum(count[0], count[1]), np.minimum(flatness[0], flatness[1])
