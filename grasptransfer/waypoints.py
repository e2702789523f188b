"""Where the TCP goes, one pose after the other, and the same in the layout of MoveIt's Grasp message."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.frames import invert
from grasptransfer.grasping import Gripper

LIFT = 0.10  # m: how far the protocols of `simulation` lift
LEAST = 0.5  # share of a way that a planner must manage at least


@dataclass(frozen=True)
class Waypoints:
    """Poses of the TCP, one after the other.

    Args:
        frame: "world" where `world_from_camera` is known, else "camera".
        pre_grasp: (4, 4) `frame_from_gripper` [m], the gripper open; from here straight along its +z.
        grasp: (4, 4) `frame_from_gripper` [m]; here the gripper closes.
        lift: (4, 4) `frame_from_gripper` [m], the gripper closed.
        up: (3,) direction of the lift in `frame`.
        opening: distance between the pads on the way in [m].
        width: distance between the pads when they touch [m].
    """

    frame: str
    pre_grasp: Float[np.ndarray, "4 4"]
    grasp: Float[np.ndarray, "4 4"]
    lift: Float[np.ndarray, "4 4"]
    up: Float[np.ndarray, "3"]
    opening: float
    width: float


def waypoints(
    frame: str,
    frame_from_gripper: Float[np.ndarray, "4 4"],
    up: Float[np.ndarray, "3"],
    *,
    approach_distance: float,
    opening: float,
    width: float,
) -> Waypoints:
    """Pre-grasp, grasp and lift of one grasp.

    Args:
        frame: name of the frame that the poses are in.
        frame_from_gripper: the grasp, the TCP's pose [m].
        up: unit vector in that frame, along which the object is lifted.
        approach_distance: length of the straight way in [m].
        opening, width: distance between the pads on the way in and when they touch [m].
    """
    before, after = frame_from_gripper.copy(), frame_from_gripper.copy()
    before[:3, 3] -= approach_distance * frame_from_gripper[:3, 2]
    after[:3, 3] += LIFT * up
    return Waypoints(frame, before, frame_from_gripper.copy(), after, up, opening, width)


def moveit_grasp(
    name: str, score: float, steps: Waypoints, gripper: Gripper, *, frame_id: str | None = None
) -> dict:
    """A grasp in the layout of `moveit_msgs/Grasp`: plain dictionaries, lists and numbers.

    Args:
        name: `id` of the message.
        score: its `grasp_quality`, the expected success.
        steps: waypoints of the grasp.
        gripper: `grasp_pose` is that of its base link, which the wrist carries, not of the TCP.
        frame_id: name of `steps.frame` in the robot's tf tree; None: that name itself.
    """
    frame_id = frame_id or steps.frame
    approach = gripper.base_from_tcp[:3, 2]
    way = float(np.linalg.norm(steps.grasp[:3, 3] - steps.pre_grasp[:3, 3]))
    return {
        "id": name,
        "pre_grasp_posture": _posture(gripper, steps.opening),
        "grasp_posture": _posture(gripper, steps.width),
        "grasp_pose": {
            "header": {"frame_id": frame_id},
            "pose": _pose(steps.grasp @ invert(gripper.base_from_tcp)),
        },
        "grasp_quality": float(score),
        "pre_grasp_approach": _translation(gripper.base_link, approach, way),
        "post_grasp_retreat": _translation(frame_id, steps.up, LIFT),
        "post_place_retreat": _translation(gripper.base_link, -approach, way),
        "max_contact_force": float(gripper.force_limit),
        "allowed_touch_objects": [],
    }


def _posture(gripper: Gripper, opening: float) -> dict:
    """`trajectory_msgs/JointTrajectory` of the finger joints, with one point."""
    positions = gripper.joint_positions(float(np.clip(opening, *gripper.opening)))
    return {
        "joint_names": list(positions),
        "points": [{"positions": [float(value) for value in positions.values()]}],
    }


def _pose(frame_from_link: Float[np.ndarray, "4 4"]) -> dict:
    x, y, z, w = Rotation.from_matrix(frame_from_link[:3, :3]).as_quat()
    place = dict(zip("xyz", (float(value) for value in frame_from_link[:3, 3]), strict=True))
    return {
        "position": place,
        "orientation": {"x": float(x), "y": float(y), "z": float(z), "w": float(w)},
    }


def _translation(frame_id: str, direction: Float[np.ndarray, "3"], distance: float) -> dict:
    """`moveit_msgs/GripperTranslation`."""
    vector = dict(zip("xyz", (float(value) for value in direction), strict=True))
    return {
        "direction": {"header": {"frame_id": frame_id}, "vector": vector},
        "desired_distance": distance,
        "min_distance": LEAST * distance,
    }
