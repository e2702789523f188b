"""graspnetAPI npy: 17 numbers a grasp: score, width, height, depth, R (9), t (3), object id.

R's columns are approach, closing and their cross product. The origin is the grasp centre, and the
finger tips reach `depth` past it; here the tips decide where the TCP lies.
"""

import logging
from pathlib import Path

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import GraspFileError
from grasptransfer.files import replacing
from grasptransfer.grasping.formats.grasp_set import (
    CAMERA,
    GraspSet,
    confidences_of,
    numbered,
    rigid_poses,
)
from grasptransfer.grasping.formats.hand_of_file import choose_gripper
from grasptransfer.grasping.gripper import Gripper

LOG = logging.getLogger(__name__)
COLUMNS = 17
# Our axes (x closing, y, z approach) as columns of graspnetAPI's (x approach, y closing, z).
GRASPNET_FROM_TCP = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])


def tip_distance(gripper: Gripper) -> float:
    """How far the finger tips reach past the TCP [m]."""
    meshes = gripper.link_meshes(gripper.max_width / 2)
    return float(max(meshes[pad.link].bounds[1, 2] for pad in gripper.pads))


def read(path: Path, given: Gripper | None) -> GraspSet:
    """Read a graspnetAPI array; it names no frame, which is the camera's of the picture it was found in.

    Args:
        given: gripper to read it for; None: the Panda.
    """
    try:
        rows = np.load(path, allow_pickle=False)
    except Exception as error:  # A broken header is parsed as Python text, which fails in many ways.
        raise GraspFileError("is not a readable npy array", path=path, fix=str(error)) from error
    if not isinstance(rows, np.ndarray) or rows.ndim != 2 or rows.shape[1] != COLUMNS:
        raise GraspFileError(
            f"must be of shape (n, {COLUMNS})", path=path, value=getattr(rows, "shape", type(rows))
        )
    if not len(rows):
        raise GraspFileError("holds no grasp", path=path)
    if rows.dtype.kind not in "fiu" or not np.isfinite(rows).all():
        raise GraspFileError("must hold finite numbers", path=path, value=rows.dtype)
    rows, gripper = _of_one_object(rows.astype(float), path), choose_gripper(given, None, path, key="gripper")
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = rows[:, 4:13].reshape(-1, 3, 3), rows[:, 13:16]
    poses = rigid_poses(poses, path, "grasps")
    beyond = rows[:, 3] - tip_distance(gripper)
    poses[:, :3, 3] += poses[:, :3, 0] * beyond[:, None]
    poses[:, :3, :3] = poses[:, :3, :3] @ GRASPNET_FROM_TCP
    confidences = confidences_of(rows[:, 0], path, "score")
    return GraspSet(numbered(poses, confidences, rows[:, 1].tolist()), CAMERA, gripper=gripper)


def _of_one_object(rows: Float[np.ndarray, "g 17"], path: Path) -> Float[np.ndarray, "g 17"]:
    """The rows, refused where they belong to several objects: a mesh or a pose belongs to one of them."""
    ids = np.unique(rows[:, 16])
    if len(ids) > 1:
        raise GraspFileError(
            f"holds grasps of {len(ids)} objects",
            path=path,
            key="object id (last column)",
            value=[int(one) for one in ids],
            fix="Keep the rows of one: rows[rows[:, 16] == ID]",
        )
    return rows


def write(grasp_set: GraspSet, path: Path, gripper: Gripper) -> None:
    """Write a graspnetAPI array with its grasp centre at the TCP; the object id is 0."""
    if not grasp_set.in_other_frame:
        LOG.warning("%s names no frame: its grasps are in the object's, not in a camera's.", path)
    poses = np.stack([grasp.object_from_gripper for grasp in grasp_set.grasps])
    rows = np.zeros((len(poses), COLUMNS))
    rows[:, 0] = [grasp.confidence for grasp in grasp_set.grasps]
    rows[:, 1] = [gripper.max_width if g.width is None else g.width for g in grasp_set.grasps]
    rows[:, 2] = gripper.pads[0].size[0]
    rows[:, 3] = tip_distance(gripper)
    rows[:, 4:13] = (poses[:, :3, :3] @ GRASPNET_FROM_TCP.T).reshape(-1, 9)
    rows[:, 13:16] = poses[:, :3, 3]
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.save(file, rows, allow_pickle=False)
