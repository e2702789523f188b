"""A YAML file's content as a pydantic model, with every mistake named by file, key, value and choices."""

from pathlib import Path
from typing import TypeVar

import numpy as np
import yaml
from jaxtyping import Float
from pydantic import BaseModel, ConfigDict, ValidationError

from grasptransfer.errors import GraspTransferError
from grasptransfer.frames import rigid

Model = TypeVar("Model", bound=BaseModel)

UNIT_NORM_TOLERANCE = 1e-3  # typed-in quaternions carry three or four digits


class Strict(BaseModel):
    """Unknown keys are mistakes, numbers are finite, and nothing changes afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Quaternion(Strict):
    """Rotation `w + xyz`, unit norm."""

    w: float
    xyz: tuple[float, float, float]

    def matrix(self) -> np.ndarray:
        """Rotation matrix (3, 3)."""
        w, (x, y, z) = self.w, self.xyz
        q = np.array([w, x, y, z]) / np.linalg.norm([w, x, y, z])
        w, x, y, z = q
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )

    def norm(self) -> float:
        """Length; 1 for a rotation."""
        return float(np.linalg.norm([self.w, *self.xyz]))


class RigidPose(Strict):
    """A rigid transform as position [m] and unit quaternion."""

    position: tuple[float, float, float]
    orientation: Quaternion

    def matrix(self) -> np.ndarray:
        """Rigid transform (4, 4)."""
        return rigid(self.orientation.matrix(), np.array(self.position))


def quaternion_of(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """Unit quaternion (w, x, y, z), w >= 0, of a rotation matrix."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    sign = -1.0 if w < 0 else 1.0
    return (sign * float(w), sign * float(x), sign * float(y), sign * float(z))


def check_unit_quaternion(
    quaternion: Quaternion, path: str | Path | None, key: str, *, error: type[GraspTransferError]
) -> None:
    """Refuse a quaternion that is not of unit length."""
    if abs(quaternion.norm() - 1) > UNIT_NORM_TOLERANCE:
        raise error(
            "quaternion must have norm 1",
            path=path,
            key=key,
            value=round(quaternion.norm(), 6),
            fix="Its components are w and xyz",
        )


def dump_yaml(data: dict) -> str:
    """YAML in the given order, short lists on one line."""
    return yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=110)


def pose_as_data(a_from_gripper: Float[np.ndarray, "4 4"]) -> dict:
    """`position` [m] and `orientation` (w, xyz) of a pose, as isaac_grasp writes them."""
    w, *xyz = quaternion_of(a_from_gripper[:3, :3])
    position = [round(float(value), 9) for value in a_from_gripper[:3, 3]]
    orientation = {"w": round(w, 12), "xyz": [round(value, 12) for value in xyz]}
    return {"position": position, "orientation": orientation}


def parse(
    model: type[Model],
    data: object,
    path: str | Path | None,
    *,
    key: str = "",
    error: type[GraspTransferError],
) -> Model:
    """Validate `data` as `model`; the first mistake becomes an `error` with path, key, value and choices."""
    try:
        return model.model_validate(data)
    except ValidationError as cause:
        first = cause.errors()[0]
        where = ".".join([key] * bool(key) + [str(part) for part in first["loc"]])
        kind = first["type"]
        if kind == "extra_forbidden":
            known = _keys_at(model, first["loc"][:-1])
            raise error("is not a known key", path=path, key=where, choices=known) from cause
        if kind == "missing":
            raise error("is missing", path=path, key=where) from cause
        choices = None
        if kind == "literal_error":
            choices = [
                part.strip(" '") for part in first.get("ctx", {})["expected"].replace(" or ", ",").split(",")
            ]
        message = first["msg"].removeprefix("Value error, ")
        message = message[:1].lower() + message[1:]
        raise error(message, path=path, key=where or None, value=first["input"], choices=choices) from cause


def _keys_at(model: type[BaseModel], location: tuple) -> list[str]:
    """Known keys of the model nested at `location`."""
    for part in location:
        field = model.model_fields.get(part) if isinstance(part, str) else None
        for inner in _models_in(field.annotation) if field else ():
            model = inner
            break
    return [field.alias or name for name, field in model.model_fields.items()]


def _models_in(annotation: object) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    found = []
    for inner in getattr(annotation, "__args__", ()):
        found += _models_in(inner)
    return found
