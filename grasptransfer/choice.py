"""Which of the usable grasps comes first: those that the robot reaches, and a choice that stays.

The first grasp is that of the highest score; scores have six decimals, and of equals the one annotated first
leads, so that the last bits of a number decide nothing. With a preferred grasp or direction, a usable grasp
that agrees with it comes first unless another is better by more than `MARGIN`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.errors import NOT_NUMBERS, NotSucceeded, SettingsError
from grasptransfer.frames import rotation_angle
from grasptransfer.grasping import CheckStatus
from grasptransfer.result import TransferredGrasp, TransferResult

if TYPE_CHECKING:
    from grasptransfer.perception.pose_search import FoundPose

MARGIN = 0.05  # of score, by which another grasp must be better than the preferred one
LEVER = 0.1  # m/rad: a turn by one radian counts as much as this shift, about a hand's length
NEAR = 0.06  # m, turns included: a grasp farther from the preferred one is another grasp
ALONG = np.cos(np.deg2rad(30))  # approaches within this angle agree with a preferred direction
TURNED_HAND = Rotation.from_rotvec([0, 0, np.pi]).as_matrix()  # two fingers swapped: the same grasp

Reachable = Callable[[Float[np.ndarray, "4 4"]], bool]
Prefer = TransferredGrasp | Float[np.ndarray, " 3"] | Sequence[float]


def chosen(
    result: TransferResult,
    *,
    found: tuple[FoundPose, ...] = (),
    reachable: Reachable | None = None,
    prefer: Prefer | None = None,
) -> TransferResult:
    """The result with its grasps in the order in which to execute them.

    Args:
        result: of a transfer.
        found: poses that the search proposed, the one taken first; its chance then counts in every score.
        reachable, prefer: as of `within_reach` and `preferred`.
    """
    grasps = result.grasps
    if found:
        grasps = tuple(replace(grasp, score=grasp.score * found[0].chance) for grasp in grasps)
    if reachable is not None:
        grasps = within_reach(grasps, reachable)
    if prefer is not None:
        grasps = preferred(grasps, prefer)
    return replace(result, grasps=grasps, found_poses=found)


def in_order(grasps: Sequence[TransferredGrasp]) -> tuple[TransferredGrasp, ...]:
    """Best first, those that failed a check last; of equals the one annotated first leads."""
    return tuple(sorted(grasps, key=lambda grasp: (not grasp.usable, -grasp.score)))


def within_reach(grasps: Sequence[TransferredGrasp], reachable: Reachable) -> tuple[TransferredGrasp, ...]:
    """The grasps in order, with usable ones marked that the robot cannot go to, and why.

    Args:
        reachable: says whether the robot reaches a pose of the TCP, `world_from_gripper` (4, 4) [m]. It is
            asked for the grasp, then for its pre-grasp and the lift.

    Raises:
        SettingsError: `world_from_camera` was not given, or the callback's answer is neither True nor False.
    """
    if not callable(reachable):
        raise SettingsError("must be a callback", key="reachable", value=type(reachable).__name__)
    return in_order([_checked(grasp, reachable) if grasp.usable else grasp for grasp in grasps])


def preferred(grasps: Sequence[TransferredGrasp], prefer: object) -> tuple[TransferredGrasp, ...]:
    """The grasps with the preferred one first, unless another is better by more than `MARGIN`.

    Args:
        grasps: in order.
        prefer: the grasp chosen last, which may be of another picture; or the direction (3,) in which the
            gripper should come in: world axes where `world_from_camera` is known, else camera axes.

    Raises:
        SettingsError: it is neither.
    """
    usable = [grasp for grasp in grasps if grasp.usable]
    if not usable:
        return tuple(grasps)
    close = [grasp for grasp in usable if grasp.score >= usable[0].score - MARGIN]
    if isinstance(prefer, TransferredGrasp):
        apart, limit = [distance(grasp, prefer) for grasp in close], NEAR
    else:
        direction = _unit(prefer)
        apart, limit = [-float(_pose(grasp)[:3, 2] @ direction) for grasp in close], -ALONG
    nearest = int(np.argmin(apart))
    return _with_first(grasps, close[nearest]) if apart[nearest] <= limit else tuple(grasps)


def distance(a: TransferredGrasp, b: TransferredGrasp) -> float:
    """How far two grasps are apart [m], a turn counted by `LEVER`.

    They are compared on the object, which may have moved, and in the world or camera, as a round object's own
    axes turn from picture to picture; the smaller distance counts.
    """
    both_in_world = a.world_from_camera is not None and b.world_from_camera is not None
    around = (
        (a.world_from_gripper, b.world_from_gripper)
        if both_in_world
        else (a.camera_from_gripper, b.camera_from_gripper)
    )
    return min(_apart(*around), _apart(a.object_from_gripper, b.object_from_gripper))


def _apart(a: Float[np.ndarray, "4 4"], b: Float[np.ndarray, "4 4"]) -> float:
    turns = (rotation_angle(a[:3, :3].T @ b[:3, :3] @ hand) for hand in (np.eye(3), TURNED_HAND))
    return float(np.linalg.norm(a[:3, 3] - b[:3, 3])) + LEVER * min(turns)


def raise_unless_succeeded(result: TransferResult) -> None:
    """
    Raises:
        NotSucceeded: the shape estimate did not succeed, or no grasp is usable.
    """
    from grasptransfer.perception.estimate import EstimateStatus

    if result.status is not EstimateStatus.OK:
        raise NotSucceeded(result.advice, key="status", value=result.status.value)
    if not result.usable:
        reasons = "; ".join(sorted({grasp.reason for grasp in result.grasps}))
        raise NotSucceeded("no usable grasp", key="grasps", value=reasons)


def _checked(grasp: TransferredGrasp, reachable: Reachable) -> TransferredGrasp:
    _ = grasp.world_from_gripper  # says that `world_from_camera` is missing, where it is
    steps = grasp.waypoints()
    for what, pose in (("grasp", steps.grasp), ("pre-grasp", steps.pre_grasp), ("lift", steps.lift)):
        answer = reachable(pose.copy())
        if not isinstance(answer, bool | np.bool_):
            raise SettingsError("must answer True or False", key="reachable", value=answer)
        if not answer:
            x, y, z = (round(float(value), 3) for value in pose[:3, 3])
            reason = f"the robot does not reach its {what} at x {x}, y {y}, z {z} m of the world"
            return replace(grasp, check=replace(grasp.check, status=CheckStatus.OUT_OF_REACH, reason=reason))
    return grasp


def _pose(grasp: TransferredGrasp) -> Float[np.ndarray, "4 4"]:
    return grasp.camera_from_gripper if grasp.world_from_camera is None else grasp.world_from_gripper


def _unit(direction: object) -> Float[np.ndarray, " 3"]:
    try:
        vector = np.array(direction, dtype=float)
    except NOT_NUMBERS:
        vector = np.zeros(0)
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not np.isfinite(length) or length == 0:
        choices = ("a grasp of an earlier result", "a direction of three numbers")
        raise SettingsError("is no preference", key="prefer", value=direction, choices=choices)
    return vector / length


def _with_first(grasps: Sequence[TransferredGrasp], first: TransferredGrasp) -> tuple[TransferredGrasp, ...]:
    return (first, *(grasp for grasp in grasps if grasp is not first))
