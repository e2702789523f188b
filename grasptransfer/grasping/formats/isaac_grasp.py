"""isaac_grasp YAML: named grasps with position and w-xyz quaternion in a frame the file names.

Files without a `gripper_frame` come from GraspGen: origin at the gripper base, axes of the TCP.
"""

from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from pydantic import BaseModel, ConfigDict, Field

from grasptransfer.data_files import read_yaml
from grasptransfer.errors import GraspFileError, in_millimetres
from grasptransfer.files import replacing
from grasptransfer.frames import invert, rigid
from grasptransfer.grasping.formats.grasp_set import (
    CANONICAL,
    OBJECT,
    GraspSet,
    base_from_tcp,
    confidences_of,
    scale_of,
)
from grasptransfer.grasping.formats.hand_of_file import check_driver, check_joints, choose_gripper
from grasptransfer.grasping.grasp import DEFAULT_APPROACH_DISTANCE, expand_symmetry
from grasptransfer.grasping.grasps import file_gripper, read_grasp_file
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.grasping.placed_grasp import PlacedGrasp
from grasptransfer.yaml_models import (
    Quaternion,
    check_unit_quaternion,
    dump_yaml,
    parse,
    pose_as_data,
)

TCP = "tcp"
FARTHEST = 5.0  # m from the origin of any frame that an arm reaches
Triple = tuple[float, float, float]


class _Loose(BaseModel):
    """Other writers add keys of their own; they are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


class _GraspModel(_Loose):
    position: Triple
    orientation: Quaternion
    confidence: float = 1.0
    label: str | None = None
    width: float | None = Field(default=None, ge=0, le=1)
    approach_distance: float = Field(default=DEFAULT_APPROACH_DISTANCE, ge=0, le=1)
    contacts: tuple[Triple, Triple] | None = None
    cspace_position: dict[str, float] | None = None
    pregrasp_cspace_position: dict[str, float] | None = None


class _BlockModel(_Loose):
    length_unit: Literal["m"] = "m"
    gripper: str | None = None


class _FileModel(_Loose):
    format: Literal["isaac_grasp"]
    # pydantic knows literal floats, the type checker does not.
    format_version: Literal[1.0, "1.0"] = 1.0  # pyright: ignore[reportInvalidTypeForm]
    object_frame: str | None = None
    object_frame_link: str | None = None
    gripper_frame: str | None = None
    gripper_frame_link: str | None = None
    gripper_file: str | None = None
    object_file: str | None = None
    object_scale: float = 1.0
    grasptransfer: _BlockModel = _BlockModel()
    grasps: dict[str, Any] = Field(
        examples=["{my_grasp: {position: [0, 0, 0.05], orientation: {w: 1, xyz: [0, 0, 0]}}}"]
    )


def read(path: Path, given: Gripper | None) -> GraspSet:
    """Read an isaac_grasp file; joint positions of its gripper become width and opening.

    Of a category's grasp file every member of a symmetry family becomes a grasp.

    Args:
        given: gripper to read it for; None: the one that the file names.
    """
    data = read_yaml(path, error=GraspFileError)
    if _is_of_a_category(data):
        file = read_grasp_file(path)
        gripper = file_gripper(file.gripper, path)
        if given is not None and given.name != gripper.name:
            choose_gripper(given, gripper.name, path, key="grasptransfer.gripper")
        grasps = tuple(PlacedGrasp.on_canonical(grasp) for grasp in expand_symmetry(file.grasps))
        return GraspSet(grasps, CANONICAL, gripper=given or gripper)
    model = parse(_FileModel, data, path, error=GraspFileError)
    if not model.grasps:
        raise GraspFileError("holds no grasp", path=path, key="grasps")
    gripper = _gripper_of(model, given, path)
    frame_from_tcp = _frame_from_tcp(model.gripper_frame or model.gripper_frame_link, gripper, path)
    entries = {
        name: parse(_GraspModel, entry, path, key=f"grasps.{name}", error=GraspFileError)
        for name, entry in model.grasps.items()
    }
    confidences = confidences_of(
        np.array([entry.confidence for entry in entries.values()]), path, "grasps.*.confidence"
    )
    grasps = tuple(
        _placed(name, entry, frame_from_tcp, gripper, confidence=float(confidence), path=path)
        for (name, entry), confidence in zip(entries.items(), confidences, strict=True)
    )
    frame = model.object_frame or model.object_frame_link or OBJECT
    scale = scale_of(model.object_scale, path, "object_scale")
    return GraspSet(grasps, frame, model.object_file, scale, gripper)


def _gripper_of(model: _FileModel, given: Gripper | None, path: Path) -> Gripper:
    named = {"grasptransfer.gripper": model.grasptransfer.gripper, "gripper_file": model.gripper_file}
    key = next((key for key, name in named.items() if name is not None), "gripper_file")
    entry = next(iter(model.grasps.values()))
    joints = entry.get("cspace_position") if isinstance(entry, dict) else None
    return choose_gripper(given, named[key], path, key=key, joints=joints if isinstance(joints, dict) else ())


def _placed(
    name: str,
    entry: _GraspModel,
    frame_from_tcp: Float[np.ndarray, "4 4"],
    gripper: Gripper,
    *,
    confidence: float,
    path: Path,
) -> PlacedGrasp:
    key = f"grasps.{name}"
    check_unit_quaternion(entry.orientation, path, f"{key}.orientation", error=GraspFileError)
    if np.linalg.norm(entry.position) > FARTHEST:
        raise in_millimetres(GraspFileError, path=path, key=f"{key}.position", value=list(entry.position))
    object_from_frame = rigid(entry.orientation.matrix(), np.array(entry.position))
    width = _width(entry.cspace_position, gripper, path, f"{key}.cspace_position")
    opening = _width(entry.pregrasp_cspace_position, gripper, path, f"{key}.pregrasp_cspace_position")
    return PlacedGrasp(
        name=name,
        label=entry.label or "grasp",
        object_from_gripper=object_from_frame @ frame_from_tcp,
        width=width if entry.width is None else entry.width,
        approach_distance=entry.approach_distance,
        contacts=None if entry.contacts is None else np.array(entry.contacts),
        confidence=confidence,
        opening=opening,
    )


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


def _as_data(grasp: PlacedGrasp, gripper: Gripper) -> dict[str, Any]:
    data: dict[str, Any] = {"confidence": float(grasp.confidence)}
    data |= pose_as_data(grasp.object_from_gripper)
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


def _width(positions: dict[str, float] | None, gripper: Gripper, path: Path, key: str) -> float | None:
    """Opening [m] that belongs to the driver's position, where the file has it."""
    if not positions:
        return None
    check_joints(positions, gripper, path, key=key)
    driver = gripper.finger_joints[0]
    value = (positions[driver.name] - driver.offset) / driver.ratio
    check_driver(value, gripper, path, key=f"{key}.{driver.name}")
    return gripper.opening_of(positions)
