"""ACRONYM h5: poses of the gripper base with the TCP's axes, a flag for each, and the scaled mesh."""

from pathlib import Path

import numpy as np

from grasptransfer.errors import GraspFileError
from grasptransfer.files import replacing
from grasptransfer.frames import invert
from grasptransfer.grasping.formats.grasp_set import GraspSet, base_from_tcp, numbered, rigid_poses, stacked
from grasptransfer.grasping.gripper import Gripper

TRANSFORMS = "grasps/transforms"
FLAGS = "grasps/qualities/flex/object_in_gripper"


def read(path: Path, gripper: Gripper) -> GraspSet:
    """Read an ACRONYM file; its flags become confidences of 0 and 1."""
    import h5py

    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise GraspFileError("is not a readable HDF5 file", path=path, fix=str(error)) from error
    with file:
        if TRANSFORMS not in file:
            raise GraspFileError("is missing", path=path, key=TRANSFORMS)
        poses = rigid_poses(np.asarray(file[TRANSFORMS]), path, TRANSFORMS)
        flags = np.asarray(file[FLAGS]) if FLAGS in file else np.ones(len(poses))
        if flags.shape != (len(poses),):
            raise GraspFileError(
                f"must hold one flag for each of {len(poses)} grasps", path=path, key=FLAGS, value=flags.shape
            )
        name = np.asarray(file["object/file"]).item() if "object/file" in file else None
        scale = float(np.asarray(file["object/scale"]).item()) if "object/scale" in file else 1.0
    name = name.decode() if isinstance(name, bytes) else name
    grasps = numbered(poses @ base_from_tcp(gripper), np.clip(flags.astype(float), 0, 1), [None] * len(poses))
    return GraspSet(grasps, "object", None if name is None else str(name), scale)


def write(grasp_set: GraspSet, path: Path, gripper: Gripper) -> None:
    """Write an ACRONYM file; a confidence of at least one half becomes a flag of 1."""
    import h5py

    poses = stacked(grasp_set.grasps) @ invert(base_from_tcp(gripper))
    flags = np.array([grasp.confidence >= 0.5 for grasp in grasp_set.grasps], dtype=np.int64)
    with replacing(path) as temporary, h5py.File(temporary, "w") as file:
        file[TRANSFORMS], file[FLAGS] = poses, flags
        file["gripper/type"] = gripper.name
        file["object/scale"] = float(grasp_set.object_scale)
        if grasp_set.object_file is not None:
            file["object/file"] = grasp_set.object_file
