"""What the ranking looks at: points of drawn objects near an opened gripper, shift by shift, draw by draw.

The loops over points are compiled; each point is dropped as soon as one of its coordinates is too far away.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import no_type_check

import numpy as np
from jaxtyping import Float, Float32, Int
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
NOTHING = np.float32(0)
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
    turned = np.einsum("bij,cj->bci", boxes.turns, moved)
    _clear(local, draw, boxes.turns, boxes.places, boxes.halves, _swept(boxes.each, FAR, shifts), turned,
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


def _near(
    points: Float32[np.ndarray, "3 p"],
    turn: Float32[np.ndarray, "3 3"],
    shift: Float32[np.ndarray, "3"],
    corners: Float32[np.ndarray, "2 3"],
) -> tuple[Float32[np.ndarray, "3 q"], Int[np.ndarray, "q"]]:
    """The points turned and shifted back that then lie between two corners, and their numbers."""
    kept, numbers = np.empty(points.shape, np.float32), np.empty(points.shape[1], np.int64)
    count = _keep_near(points, turn, shift, corners, kept, numbers)
    return np.ascontiguousarray(kept[:, :count]), numbers[:count]


# Compiled functions hold loops over numbers alone: what they call of numpy takes longest to compile.
@njit(**COMPILE)
@no_type_check
def _keep_near(points, turn, shift, corners, kept, numbers):
    """Write the points of `_near` and their numbers; how many they are."""
    count = 0
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
    return count


@njit(**COMPILE)
@no_type_check
def _clear(points, draw, turns, places, halves, corners, moved, clearance):
    """Lower each shift's and draw's clearance to the signed distance of its points to the nearest box [m].

    Every other point is near enough to the next for fingers, and they are most of the work.

    Args:
        moved: (b, c, 3) each shift, turned into the axes of each box [m].
    """
    for b in range(len(halves)):
        for p in range(0, points.shape[1], 2):
            x, y, z = points[0, p], points[1, p], points[2, p]
            if not (corners[0, b, 0] < x < corners[1, b, 0] and corners[0, b, 1] < y < corners[1, b, 1]
                    and corners[0, b, 2] < z < corners[1, b, 2]):  # fmt: skip
                continue
            along = turns[b, 0, 0] * x + turns[b, 0, 1] * y + turns[b, 0, 2] * z + places[b, 0]
            across = turns[b, 1, 0] * x + turns[b, 1, 1] * y + turns[b, 1, 2] * z + places[b, 1]
            up = turns[b, 2, 0] * x + turns[b, 2, 1] * y + turns[b, 2, 2] * z + places[b, 2]
            s = draw[p]
            for c in range(moved.shape[1]):
                dx = abs(along - moved[b, c, 0]) - halves[b, 0]
                dy = abs(across - moved[b, c, 1]) - halves[b, 1]
                dz = abs(up - moved[b, c, 2]) - halves[b, 2]
                deepest = max(dx, max(dy, dz))
                if deepest > 0:
                    dx, dy, dz = max(dx, NOTHING), max(dy, NOTHING), max(dz, NOTHING)
                    deepest = np.sqrt(dx * dx + dy * dy + dz * dz)
                if deepest < clearance[c, s]:
                    clearance[c, s] = deepest


def _meet(
    points: Float32[np.ndarray, "3 p"],
    facing: Float32[np.ndarray, "2 p"],
    draw: Int[np.ndarray, "p"],
    recede: Float32[np.ndarray, "2 p"],
    corners: Float32[np.ndarray, "2 3"],
    shifts: Float32[np.ndarray, "c 3"],
    draws: int,
) -> tuple[Int[np.ndarray, "c s"], Float[np.ndarray, "c s"]]:
    """What closing pads meet: how many points, and how flat they lie; of the pad that meets less.

    Towards -x the -x pad, towards +x the other; a pad's own points are those within `PATCH` of the first.

    Args:
        points: gripper frame before the shifts [m].
        facing: of the -x and the +x pad: cosine of the angle between its face and their normals.
        draw: which draw each is of.
        recede: how far the face of each pad recedes along +x there, before the shifts [m].
        corners: of what the pads sweep, see `_pad_corridor`.
    """
    first, count, flatness = met = np.zeros((3, 2, len(shifts), draws))
    first -= np.inf
    _count_met(points, facing, draw, recede, corners, shifts, np.empty(points.shape[1], np.bool_), met)
    flatness /= np.maximum(count, 1)
    return np.minimum(count[0], count[1]).astype(int), np.minimum(flatness[0], flatness[1])


@njit(**COMPILE)
@no_type_check
def _count_met(points, facing, draw, recede, corners, shifts, inside, met):
    """Add up, for each pad, shift and draw, how far ahead the first point lies, points met, their cosines.

    Args:
        inside: (p,) whatever it holds.
        met: (3, 2, c, draws) minus infinity, 0 and 0.
    """
    for c in range(len(shifts)):
        for p in range(points.shape[1]):
            x = points[0, p] - shifts[c, 0]
            y = points[1, p] - shifts[c, 1]
            z = points[2, p] - shifts[c, 2]
            inside[p] = (
                corners[0, 0] < x < corners[1, 0]
                and corners[0, 1] < y < corners[1, 1]
                and corners[0, 2] < z < corners[1, 2]
            )
            if inside[p]:
                ahead, s = recede[0, p] - x, draw[p]
                if ahead > met[0, 0, c, s]:
                    met[0, 0, c, s] = ahead
                ahead = x - recede[1, p]
                if ahead > met[0, 1, c, s]:
                    met[0, 1, c, s] = ahead
        for p in range(points.shape[1]):
            if inside[p]:
                x, s = points[0, p] - shifts[c, 0], draw[p]
                for pad in range(2):
                    ahead = recede[0, p] - x if pad == 0 else x - recede[1, p]
                    if ahead > met[0, pad, c, s] - PATCH:
                        met[1, pad, c, s] += 1
                        met[2, pad, c, s] += facing[pad, p]
