"""The pose files of pose estimators, robots and people: from their content to `camera_from_object`.

| file | content | convention |
| --- | --- | --- |
| ours | `camera_from_object` or `object_from_camera`: 4x4; `pose_sigma`, optional | OpenCV axes, metres |
| BOP: one entry, or `scene_gt.json` | `cam_R_m2c`: 9, `cam_t_m2c`: 3 | OpenCV axes, millimetres |
| text or `.npy`, as FoundationPose writes it | 4x4 or 3x4 numbers | OpenCV axes, metres |
| ROS `PoseStamped`, `TransformStamped`, with covariance | position, quaternion | optical frame, metres |
| MegaPose `object_data.json` | `TWO`: [quaternion x y z w, position] | OpenCV axes, metres |
| `transforms.json` (NeRF) | `transform_matrix` | world_from_camera, OpenGL axes; the world is the object |
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.errors import GraspTransferError, PoseError
from grasptransfer.frames import OPENGL_FROM_OPENCV, check_rigid, invert, rigid

KEY, INVERSE, SIGMA = "camera_from_object", "object_from_camera", "pose_sigma"
ROS = "position with orientation (ROS)"
BOP_ROTATION, BOP_TRANSLATION = "cam_R_m2c", "cam_t_m2c"
NEAREST_BOP = 30.0  # mm: no camera is as near to an object; the same number in metres is as far as one sees
QUATERNION_TOLERANCE = 0.01  # of its length; files with two decimals keep it
NOT_OPTICAL = ("world", "map", "odom", "base", "tool0")  # names of frames whose axes are no camera's

Found = tuple[
    Float[np.ndarray, "4 4"], Any, str
]  # camera_from_object, pose_sigma as the file has it, convention


def pose_of_matrix(array: np.ndarray, path: Path) -> Found:
    """Pose of FoundationPose's `ob_in_cam` and anything else that numpy saves: 4x4, or its first three rows.

    Raises:
        PoseError: another shape, or not rigid.
    """
    if array.size in (12, 16) and (array.ndim == 1 or 1 in array.shape):
        array = array.reshape(-1, 4)
    if array.shape == (3, 4):
        array = np.vstack([array, [0, 0, 0, 1]])
    if array.shape != (4, 4):
        raise PoseError("must hold 4x4 numbers", path=path, value=array.shape)
    return _rigid(array, "matrix", path), None, f"a plain 4x4 matrix: {KEY}, OpenCV axes, metres"


def pose_of_mapping(data: dict, path: Path) -> Found:
    """Pose of a mapping in one of the formats of this module's table.

    Raises:
        PoseError: no or two known formats, or a mistake in the one there is.
    """
    ros = _ros_pose(data)
    also = {ROS: ros, BOP_ROTATION: BOP_TRANSLATION in data}
    found = [key for key in READERS if key in data or also.get(key)]
    if not found:
        known = (*READERS, "4x4 numbers without a key")
        raise PoseError("has no pose", path=path, value=list(data)[:8], choices=known)
    if len(found) > 1:
        raise PoseError("holds two poses", path=path, key=found[1], fix=f"Leave {found[0]} or {found[1]}")
    read, convention = READERS[found[0]]
    return *read(data, path), convention


def _ours(data: dict, path: Path) -> tuple[np.ndarray, Any]:
    return _rigid(_array(data, KEY, (4, 4), path), KEY, path), data.get(SIGMA)


def _bop(data: dict, path: Path) -> tuple[np.ndarray, None]:
    rotation = _array(data, BOP_ROTATION, (3, 3), path)
    translation = _array(data, BOP_TRANSLATION, (3,), path)
    if np.linalg.norm(translation) < NEAREST_BOP:
        raise PoseError(
            "looks like metres: BOP's files are in millimetres",
            path=path,
            key=BOP_TRANSLATION,
            value=translation.tolist(),
            fix="Multiply it by 1000",
        )
    return _rigid(rigid(rotation, translation / 1000), BOP_ROTATION, path), None


def _inverse(data: dict, path: Path) -> tuple[np.ndarray, None]:
    return invert(_rigid(_array(data, INVERSE, (4, 4), path), INVERSE, path)), None


def _ros_pose(data: dict) -> dict | None:
    """The innermost mapping of a ROS message that holds position and orientation, with its covariance."""
    covariance = data.get("covariance")
    for key in ("pose", "pose", "transform"):  # PoseWithCovarianceStamped holds its pose in a pose
        if isinstance(data.get(key), dict):
            data = data[key]
            covariance = data.get("covariance", covariance)
    known = {"position", "orientation"} <= data.keys() or {"translation", "rotation"} <= data.keys()
    return data | {"covariance": covariance} if known else None


def _ros(data: dict, path: Path) -> tuple[np.ndarray, Any]:
    header = data.get("header")
    _check_frame_id(header.get("frame_id") if isinstance(header, dict) else None, path)
    data = _ros_pose(data) or {}
    names = ("position", "orientation") if "position" in data else ("translation", "rotation")
    position = [_number(data, names[0], axis, path) for axis in "xyz"]
    quaternion = [_number(data, names[1], axis, path) for axis in "xyzw"]
    pose = _rigid(_of_quaternion(quaternion, position, names[1], path), names[0], path)
    if data["covariance"] is None:
        return pose, None
    by_shift = _array(data, "covariance", (6, 6), path)
    if not by_shift.any():
        return pose, None  # zeros are what ROS writes where nothing is known
    turn_then_shift = np.roll(by_shift, 3, axis=(0, 1))  # ROS: shift then turn
    return pose, turn_then_shift


def _check_frame_id(frame: object, path: Path) -> None:
    name = str(frame or "").strip("/")
    if name.startswith(NOT_OPTICAL) or (name.endswith("_link") and "optical" not in name):
        raise PoseError(
            "is not the frame of a picture: x right, y down, z forward",
            path=path,
            key="header.frame_id",
            value=name,
            fix="Give the object's pose in the camera's optical frame, such as camera_color_optical_frame",
        )


def _megapose(data: dict, path: Path) -> tuple[np.ndarray, None]:
    value = data["TWO"]
    if not isinstance(value, list) or len(value) != 2:
        raise PoseError("must be [[x, y, z, w], [x, y, z]]", path=path, key="TWO", value=value)
    parts = {"TWO": value[0], "TWO position": value[1]}
    quaternion, position = _array(parts, "TWO", (4,), path), _array(parts, "TWO position", (3,), path)
    pose = _of_quaternion(quaternion.tolist(), position.tolist(), "TWO", path)
    if "TWC" in data:
        raise PoseError("a pose of the camera beside the object's is not read", path=path, key="TWC")
    return _rigid(pose, "TWO", path), None


def _nerf(data: dict, path: Path) -> tuple[np.ndarray, None]:
    key = "transform_matrix"
    world_from_opengl = _rigid(_array(data, key, (4, 4), path), key, path)
    return invert(world_from_opengl @ OPENGL_FROM_OPENCV), None


def _of_quaternion(quaternion: list[float], position: list[float], key: str, path: Path) -> np.ndarray:
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1) > QUATERNION_TOLERANCE:
        raise PoseError(
            "quaternion x, y, z, w must have length 1", path=path, key=key, value=round(length, 4)
        )
    return rigid(Rotation.from_quat(quaternion).as_matrix(), np.array(position))


def _number(data: dict, key: str, axis: str, path: Path) -> float:
    part = data.get(key)
    value = part.get(axis) if isinstance(part, dict) else None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise PoseError("must be a number", path=path, key=f"{key}.{axis}", value=value)
    return float(value)


def _rigid(matrix: np.ndarray, key: str, path: Path) -> Float[np.ndarray, "4 4"]:
    try:
        return check_rigid(matrix, key)
    except GraspTransferError as error:
        raise error.at(path) from error


def _array(data: dict, key: str, shape: tuple[int, ...], path: Path) -> np.ndarray:
    if key not in data:
        raise PoseError("is missing", path=path, key=key)
    array = numbers_of(data[key], key, path)
    if array.size != np.prod(shape) or (array.ndim > 1 and array.shape != shape):
        wanted = " x ".join(str(side) for side in shape)
        raise PoseError(f"must hold {wanted} numbers", path=path, key=key, value=array.shape)
    return array.reshape(shape)


def numbers_of(value: object, key: str, path: Path) -> np.ndarray:
    """The array of a file's value.

    Raises:
        PoseError: ragged, or something other than numbers in it.
    """
    try:
        array = np.array(value)
    except ValueError:
        array = np.array(None)
    if array.dtype.kind not in "if":
        raise PoseError("must hold numbers", path=path, key=key, value=value)
    return array.astype(float)


_Reader = Callable[[dict, Path], tuple[np.ndarray, Any]]
READERS: dict[str, tuple[_Reader, str]] = {
    KEY: (_ours, f"our {KEY}"),
    INVERSE: (_inverse, f"{INVERSE}, the inverse of {KEY}"),
    BOP_ROTATION: (_bop, "BOP's pose: OpenCV axes, millimetres"),
    ROS: (_ros, "a ROS pose: axes of the camera's optical frame, quaternion x y z w, metres"),
    "TWO": (_megapose, "MegaPose's TWO: OpenCV axes, quaternion x y z w, metres"),
    "transform_matrix": (_nerf, "a camera of transforms.json: OpenGL axes, the world is the object's frame"),
}
