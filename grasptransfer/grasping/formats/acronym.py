"""ACRONYM h5: poses of the gripper base with the TCP's axes, a flag for each, and the scaled mesh."""

from pathlib import Path

import numpy as np

from grasptransfer.errors import GraspFileError
from grasptransfer.files import replacing
from grasptransfer.frames import invert
from grasptransfer.grasping.formats.grasp_set import (
    OBJECT,
    GraspSet,
    base_from_tcp,
    confidences_of,
    numbered,
    rigid_poses,
    scale_of,
    stacked,
)
from grasptransfer.grasping.formats.hand_of_file import choose_gripper
from grasptransfer.grasping.gripper import Gripper

TRANSFORMS = "grasps/transforms"
FLAGS = "grasps/qualities/flex/object_in_gripper"
GRIPPER, SCALE, FILE = "gripper/type", "object/scale", "object/file"


def read(path: Path, given: Gripper | None) -> GraspSet:
    """Read an ACRONYM file; its flags become confidences of 0 and 1.

    Args:
        given: gripper to read it for; None: the one that the file names.
    """
    fields = _fields(path)
    if TRANSFORMS not in fields:
        raise GraspFileError("is missing", path=path, key=TRANSFORMS)
    poses = rigid_poses(fields[TRANSFORMS], path, TRANSFORMS)
    flags = fields.get(FLAGS, np.ones(len(poses)))
    if flags.shape != (len(poses),):
        raise GraspFileError(
            f"must hold one flag for each of {len(poses)} grasps", path=path, key=FLAGS, value=flags.shape
        )
    name, scale = _text(fields, FILE, path), _scale(fields, path)
    gripper = choose_gripper(given, _text(fields, GRIPPER, path), path, key=GRIPPER)
    confidences = confidences_of(flags, path, FLAGS)
    grasps = numbered(poses @ base_from_tcp(gripper), confidences, [None] * len(poses))
    return GraspSet(grasps, OBJECT, name, scale, gripper)


def _fields(path: Path) -> dict[str, np.ndarray]:
    """The fields of a file that are read, as far as they are there."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            known = (TRANSFORMS, FLAGS, FILE, SCALE, GRIPPER)
            return {key: np.asarray(file[key]) for key in known if key in file}
    except Exception as error:  # HDF5 finds damage late, and says so by errors of many kinds.
        raise GraspFileError("is not a readable HDF5 file", path=path, fix=str(error)) from error


def _text(fields: dict[str, np.ndarray], key: str, path: Path) -> str | None:
    if key not in fields:
        return None
    if fields[key].size != 1:
        raise GraspFileError("must be a single text", path=path, key=key, value=fields[key].shape)
    value = fields[key].item()
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _scale(fields: dict[str, np.ndarray], path: Path) -> float:
    value = fields.get(SCALE, np.ones(()))
    return scale_of(value.item() if value.size == 1 else value.tolist(), path, SCALE)


def write(grasp_set: GraspSet, path: Path, gripper: Gripper) -> None:
    """Write an ACRONYM file; a confidence of at least one half becomes a flag of 1."""
    import h5py

    poses = stacked(grasp_set, path) @ invert(base_from_tcp(gripper))
    flags = np.array([grasp.confidence >= 0.5 for grasp in grasp_set.grasps], dtype=np.int64)
    with replacing(path) as temporary, h5py.File(temporary, "w") as file:
        file[TRANSFORMS], file[FLAGS] = poses, flags
        file[GRIPPER] = gripper.name
        file[SCALE] = float(grasp_set.object_scale)
        if grasp_set.object_file is not None:
            file["object/file"] = grasp_set.object_file
