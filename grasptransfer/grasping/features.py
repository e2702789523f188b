"""What the ranking judges by: points of drawn objects near an opened gripper, shift by shift, draw by draw.

The loops over points are compiled; each point is dropped as soon as one of its coordinates is too far away.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Float, Float32, Int
from numba import njit

from grasptransfer.grasping.gripper import Gripper, PadFaces
from grasptransfer.grasping.gripper_boxes import COMPILE, NOTHING, gripper_boxes, swept
from grasptransfer.grasping.plausible import PlausibleObjects
from grasptransfer.grasping.warping import WarpedGrasp

FAR = 0.003  # m: more clearance than this is no better
WITHIN = 0.012  # m: deeper inside the gripper than this is no worse
# The weight's lever counts whole across the closing line, and these shares of it above the pads (it topples
# when the hand tilts), below them (it swings), and along the line (one pad bears it all). Of 2969 simulated
# grasps that were reached; tests/test_ranking.py has the order.
ABOVE, BELOW, ASIDE = 0.7, 0.4, 0.4
# m behind the first point that a pad meets: to here a point counts whole, and from there not at all; their
# middle is one spacing of the points on a curved side.
PATCH, BEHIND = 0.0015, 0.0035
EDGE = 0.002  # m: a point this far beside a pad's edge counts nothing, as far inside it whole
GRIP = 32.0  # N, friction times force of each pad of the simulation protocols: moments are scaled to it
# m/s2: the weight, and as much again in any direction, as the protocols shake.
ACCELERATION = 2 * 9.81


@dataclass(frozen=True)
class NearPoints:
    """The drawn points near one grasp, found once for several openings and shifts.

    Args:
        grasp, gripper, plausible: what is near to what.
        around: points near the gripper, gripper frame [m]: every other place of the surface, which is near
            enough to the next for fingers, and these are most of the work.
        around_draw: which draw each is of.
        between: points that the pads may meet, gripper frame [m].
        between_draw: which draw each is of.
        facing: cosine of the angle between the face of the -x, the +x pad and their normals.
        recede: how far each pad's face recedes along +x there [m].
    """

    grasp: WarpedGrasp
    gripper: Gripper
    plausible: PlausibleObjects
    around: Float32[np.ndarray, "3 p"]
    around_draw: Int[np.ndarray, "p"]
    between: Float32[np.ndarray, "3 q"]
    between_draw: Int[np.ndarray, "q"]
    facing: Float32[np.ndarray, "2 q"]
    recede: Float32[np.ndarray, "2 q"]

    @staticmethod
    def of(
        grasp: WarpedGrasp,
        gripper: Gripper,
        plausible: PlausibleObjects,
        *,
        openings: Sequence[float],
        shifts: Float[np.ndarray, "c 3"],
    ) -> "NearPoints":
        """The points that matter to any of these openings [m] and shifts of the TCP, gripper frame [m]."""
        draws, (points, normals) = len(plausible.points), plausible.rows
        pose = grasp.object_from_gripper.astype(np.float32)
        turn = np.ascontiguousarray(pose[:3, :3].T)
        place = turn @ pose[:3, 3]
        bounds = np.stack([gripper_boxes(gripper, opening).bounds for opening in openings])
        bounds = np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])
        around, number = _near(points, plausible.around, turn, place, swept(bounds, FAR, shifts), 2)
        corridors = np.stack([_pad_corridor(gripper, opening, grasp.width) for opening in openings])
        corridor = np.stack([corridors[:, 0].min(axis=0), corridors[:, 1].max(axis=0)])
        between, met = _near(points, plausible.around, turn, place, swept(corridor, EDGE, shifts), 1)
        faces = gripper.pad_faces(np.array([grasp.width]))
        facing = -(faces.normals[0].astype(np.float32) @ turn) @ normals.reshape(3, -1)[:, met]
        recede = _receding(faces, between[1:])
        return NearPoints(
            grasp, gripper, plausible, around, number % draws, between, met % draws, facing, recede
        )

    def features(
        self, opening: float, shifts: Float[np.ndarray, "c 3"], *, room: Float[np.ndarray, "c"] | None = None
    ) -> Float[np.ndarray, "c s 5"]:
        """`success_model.FEATURES` after each shift, in each draw; NaN where a pad meets nothing.

        Args:
            opening: opening of the gripper on the way in [m].
            shifts: shifts of the TCP, gripper frame [m].
            room: between gripper and obstacles after each shift [m]; None: nothing stands around.
        """
        plausible, draws, moved = self.plausible, len(self.plausible.points), shifts.astype(np.float32)
        boxes, clearance = gripper_boxes(self.gripper, opening), np.full((len(shifts), draws), FAR)
        turned = np.einsum("bij,cj->bci", boxes.turns, moved)
        _clear(self.around, self.around_draw, (boxes.turns, boxes.places, boxes.halves),
               swept(boxes.each, FAR, shifts), turned, clearance)  # fmt: skip
        if room is not None:
            clearance = np.minimum(clearance, room[:, None])
        corridor = _pad_corridor(self.gripper, opening, self.grasp.width).astype(np.float32)
        count, flatness = _meet(self.between, self.facing, self.between_draw, self.recede, corridor, moved,
                                draws)  # fmt: skip
        grip = np.full(draws, GRIP) if plausible.grip is None else plausible.grip
        moment = plausible.mass * _levers(self.grasp, plausible, shifts) * 100
        columns = [
            np.maximum(clearance, -WITHIN) * 1e3,
            flatness,
            np.minimum(count / 4, 1),
            moment * GRIP / grip,
            np.broadcast_to(plausible.mass * ACCELERATION / (2 * grip), moment.shape),
        ]
        return np.where(count[..., None] > 0, np.stack(columns, axis=-1), np.nan)


def features_around(
    grasp: WarpedGrasp,
    opening: float,
    gripper: Gripper,
    plausible: PlausibleObjects,
    *,
    room: float | None = None,
) -> Float[np.ndarray, "s 5"]:
    """`success_model.FEATURES` of a grasp in each draw; NaN where a pad meets nothing.

    Args:
        opening: opening of the gripper on the way in [m].
        room: between gripper and obstacles [m]; None: nothing stands around.
    """
    unmoved = np.zeros((1, 3))
    near = NearPoints.of(grasp, gripper, plausible, openings=[opening], shifts=unmoved)
    return near.features(opening, unmoved, room=None if room is None else np.array([room]))[0]


def _levers(
    grasp: WarpedGrasp, plausible: PlausibleObjects, shifts: Float[np.ndarray, "c 3"]
) -> Float[np.ndarray, "c s"]:
    """How far the weight lies from where the pads would hold it best [m]: see `ABOVE`, `BELOW`, `ASIDE`."""
    rotation = grasp.object_from_gripper[:3, :3]
    local = ((plausible.centres - grasp.object_from_gripper[:3, 3]) @ rotation)[None] - shifts[:, None]
    up = rotation.T @ plausible.up
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


# Compiled functions hold loops over numbers alone: what they call of numpy takes longest to compile, in every
# fresh installation.
def _near(
    points: Float32[np.ndarray, "3 m s"],
    around: tuple[Float32[np.ndarray, "3 m"], Float32[np.ndarray, "m"]],
    turn: Float32[np.ndarray, "3 3"],
    shift: Float32[np.ndarray, "3"],
    corners: Float32[np.ndarray, "2 3"],
    every: int,
) -> tuple[Float32[np.ndarray, "3 q"], Int[np.ndarray, "q"]]:
    """Points turned and shifted back that then lie between two corners, and their numbers.

    Args:
        around: middle of all draws of each place, and how far the farthest is from it: most places are left
            out by them.
        every: 1: all places; 2: every other one.
    """
    kept, numbers = np.empty((3, points[0].size), np.float32), np.empty(points[0].size, np.int64)
    count = _keep_near(points, around, turn, shift, corners, every, kept, numbers)
    return np.ascontiguousarray(kept[:, :count]), numbers[:count]


@njit(**COMPILE)
@no_type_check
def _keep_near(points, around, turn, shift, corners, every, kept, numbers):
    """Write the points of `_near` and their numbers; how many they are."""
    middle, spread = around
    draws, count = points.shape[2], 0
    for m in range(0, points.shape[1], every):
        inside = True
        for axis in range(3):
            place = turn[axis, 0] * middle[0, m] + turn[axis, 1] * middle[1, m] + turn[axis, 2] * middle[2, m]
            place -= shift[axis]
            inside &= corners[0, axis] - spread[m] < place < corners[1, axis] + spread[m]
        if not inside:
            continue
        for s in range(draws):
            inside = True
            for axis in range(3):
                place = turn[axis, 0] * points[0, m, s] + turn[axis, 1] * points[1, m, s]
                place += turn[axis, 2] * points[2, m, s] - shift[axis]
                kept[axis, count] = place
                if not corners[0, axis] < place < corners[1, axis]:
                    inside = False
                    break
            if inside:
                numbers[count] = m * draws + s
                count += 1
    return count


@njit(**COMPILE)
@no_type_check
def _clear(points, draw, boxes, corners, moved, clearance):
    """Lower each shift's and draw's clearance to the signed distance of its points to the nearest box [m].

    Args:
        moved: (b, c, 3) each shift, turned into the axes of each box [m].
    """
    turns, places, halves = boxes
    for b in range(len(halves)):
        for p in range(points.shape[1]):
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
                distance = max(dx, max(dy, dz))
                if distance > 0:
                    dx, dy, dz = max(dx, NOTHING), max(dy, NOTHING), max(dz, NOTHING)
                    distance = np.sqrt(dx * dx + dy * dy + dz * dz)
                if distance < clearance[c, s]:
                    clearance[c, s] = distance


def _meet(
    points: Float32[np.ndarray, "3 p"],
    facing: Float32[np.ndarray, "2 p"],
    draw: Int[np.ndarray, "p"],
    recede: Float32[np.ndarray, "2 p"],
    corners: Float32[np.ndarray, "2 3"],
    shifts: Float32[np.ndarray, "c 3"],
    draws: int,
) -> tuple[Float[np.ndarray, "c s"], Float[np.ndarray, "c s"]]:
    """What closing pads meet: how many points, and how flat they lie; of the pad that meets less.

    Towards -x the -x pad, towards +x the other. A pad's own points are those near the first that it meets; a
    point near the pad's edge counts less, and so does one that lies farther behind (`PATCH`, `BEHIND`), so
    that nothing jumps when a point passes either.

    Args:
        points: gripper frame before the shifts [m].
        facing: of the -x and the +x pad: cosine of the angle between its face and their normals.
        draw: which draw each is of.
        recede: how far the face of each pad recedes along +x there, before the shifts [m].
        corners: of what the pads sweep, see `_pad_corridor`.
    """
    first, count, flatness = met = np.zeros((3, 2, len(shifts), draws))
    first -= np.inf
    _add_met(points, facing, draw, recede, corners, shifts, np.empty(points.shape[1]), met)
    flatness /= np.maximum(count, 1e-9)
    return np.minimum(count[0], count[1]), np.minimum(flatness[0], flatness[1])


@njit(**COMPILE)
@no_type_check
def _add_met(points, facing, draw, recede, corners, shifts, share, met):
    """For each pad, shift and draw: where the first point lies, how much the points count, and their cosines.

    Args:
        share: (p,) room for how much each point counts.
        met: (3, 2, c, s) to begin with minus infinity, 0 and 0.
    """
    for c in range(len(shifts)):
        for p in range(points.shape[1]):
            x, s = points[0, p] - shifts[c, 0], draw[p]
            share[p] = 1.0 if corners[0, 0] < x < corners[1, 0] else 0.0
            for axis in range(1, 3):
                place = points[axis, p] - shifts[c, axis]
                inside = min(place - corners[0, axis], corners[1, axis] - place)
                share[p] *= min(max(0.5 + inside / (2 * EDGE), 0.0), 1.0)
            if share[p] > 0:
                back = (1 - share[p]) * BEHIND
                met[0, 0, c, s] = max(met[0, 0, c, s], recede[0, p] - x - back)
                met[0, 1, c, s] = max(met[0, 1, c, s], x - recede[1, p] - back)
        for p in range(points.shape[1]):
            if share[p] > 0:
                x, s = points[0, p] - shifts[c, 0], draw[p]
                for pad in range(2):
                    ahead = recede[0, p] - x if pad == 0 else x - recede[1, p]
                    behind = met[0, pad, c, s] - ahead
                    counts = share[p] * min(max((BEHIND - behind) / (BEHIND - PATCH), 0.0), 1.0)
                    met[1, pad, c, s] += counts
                    met[2, pad, c, s] += counts * facing[pad, p]
