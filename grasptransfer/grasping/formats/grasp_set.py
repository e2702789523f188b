"""What every format is read into and written from, and the frames they use for a grasp.

| format | gripper axes | origin |
| --- | --- | --- |
| ours | +z approach, +x closing | TCP, between the pads |
| ACRONYM, GraspGen, Contact-GraspNet | +z approach, +x closing | gripper base |
| isaac_grasp | those of the link it names | that link |
| graspnetAPI | +x approach, +y closing | grasp centre, finger tips `depth` ahead |
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from grasptransfer.errors import GraspFileError, PoseError
from grasptransfer.frames import check_rigid
from grasptransfer.grasping.grasp import Grasp
from grasptransfer.grasping.gripper import Gripper


@dataclass(frozen=True)
class GraspSet:
    """Grasps of one object, in that object's frame.

    Args:
        grasps: TCP poses in the object's frame; `canonical_from_gripper` means `object_from_gripper` here.
        object_frame: name of that frame.
        object_file: mesh the grasps belong to, where the file says so.
        object_scale: factor from that mesh to metres.
    """

    grasps: tuple[Grasp, ...]
    object_frame: str = "object"
    object_file: str | None = None
    object_scale: float = 1.0


def base_from_tcp(gripper: Gripper) -> Float[np.ndarray, "4 4"]:
    """From the TCP to the gripper base with the TCP's axes: ACRONYM's and GraspGen's frame."""
    moved = np.eye(4)
    moved[:3, 3] = gripper.base_from_tcp[:3, :3].T @ gripper.base_from_tcp[:3, 3]
    return moved


def rigid_poses(values: object, path: Path, key: str) -> Float[np.ndarray, "g 4 4"]:
    """Check a list of poses, naming the one at fault.

    Raises:
        GraspFileError: not (n, 4, 4), or one of them not rigid or in millimetres.
    """
    try:
        poses = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise GraspFileError("must hold 4x4 matrices of numbers", path=path, key=key) from error
    if poses.size == 0:
        raise GraspFileError("holds no grasp", path=path, key=key)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise GraspFileError("must be of shape (n, 4, 4)", path=path, key=key, value=poses.shape)
    checked = []
    for i, pose in enumerate(poses):
        try:
            checked.append(check_rigid(pose, f"{key}[{i}]"))
        except PoseError as error:
            raise error.at(path, kind=GraspFileError) from error
    return np.stack(checked)


def numbered(
    poses: Float[np.ndarray, "g 4 4"],
    confidences: Float[np.ndarray, "g"] | Bool[np.ndarray, "g"],
    widths: Sequence[float | None],
) -> tuple[Grasp, ...]:
    """Grasps of a format without names: `grasp_0`, `grasp_1`, ..."""
    return tuple(
        Grasp(f"grasp_{i}", "grasp", pose, width, confidence=float(confidence))
        for i, (pose, confidence, width) in enumerate(zip(poses, confidences, widths, strict=True))
    )


def stacked(grasps: tuple[Grasp, ...]) -> Float[np.ndarray, "g 4 4"]:
    """Their TCP poses."""
    return np.stack([grasp.canonical_from_gripper for grasp in grasps])
