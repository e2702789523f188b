"""Pose files: our YAML, or BOP's rotation and translation in millimetres."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import PoseError
from grasptransfer.files import read_yaml
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
    data = read_yaml(path, error=PoseError)
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
        raise error.at(path) from error


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
