"""GraspGen JSON: poses of the gripper base with the TCP's axes, and a flag for each."""

import json
from pathlib import Path

import numpy as np

from grasptransfer.errors import GraspFileError
from grasptransfer.files import replacing
from grasptransfer.frames import invert
from grasptransfer.grasping.formats.grasp_set import GraspSet, base_from_tcp, numbered, rigid_poses, stacked
from grasptransfer.grasping.gripper import Gripper


def read(path: Path, gripper: Gripper) -> GraspSet:
    """Read a GraspGen file; its flags become confidences of 0 and 1."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise GraspFileError("is not readable JSON", path=path, fix=str(error)) from error
    if not isinstance(data, dict) or not isinstance(data.get("grasps"), dict):
        raise GraspFileError("must hold a mapping", path=path, key="grasps")
    grasps, known = data["grasps"], data.get("object") or {}
    poses = rigid_poses(grasps.get("transforms", []), path, "grasps.transforms")
    flags = np.array(grasps.get("object_in_gripper", [True] * len(poses)))
    if flags.shape != (len(poses),) or flags.dtype.kind not in "bif":
        raise GraspFileError(
            f"must hold one flag for each of {len(poses)} grasps", path=path, key="grasps.object_in_gripper"
        )
    scale = known.get("scale", 1.0) if isinstance(known, dict) else None
    if isinstance(scale, bool) or not isinstance(scale, int | float):
        raise GraspFileError("must be a number", path=path, key="object.scale", value=scale)
    read = numbered(poses @ base_from_tcp(gripper), np.clip(flags.astype(float), 0, 1), [None] * len(poses))
    return GraspSet(read, "object", known.get("file"), float(scale))


def write(grasp_set: GraspSet, path: Path, gripper: Gripper) -> None:
    """Write a GraspGen file; a confidence of at least one half becomes a flag of true."""
    poses = stacked(grasp_set.grasps) @ invert(base_from_tcp(gripper))
    data = {
        "object": {"file": grasp_set.object_file or "", "scale": float(grasp_set.object_scale)},
        "grasps": {
            "transforms": poses.tolist(),
            "object_in_gripper": [grasp.confidence >= 0.5 for grasp in grasp_set.grasps],
        },
    }
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(data), encoding="utf-8")
