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
from jaxtyping import Float, Int

from grasptransfer.frames import invert, transform_points
from grasptransfer.grasping.collision import CheckStatus, GraspCheck
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.grasping.plausible import PlausibleObjects
from grasptransfer.grasping.warping import WarpedGrasp

FAR = 0.003  # m: more clearance than this is no better
WITHIN = 0.012  # m: deeper inside the gripper than this is no worse
UP = np.array([0.0, 0.0, 1.0])  # object frame: categories stand upright
TILT = np.deg2rad(30)  # how far a held object is turned about the closing line, both ways
PATCH = 0.0025  # m behind the first point that a pad meets: one spacing of the points on a curved side
FEATURES = ("clearance", "flatness", "coverage", "moment")
WEIGHTS = ("entry", "clearance", "bias", "flatness", "coverage", "moment")

Features = Float[np.ndarray, "s 4"]
Weights = Float[np.ndarray, "6"]


@dataclass(frozen=True)
class Ranking:
    """The logistic models of a grasp on one drawn object, and what counts as unlikely.

    Args:
        entry, clearance: of getting there, fitted to simulated grasps by `grasptransfer bench calibration`.
        bias, flatness, coverage, moment: of holding, fitted likewise.
        least_chance: a grasp that the gripper reaches is unusable below this score.

    The features: clearance in mm (between -12 and 3), flatness as a cosine, coverage as a share of a pad's
    points, moment in kg cm: how hard the weight turns the object about the closing line while the hand
    tilts it by up to `TILT`. What hangs straight below the pads has little of it; what lies beside them has
    all, and a closing line that stands upright has none.
    """

    entry: float = 1.50
    clearance: float = 0.96
    bias: float = 1.56
    flatness: float = 1.92
    coverage: float = 0.28
    moment: float = -1.78
    least_chance: float = 0.4

    @property
    def weights(self) -> Weights:
        """`WEIGHTS`, in their order."""
        return np.array([getattr(self, name) for name in WEIGHTS])


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
    weights = (settings or Ranking()).weights
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
        _features(grasp, check.opening, gripper, plausible) if check.usable else np.zeros((0, len(FEATURES)))
        for grasp, check in zip(grasps, checks, strict=True)
    ]


def expected_success(
    features: Float[np.ndarray, "*g s 4"], weights: Weights
) -> Float[np.ndarray, "*g"] | np.floating:
    """Mean chance of getting there and holding, over the draws; where a pad meets nothing there is none."""
    entry, clearance, bias, *others = weights
    enters = _logistic(entry + clearance * features[..., 0])
    holds = _logistic(bias + features[..., 1:] @ np.array(others))
    return np.nan_to_num(enters * holds, nan=0.0).mean(axis=-1)


def _logistic(odds: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-odds))


def doubt_unlikely(
    checks: Sequence[GraspCheck], scores: Sequence[float], *, least_chance: float = Ranking.least_chance
) -> list[GraspCheck]:
    """The checks, with grasps that are reached but unlikely to hold made unusable, and the reason why."""
    return [
        replace(check, status=CheckStatus.UNLIKELY_TO_HOLD, reason=_doubt(score))
        if check.usable and score < least_chance
        else check
        for check, score in zip(checks, scores, strict=True)
    ]


def _doubt(score: float) -> str:
    return f"expected success {score:.0%} over the shapes and poses that the picture leaves possible"


def _features(grasp: WarpedGrasp, opening: float, gripper: Gripper, plausible: PlausibleObjects) -> Features:
    """`FEATURES` in each draw; NaN where a pad meets nothing."""
    pose, draws = grasp.object_from_gripper.astype(np.float32), len(plausible.points)
    points, normals = plausible.rows
    local = pose[:3, :3].T @ points - (pose[:3, :3].T @ pose[:3, 3])[:, None]
    boxes = _boxes(gripper, opening)
    near = np.flatnonzero(_within(local, _bounds(boxes), FAR))
    local, draw = local[:, near], near // plausible.points.shape[1]
    # Every other point is near enough to the next for fingers, and they are most of the work.
    clearance = _clearance(local[:, ::2], draw[::2], boxes, draws)
    between = np.flatnonzero(_within(local, _pad_corridor(gripper, opening, grasp.width), 0.0))
    x, draw, facing = local[0, between], draw[between], pose[:3, 0] @ normals[:, near[between]]
    # Towards -x those that the -x pad meets, towards +x those of the other: each pad's points face it.
    low, high = (_touched(side * x, side * facing, draw, draws) for side in (-1, 1))
    count = np.minimum(low.count, high.count)
    columns = [
        clearance * 1e3,
        np.minimum(low.flatness, high.flatness),
        np.minimum(count / 4, 1),
        plausible.mass * _levers(grasp, plausible.centres) * 100,
    ]
    return np.where(count[:, None] > 0, np.stack(columns, axis=1), np.nan)


@dataclass(frozen=True)
class _Touched:
    """What one pad meets in each draw: how many points, how flat; 0 where it meets none."""

    count: Int[np.ndarray, "s"]
    flatness: Float[np.ndarray, "s"]


def _touched(ahead: np.ndarray, cosines: np.ndarray, draw: np.ndarray, draws: int) -> _Touched:
    """The points of each draw that a pad meets first.

    Args:
        ahead: how far towards the pad each point lies [m].
        cosines: of the angle between its normal and the pad's.
        draw: which draw it is of.
    """
    first = np.full(draws, -np.inf)
    np.maximum.at(first, draw, ahead)
    met = ahead > first[draw] - PATCH
    count = np.bincount(draw[met], minlength=draws)
    flatness = np.bincount(draw[met], weights=cosines[met], minlength=draws) / np.maximum(count, 1)
    return _Touched(count, flatness)


def _levers(grasp: WarpedGrasp, centres: Float[np.ndarray, "s 3"]) -> Float[np.ndarray, "s"]:
    """Lever of the weight about the line between the pads, in the worst tilt about that line [m]."""
    rotation = grasp.object_from_gripper[:3, :3]
    beside = ((centres - grasp.object_from_gripper[:3, 3]) @ rotation)[:, 1:]
    upright = (rotation.T @ UP)[1:]
    across = np.abs(beside[:, 0] * upright[1] - beside[:, 1] * upright[0])
    angle = np.arctan2(across, np.abs(beside @ upright))
    worst = np.sin(np.minimum(angle + TILT, np.pi / 2))
    return np.linalg.norm(beside, axis=1) * np.linalg.norm(upright) * worst


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


def _clearance(points: np.ndarray, draw: np.ndarray, boxes: list, draws: int) -> Float[np.ndarray, "s"]:
    """Signed distance of each draw's points (3, p) to the nearest box [m], from -`WITHIN` to `FAR`."""
    clearance = np.full(draws, FAR)
    for box in boxes:
        near = np.flatnonzero(_within(points, _bounds([box]), FAR))
        np.minimum.at(clearance, draw[near], _distances(points[:, near], *box))
    return np.maximum(clearance, -WITHIN)


def _distances(
    points: np.ndarray, box_from_gripper: Float[np.ndarray, "4 4"], half: Float[np.ndarray, "3"]
) -> np.ndarray:
    """Signed distance of points (3, p) to a box of this half size [m], negative inside."""
    beyond = np.abs(box_from_gripper[:3, :3] @ points + box_from_gripper[:3, 3:]) - half[:, None]
    return np.linalg.norm(np.maximum(beyond, 0), axis=0) + np.minimum(beyond.max(axis=0), 0)


def _pad_corridor(
    gripper: Gripper, opening: float, width: float
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """The box between the pads that they sweep when closing: its low and high corner [m]."""
    height = float(gripper.pad_heights(np.array([width])).mean())
    size = np.minimum(gripper.pads[0].size, gripper.pads[1].size)
    low = np.array([-opening / 2, -size[0] / 2, height - size[1] / 2])
    high = np.array([opening / 2, size[0] / 2, height + size[1] / 2])
    return low, high


def _within(points: np.ndarray, corners: tuple, margin: float) -> np.ndarray:
    """Which of the points (3, p) lie between two corners, or no farther outside than the margin [m]."""
    inside = np.ones(points.shape[1], dtype=bool)
    for row, low, high in zip(points, *corners, strict=True):
        inside &= row > float(low - margin)  # a numpy float64 would make every comparison one
        inside &= row < float(high + margin)
    return inside
