"""isaac_grasp YAML: named grasps with position and w-xyz quaternion in a frame the file names.

Files without a `gripper_frame` come from GraspGen: origin at the gripper base, axes of the TCP.
"""

from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from pydantic import BaseModel, ConfigDict, Field

from grasptransfer.errors import GraspFileError, in_millimetres
from grasptransfer.files import read_yaml, replacing
from grasptransfer.frames import invert, rigid
from grasptransfer.grasping.formats.grasp_set import GraspSet, base_from_tcp
from grasptransfer.grasping.grasp import DEFAULT_APPROACH_DISTANCE, Grasp, expand_symmetry
from grasptransfer.grasping.grasps import read_grasp_file
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.grasping.yaml_models import (
    Quaternion,
    check_unit_quaternion,
    dump_yaml,
    parse,
    pose_as_data,
)

TCP, CANONICAL = "tcp", "canonical"
FARTHEST = 5.0  # m from the origin of any frame that an arm reaches
Triple = tuple[float, float, float]


class _Loose(BaseModel):
    """Other writers add keys of their own; they are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


class _GraspModel(_Loose):
    position: Triple
    orientation: Quaternion
    confidence: float = Field(default=1.0, ge=0, le=1)
    label: str | None = None
    width: float | None = Field(default=None, ge=0, le=1)
    approach_distance: float = Field(default=DEFAULT_APPROACH_DISTANCE, ge=0)
    contacts: tuple[Triple, Triple] | None = None
    cspace_position: dict[str, float] | None = None
    pregrasp_cspace_position: dict[str, float] | None = None


class _FileModel(_Loose):
    format: Literal["isaac_grasp"]
    # pydantic knows literal floats, the type checker does not.
    format_version: Literal[1.0, "1.0"] = 1.0  # pyright: ignore[reportInvalidTypeForm]
    object_frame: str | None = None
    object_frame_link: str | None = None
    gripper_frame: str | None = None
    gripper_frame_link: str | None = None
    object_file: str | None = None
    object_scale: float = 1.0
    grasps: dict[str, Any]


def read(path: Path, gripper: Gripper) -> GraspSet:
    """Read an isaac_grasp file; joint positions of this gripper become width and opening.

    Of a category's grasp file every member of a symmetry family becomes a grasp.
    """
    data = read_yaml(path, error=GraspFileError)
    if _is_of_a_category(data):
        return GraspSet(expand_symmetry(read_grasp_file(path).grasps), CANONICAL)
    model = parse(_FileModel, data, path, error=GraspFileError)
    if not model.grasps:
        raise GraspFileError("holds no grasp", path=path, key="grasps")
    frame_from_tcp = _frame_from_tcp(model.gripper_frame or model.gripper_frame_link, gripper, path)
    grasps = []
    for name, data in model.grasps.items():
        key = f"grasps.{name}"
        grasp = parse(_GraspModel, data, path, key=key, error=GraspFileError)
        check_unit_quaternion(grasp.orientation, path, f"{key}.orientation", error=GraspFileError)
        if np.linalg.norm(grasp.position) > FARTHEST:
            raise in_millimetres(GraspFileError, path=path, key=f"{key}.position", value=list(grasp.position))
        object_from_frame = rigid(grasp.orientation.matrix(), np.array(grasp.position))
        width = _width(grasp.cspace_position, gripper)
        grasps.append(
            Grasp(
                name=str(name),
                label=grasp.label or "grasp",
                canonical_from_gripper=object_from_frame @ frame_from_tcp,
                width=width if grasp.width is None else grasp.width,
                approach_distance=grasp.approach_distance,
                contacts=None if grasp.contacts is None else np.array(grasp.contacts),
                confidence=grasp.confidence,
                opening=_width(grasp.pregrasp_cspace_position, gripper),
            )
        )
    frame = model.object_frame or model.object_frame_link or "object"
    return GraspSet(tuple(grasps), frame, model.object_file, model.object_scale)


def _is_of_a_category(data: object) -> bool:
    block = data.get("grasptransfer") if isinstance(data, dict) else None
    return isinstance(block, dict) and "category" in block


def write(grasp_set: GraspSet, path: Path, gripper: Gripper) -> None:
    """Write TCP poses, with the joint positions of this gripper at the grasp and on the way in."""
    data: dict[str, Any] = {
        "format": "isaac_grasp",
        "format_version": 1.0,
        "object_frame": grasp_set.object_frame,
        "gripper_frame": TCP,
    }
    if grasp_set.object_file is not None:
        data |= {"object_file": grasp_set.object_file, "object_scale": grasp_set.object_scale}
    data["grasptransfer"] = {"version": 1, "length_unit": "m", "gripper": gripper.name}
    data["grasps"] = {grasp.name: _as_data(grasp, gripper) for grasp in grasp_set.grasps}
    with replacing(path) as temporary:
        temporary.write_text(dump_yaml(data), encoding="utf-8")


def _as_data(grasp: Grasp, gripper: Gripper) -> dict[str, Any]:
    data: dict[str, Any] = {"confidence": float(grasp.confidence)} | pose_as_data(
        grasp.canonical_from_gripper
    )
    width = gripper.max_width if grasp.width is None else float(np.clip(grasp.width, *gripper.opening))
    opening = gripper.approach_opening(width) if grasp.opening is None else grasp.opening
    data["cspace_position"] = gripper.joint_positions(width)
    data["pregrasp_cspace_position"] = gripper.joint_positions(float(np.clip(opening, *gripper.opening)))
    data["label"] = grasp.label
    if grasp.width is not None:
        data["width"] = float(grasp.width)
    data["approach_distance"] = float(grasp.approach_distance)
    if grasp.contacts is not None:
        data["contacts"] = [[round(float(value), 9) for value in point] for point in grasp.contacts]
    return data


def _frame_from_tcp(name: str | None, gripper: Gripper, path: Path) -> Float[np.ndarray, "4 4"]:
    if name is None:
        return base_from_tcp(gripper)
    link = name.rsplit("/", 1)[-1]  # Isaac writes the whole path of the prim
    if link == TCP:
        return np.eye(4)
    poses = gripper.link_poses(gripper.max_width)
    if link not in poses or any(link == pad.link for pad in gripper.pads):
        raise GraspFileError(
            f"is not a frame of {gripper.name}",
            path=path,
            key="gripper_frame",
            value=name,
            choices=[TCP, gripper.base_link],
            fix="Name the gripper whose frames the file means",
        )
    return invert(poses[link])


def _width(positions: dict[str, float] | None, gripper: Gripper) -> float | None:
    """Opening [m] that belongs to the driver's position, where the file tells it."""
    return gripper.opening_of(positions) if positions else None
