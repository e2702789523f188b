"""How likely each grasp is to hold, over the shapes and poses that the picture leaves possible.

For every drawn object (`plausible.py`) the points near each opened gripper tell its clearance, what the
pads meet, how flat, and how hard the weight turns the object between them. One logistic model turns the
clearance into the chance of getting there, another the rest into that of holding; the score is the mean of
their product over the draws. One model of everything would let a firm grip make up for a palm in the object.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32, Int

from grasptransfer.frames import invert, transform_points
from grasptransfer.grasping.collision import CheckStatus, GraspCheck
from grasptransfer.grasping.gripper import Gripper, PadFaces
from grasptransfer.grasping.plausible import PlausibleObjects
from grasptransfer.grasping.success_model import FEATURES, Features, Ranking, expected_success
from grasptransfer.grasping.warping import WarpedGrasp

FAR = 0.003  # m: more clearance than this is no better
WITHIN = 0.012  # m: deeper inside the gripper than this is no worse
UP = np.array([0.0, 0.0, 1.0])  # object frame: categories stand upright
# The weight's lever counts whole across the closing line, and these shares of it above the pads (it topples
# when the hand tilts), below them (it swings), and along the line (one pad bears it all). Of 2969 simulated
# grasps that were reached; tests/test_ranking.py has the order.
ABOVE, BELOW, ASIDE = 0.7, 0.4, 0.4
PATCH = 0.0025  # m behind the first point that a pad meets: one spacing of the points on a curved side

_UNMOVED = np.zeros((1, 3))


def rank_grasps(
    grasps: Sequence[WarpedGrasp],
    checks: Sequence[GraspCheck],
    gripper: Gripper,
    *,
    plausible: PlausibleObjects,
    settings: Ranking | None = None,
) -> tuple[float, ...]:
    """Expected success of each grasp in [0, 1]; 0 for those that failed their check.

    Args:
        grasps: on the instance, object frame.
        checks: their checks.
        plausible: objects that the picture leaves possible; the same ones for all grasps.
    """
    weights = (settings or Ranking.fitted()).weights
    features = grasp_features(grasps, checks, gripper, plausible=plausible)
    return tuple(
        float(expected_success(each, weights)) if check.usable else 0.0
        for each, check in zip(features, checks, strict=True)
    )


def grasp_features(
    grasps: Sequence[WarpedGrasp],
    checks: Sequence[GraspCheck],
    gripper: Gripper,
    *,
    plausible: PlausibleObjects,
) -> list[Features]:
    """What the ranking looks at, for each usable grasp and draw; NaN where a pad meets nothing.

    Unusable grasps get no rows. Arguments as of `rank_grasps`.
    """
    return [
        features_around(grasp, check.opening, gripper, plausible, _UNMOVED)[0]
        if check.usable
        else np.zeros((0, len(FEATURES)))
        for grasp, check in zip(grasps, checks, strict=True)
    ]


def doubt_unlikely(
    checks: Sequence[GraspCheck],
    scores: Sequence[float],
    *,
    trust: float = 1.0,
    least_chance: float = Ranking.least_chance,
) -> list[GraspCheck]:
    """The checks, with grasps that are reached but unlikely to hold made unusable, and the reason why.

    Args:
        trust: chance that the picture shows the category, which the scores contain.
    """
    return [
        replace(check, status=CheckStatus.UNLIKELY_TO_HOLD, reason=_doubt(score, trust))
        if check.usable and score < least_chance
        else check
        for check, score in zip(checks, scores, strict=True)
    ]


def _doubt(score: float, trust: float) -> str:
    if trust < 0.5:
        return f"expected success {score:.0%}: the picture hardly shows this category at the told pose"
    return f"expected success {score:.0%} over the shapes and poses that the picture leaves possible"


def features_around(
    grasp: WarpedGrasp,
    opening: float,
    gripper: Gripper,
    plausible: PlausibleObjects,
    shifts: Float[np.ndarray, "c 3"],
) -> Float[np.ndarray, "c s 4"]:
    """`FEATURES` of a grasp shifted in each of these ways, in each draw; NaN where a pad meets nothing.

    Args:
        opening: of the gripper on the way in [m].
        shifts: of the TCP, gripper frame [m].
    """
    pose, draws = grasp.object_from_gripper.astype(np.float32), len(plausible.points)
    points, normals = plausible.rows
    local = pose[:3, :3].T @ points - (pose[:3, :3].T @ pose[:3, 3])[:, None]
    boxes, swept = _boxes(gripper, opening), (shifts.min(axis=0), shifts.max(axis=0))
    near = np.flatnonzero(_within(local, _bounds(boxes), FAR, swept))
    local, draw = local[:, near], near // plausible.points.shape[1]
    # Every other point is near enough to the next for fingers, and they are most of the work.
    clearance = _clearance(local[:, ::2], draw[::2], boxes, shifts, draws)
    corridor = _pad_corridor(gripper, opening, grasp.width)
    between = np.flatnonzero(_within(local, corridor, 0.0, swept))
    faces = gripper.pad_faces(np.array([grasp.width]))
    towards = pose[:3, :3] @ faces.normals[0].T.astype(np.float32)
    facing = np.stack([-(pad @ normals[:, near[between]]) for pad in towards.T])
    recede = _receding(faces, local[1:, between])
    met = _meet(local[:, between], facing, draw[between], corridor, recede, shifts, draws)
    columns = [
        clearance * 1e3,
        met.flatness,
        np.minimum(met.count / 4, 1),
        plausible.mass * _levers(grasp, plausible.centres, shifts) * 100,
    ]
    return np.where(met.count[..., None] > 0, np.stack(columns, axis=-1), np.nan)


@dataclass(frozen=True)
class _Met:
    """What the pads meet under each shift, in each draw; of the pad that meets less.

    Args:
        count: how many points; 0 where a pad meets none.
        flatness: mean cosine of the angle between their normals and the pad's.
    """

    count: Int[np.ndarray, "c s"]
    flatness: Float[np.ndarray, "c s"]


def _meet(
    points: Float32[np.ndarray, "3 p"],
    facing: Float32[np.ndarray, "2 p"],
    draw: Int[np.ndarray, "p"],
    corridor: tuple,
    recede: Float32[np.ndarray, "2 p"],
    shifts: Float[np.ndarray, "c 3"],
    draws: int,
) -> _Met:
    """What closing pads meet: towards -x the -x pad, towards +x the other; each pad's points face it.

    Args:
        points: gripper frame before the shifts [m].
        facing: of the -x and the +x pad: cosine of the angle between its face and their normals.
        draw: which draw each is of.
        corridor: what the pads sweep, see `_pad_corridor`.
        recede: how far the face of each pad recedes along +x there, before the shifts [m].
    """
    moved = points[None] - shifts[:, :, None].astype(np.float32)
    inside = np.ones(moved[:, 0].shape, dtype=bool)
    for axis, (low, high) in enumerate(zip(*corridor, strict=True)):
        inside &= (moved[:, axis] > float(low)) & (moved[:, axis] < float(high))
    shift, point = np.nonzero(inside)
    x, place = moved[shift, 0, point], shift * draws + draw[point]
    counts, flatness = zip(
        *(
            _touched(side * (x - back[point]), cosines[point], place, len(shifts) * draws)
            for side, cosines, back in zip((-1, 1), facing, recede, strict=True)
        ),
        strict=True,
    )
    shape = (len(shifts), draws)
    return _Met(np.minimum(*counts).reshape(shape), np.minimum(*flatness).reshape(shape))


def _touched(
    ahead: np.ndarray, cosines: np.ndarray, place: np.ndarray, places: int
) -> tuple[Int[np.ndarray, "q"], Float[np.ndarray, "q"]]:
    """How many points a pad meets first in each place, and how flat.

    Args:
        ahead: how far towards the pad each point lies [m].
        cosines: of the angle between its normal and the pad's.
        place: which shift and draw it is of.
    """
    first = np.full(places, -np.inf)
    np.maximum.at(first, place, ahead)
    met = ahead > first[place] - PATCH
    count = np.bincount(place[met], minlength=places)
    return count, np.bincount(place[met], weights=cosines[met], minlength=places) / np.maximum(count, 1)


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


def _boxes(gripper: Gripper, opening: float) -> list[tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "3"]]]:
    """Every part of the opened gripper as a box: `box_from_gripper` and half its size [m]."""
    poses = gripper.link_poses(opening)
    boxes = []
    for link in gripper.links:
        for shape in link.shapes if link.collision is not None else ():
            gripper_from_shape = poses[link.name] @ shape.link_from_shape
            low, high = np.asarray(shape.mesh.bounds)
            middle = np.eye(4)
            middle[:3, 3] = (low + high) / 2
            boxes.append((invert(gripper_from_shape @ middle), (high - low) / 2))
    return boxes


def _bounds(boxes: list) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Low and high corner of what holds all boxes, gripper frame [m]."""
    signs = np.array(list(itertools.product((-1, 1), repeat=3)))
    corners = np.concatenate([transform_points(invert(pose), signs * half) for pose, half in boxes])
    return corners.min(axis=0), corners.max(axis=0)


def _clearance(
    points: Float32[np.ndarray, "3 p"],
    draw: Int[np.ndarray, "p"],
    boxes: list,
    shifts: Float[np.ndarray, "c 3"],
    draws: int,
) -> Float[np.ndarray, "c s"]:
    """Signed distance of each draw's points to the nearest shifted box [m], from -`WITHIN` to `FAR`."""
    clearance = np.full(len(shifts) * draws, FAR)
    first = draws * np.arange(len(shifts))[:, None]
    swept = shifts.min(axis=0), shifts.max(axis=0)
    for box_from_gripper, half in boxes:
        near = np.flatnonzero(_within(points, _bounds([(box_from_gripper, half)]), FAR, swept))
        distances = _distances(points[:, near], box_from_gripper, half, shifts)
        close = distances < FAR
        np.minimum.at(clearance, (first + draw[near])[close], distances[close])
    return np.maximum(clearance, -WITHIN).reshape(len(shifts), draws)


def _distances(
    points: Float32[np.ndarray, "3 p"],
    box_from_gripper: Float[np.ndarray, "4 4"],
    half: Float[np.ndarray, "3"],
    shifts: Float[np.ndarray, "c 3"],
) -> Float32[np.ndarray, "c p"]:
    """Signed distance of points to a shifted box of this half size [m], negative inside."""
    rotation, place = (
        part.astype(np.float32) for part in (box_from_gripper[:3, :3], box_from_gripper[:3, 3:])
    )
    moved = shifts.astype(np.float32) @ rotation.T
    still = rotation @ points + place
    outside, deepest = np.float32(0), np.float32(-np.inf)
    for axis, row in enumerate(still):
        beyond = np.abs(row - moved[:, axis, None]) - np.float32(half[axis])
        outside = outside + np.square(np.maximum(beyond, 0))
        deepest = np.maximum(deepest, beyond)
    return np.sqrt(outside) + np.minimum(deepest, 0)


def _pad_corridor(
    gripper: Gripper, opening: float, width: float
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """The box between the pads that they sweep when closing: its low and high corner [m]."""
    middle = float(gripper.pad_middle(np.array([opening]))[0])
    across = gripper.pad_faces(np.array([width])).across[0].mean(axis=0)
    size = np.minimum(gripper.pads[0].size, gripper.pads[1].size)
    low = np.array([middle - opening / 2, *(across - size / 2)])
    high = np.array([middle + opening / 2, *(across + size / 2)])
    return low, high


def _receding(faces: PadFaces, across: Float32[np.ndarray, "2 m"]) -> Float32[np.ndarray, "2 m"]:
    """How far the face of each pad recedes along +x at these y and z, gripper frame [m]."""
    middle = faces.across[0].mean(axis=0).astype(np.float32)
    return faces.slopes[0].astype(np.float32) @ (across - middle[:, None])


def _within(points: np.ndarray, corners: tuple, margin: float, swept: tuple) -> np.ndarray:
    """Which of the points (3, p) lie between two corners under some shift, or nearer than the margin [m].

    Args:
        swept: least and largest shift of the corners along each axis [m].
    """
    inside = np.ones(points.shape[1], dtype=bool)
    for row, low, high, least, largest in zip(points, *corners, *swept, strict=True):
        inside &= row > float(low + least - margin)  # a numpy float64 would make every comparison one
        inside &= row < float(high + largest + margin)
    return inside
