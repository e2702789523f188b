"""graspnetAPI npy: 17 numbers a grasp: score, width, height, depth, R (9), t (3), object id.

R's columns are approach, closing and their cross product. The origin is the grasp centre, and the
finger tips reach `depth` past it; here the tips decide where the TCP lies.
"""

from pathlib import Path

import numpy as np

from grasptransfer.errors import GraspFileError
from grasptransfer.files import replacing
from grasptransfer.grasping.formats.grasp_set import GraspSet, numbered, rigid_poses, stacked
from grasptransfer.grasping.gripper import Gripper

COLUMNS = 17
# Our axes (x closing, y, z approach) as columns of graspnetAPI's (x approach, y closing, z).
GRASPNET_FROM_TCP = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])


def tip_distance(gripper: Gripper) -> float:
    """How far the finger tips reach past the TCP [m]."""
    meshes = gripper.link_meshes(gripper.max_width / 2)
    return float(max(meshes[pad.link].bounds[1, 2] for pad in gripper.pads))


def read(path: Path, gripper: Gripper) -> GraspSet:
    """Read a graspnetAPI array; poses stay in the frame the array is in, usually the camera's."""
    try:
        rows = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise GraspFileError("is not a readable npy array", path=path, fix=str(error)) from error
    if not isinstance(rows, np.ndarray) or rows.ndim != 2 or rows.shape[1] != COLUMNS:
        raise GraspFileError(
            f"must be of shape (n, {COLUMNS})", path=path, value=getattr(rows, "shape", type(rows))
        )
    rows = rows.astype(float)
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = rows[:, 4:13].reshape(-1, 3, 3), rows[:, 13:16]
    poses = rigid_poses(poses, path, "grasps")
    beyond = rows[:, 3] - tip_distance(gripper)
    poses[:, :3, 3] += poses[:, :3, 0] * beyond[:, None]
    poses[:, :3, :3] = poses[:, :3, :3] @ GRASPNET_FROM_TCP
    return GraspSet(numbered(poses, np.clip(rows[:, 0], 0, 1), rows[:, 1].tolist()), "camera")


def write(grasp_set: GraspSet, path: Path, gripper: Gripper) -> None:
    """Write a graspnetAPI array with its grasp centre at the TCP; the object id is 0."""
    poses = stacked(grasp_set.grasps)
    rows = np.zeros((len(poses), COLUMNS))
    rows[:, 0] = [grasp.confidence for grasp in grasp_set.grasps]
    rows[:, 1] = [gripper.max_width if g.width is None else g.width for g in grasp_set.grasps]
    rows[:, 2] = gripper.pads[0].size[0]
    rows[:, 3] = tip_distance(gripper)
    rows[:, 4:13] = (poses[:, :3, :3] @ GRASPNET_FROM_TCP.T).reshape(-1, 9)
    rows[:, 13:16] = poses[:, :3, 3]
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.save(file, rows, allow_pickle=False)
