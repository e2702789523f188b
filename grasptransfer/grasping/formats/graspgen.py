"""GraspGen JSON: poses of the gripper base with the TCP's axes, and a flag for each."""

import json
from pathlib import Path

import numpy as np

from grasptransfer.data_files import read_data
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


def read(path: Path, given: Gripper | None) -> GraspSet:
    """Read a GraspGen file; its flags become confidences of 0 and 1.

    Args:
        given: gripper to read it for; None: the one that the file names.
    """
    data = read_data(path, error=GraspFileError)
    if not isinstance(data, dict) or not isinstance(data.get("grasps"), dict):
        raise GraspFileError("must hold a mapping", path=path, key="grasps")
    grasps, known = data["grasps"], data.get("object") or {}
    if not isinstance(known, dict):
        raise GraspFileError("must hold a mapping", path=path, key="object", value=known)
    poses = rigid_poses(grasps.get("transforms", []), path, "grasps.transforms")
    flags = np.array(grasps.get("object_in_gripper", [True] * len(poses)))
    if flags.shape != (len(poses),) or flags.dtype.kind not in "bif":
        raise GraspFileError(
            f"must hold one flag for each of {len(poses)} grasps", path=path, key="grasps.object_in_gripper"
        )
    gripper = choose_gripper(given, _named(data.get("gripper")), path, key="gripper")
    confidences = confidences_of(flags, path, "grasps.object_in_gripper")
    read = numbered(poses @ base_from_tcp(gripper), confidences, [None] * len(poses))
    scale = scale_of(known.get("scale", 1.0), path, "object.scale")
    return GraspSet(read, OBJECT, known.get("file"), scale, gripper)


def _named(gripper: object) -> str | None:
    """Name of a gripper given as text, or as a mapping with one of the keys that writers use."""
    if isinstance(gripper, dict):
        gripper = next((gripper[key] for key in ("name", "type", "file") if gripper.get(key)), None)
    return None if gripper is None else str(gripper)


def write(grasp_set: GraspSet, path: Path, gripper: Gripper) -> None:
    """Write a GraspGen file; a confidence of at least one half becomes a flag of true."""
    poses = stacked(grasp_set, path) @ invert(base_from_tcp(gripper))
    data = {
        "gripper": {"name": gripper.name},
        "object": {"file": grasp_set.object_file or "", "scale": float(grasp_set.object_scale)},
        "grasps": {
            "transforms": poses.tolist(),
            "object_in_gripper": [grasp.confidence >= 0.5 for grasp in grasp_set.grasps],
        },
    }
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(data), encoding="utf-8")
