"""What the ranking judges by: points of drawn objects near an opened gripper, shift by shift, draw by draw.

The loops over points are compiled (`feature_loops.py`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int

from grasptransfer.grasping.feature_loops import EDGE, clear, meet, points_near
from grasptransfer.grasping.gripper import Gripper, PadFaces
from grasptransfer.grasping.gripper_boxes import gripper_boxes, swept
from grasptransfer.grasping.plausible import PlausibleObjects
from grasptransfer.grasping.warping import WarpedGrasp

FAR = 0.003  # m: more clearance than this is no better
WITHIN = 0.012  # m: deeper inside the gripper than this is no worse
# The weight's lever counts whole across the closing line, and these shares of it above the pads (it topples
# when the hand tilts), below them (it swings), and along the line (one pad bears it all). Of 2969 simulated
# grasps that were reached; tests/test_ranking.py has the order.
ABOVE, BELOW, ASIDE = 0.7, 0.4, 0.4
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
        around, number = points_near(points, plausible.around, turn, place, swept(bounds, FAR, shifts), 2)
        corridors = np.stack([_pad_corridor(gripper, opening, grasp.width) for opening in openings])
        corridor = np.stack([corridors[:, 0].min(axis=0), corridors[:, 1].max(axis=0)])
        between, met = points_near(points, plausible.around, turn, place, swept(corridor, EDGE, shifts), 1)
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
        clear(self.around, self.around_draw, (boxes.turns, boxes.places, boxes.halves),
               swept(boxes.each, FAR, shifts), turned, clearance)  # fmt: skip
        if room is not None:
            clearance = np.minimum(clearance, room[:, None])
        corridor = _pad_corridor(self.gripper, opening, self.grasp.width).astype(np.float32)
        count, flatness = meet(self.between, self.facing, self.between_draw, self.recede, corridor, moved,
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
