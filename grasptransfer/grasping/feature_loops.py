"""Loops over points of drawn objects near an opened gripper; what is too far away is dropped at once.

Compiled functions hold loops over numbers alone: what they call of numpy takes longest to compile, in every
fresh installation.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Float, Float32, Int
from numba import njit

from grasptransfer.grasping.gripper_boxes import COMPILE, NOTHING

# m behind the first point that a pad meets: to here a point counts whole, and from there not at all; their
# middle is one spacing of the points on a curved side.
PATCH, BEHIND = 0.0015, 0.0035
EDGE = 0.002  # m: a point this far beside a pad's edge counts nothing, as far inside it whole


def points_near(
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
    """Write the points of `points_near` and their numbers; how many they are."""
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
def clear(points, draw, boxes, corners, moved, clearance):
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


def meet(
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
        corners: of what the pads sweep, between them.
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
