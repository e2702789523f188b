"""Pose files: our YAML, or BOP's rotation and translation in millimetres."""

from pathlib import Path

import numpy as np
import yaml
from jaxtyping import Float

from grasptransfer.errors import PoseError
from grasptransfer.frames import check_rigid, rigid

KEY = "camera_from_object"
BOP_ROTATION, BOP_TRANSLATION = "cam_R_m2c", "cam_t_m2c"
CHOICES = (KEY, f"{BOP_ROTATION} with {BOP_TRANSLATION}")


def load_pose(path: str | Path) -> Float[np.ndarray, "4 4"]:
    """`camera_from_object` (4, 4) [m] of a YAML or JSON file.

    Either `camera_from_object`, four rows of four numbers in metres; or BOP's `cam_R_m2c` (9 numbers,
    row by row) and `cam_t_m2c` (3 numbers in millimetres). Axes are OpenCV's in both.

    Raises:
        PoseError: unreadable, or a mistake in it, named by file and key.
    """
    path = Path(path)
    data = _read(path)
    known = [key for key in (KEY, BOP_ROTATION, BOP_TRANSLATION) if key in data]
    if KEY in known and len(known) > 1:
        raise PoseError(
            "holds two poses", path=path, key=known[1], fix=f"Leave either {' or '.join(CHOICES)}"
        )
    if KEY in known:
        pose = _array(data, KEY, (4, 4), path)
    elif known:
        rotation = _array(data, BOP_ROTATION, (3, 3), path)
        pose = rigid(rotation, _array(data, BOP_TRANSLATION, (3,), path) / 1000)
    else:
        raise PoseError("has no pose", path=path, value=list(data)[:8], choices=CHOICES)
    try:
        return check_rigid(pose, known[0])
    except PoseError as error:
        raise PoseError(error.problem, path=path, key=error.key, value=error.value, fix=error.fix) from error


def _read(path: Path) -> dict:
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise PoseError("does not exist", path=path) from error
    except (OSError, UnicodeDecodeError) as error:
        raise PoseError("cannot read the pose file", path=path, fix=str(error)) from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise PoseError(f"is not valid YAML{line}: {getattr(error, 'problem', error)}", path=path) from error
    if isinstance(data, list):
        raise PoseError("holds a list; one pose is wanted", path=path, fix="Give one of its entries")
    if not isinstance(data, dict):
        raise PoseError("must hold a mapping", path=path, value=data, choices=CHOICES)
    return data


def _array(data: dict, key: str, shape: tuple[int, ...], path: Path) -> np.ndarray:
    if key not in data:
        raise PoseError("is missing", path=path, key=key)
    try:
        array = np.array(data[key], dtype=float)
    except (TypeError, ValueError) as error:
        raise PoseError("must hold numbers", path=path, key=key, value=data[key]) from error
    if array.size != np.prod(shape) or (array.ndim > 1 and array.shape != shape):
        wanted = " x ".join(str(side) for side in shape)
        raise PoseError(f"must hold {wanted} numbers", path=path, key=key, value=array.shape)
    return array.reshape(shape)
