"""A YAML file's content as a pydantic model, with every mistake named by file, key, value and choices."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin

import numpy as np
import yaml
from jaxtyping import Float
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from scipy.spatial.transform import Rotation

from grasptransfer.errors import GraspTransferError
from grasptransfer.frames import rigid

Model = TypeVar("Model", bound=BaseModel)

UNIT_NORM_TOLERANCE = 1e-3  # typed-in quaternions carry three or four digits


class Strict(BaseModel):
    """Unknown keys are mistakes, numbers are finite, and nothing changes afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Quaternion(Strict):
    """Rotation `w + xyz`, unit norm."""

    w: float = Field(examples=["1"])
    xyz: tuple[float, float, float]

    def matrix(self) -> np.ndarray:
        """Rotation matrix (3, 3)."""
        return Rotation.from_quat([*self.xyz, self.w]).as_matrix()

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
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=110)


class _Dumper(yaml.SafeDumper):
    """Puts text in quotes where our reader would take it for a number, such as `1e3`."""


_Dumper.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"^[-+]?[0-9]+[eE][-+]?[0-9]+$"), list("-+0123456789")
)


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
    """Validate `data` as `model`; the first mistake becomes an `error` with path, key, value and choices.

    Only numbers count as numbers, and only `true` and `false` as booleans.
    """
    try:
        # As JSON, since only there a list may be strict and yet stand for a tuple.
        return model.model_validate_json(json.dumps(data), strict=True)
    except ValidationError as cause:
        mistakes = cause.errors(include_url=False)
    first = mistakes[0]
    location, kind = first["loc"], first["type"]
    where = ".".join([key] * bool(key) + [str(part) for part in location]) or None
    if kind == "extra_forbidden":
        known = _keys_at(model, location[:-1])
        raise error("is not a known key", path=path, key=where, choices=known)
    fix = _form(model, location)
    if kind == "missing":
        raise error(
            "is missing", path=path, key=where, fix=_form_around(model, location, mistakes, nested=bool(key))
        )
    choices = None
    if kind == "literal_error":
        choices = [
            part.strip(" '") for part in first.get("ctx", {})["expected"].replace(" or ", ",").split(",")
        ]
        fix = None
    problem = PROBLEMS.get(kind) or first["msg"].replace("Input should be", "must be")
    if kind == "too_long" and _is_numbers(first["input"]):
        fix = f"{fix}, with points in decimals"
    raise error(problem, path=path, key=where, value=first["input"], choices=choices, fix=fix)


# What pydantic says about types, in words of the file.
PROBLEMS = {
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "bool_type": "must be true or false",
    "string_type": "must be text, in quotes where it looks like a number",
    "tuple_type": "must be a list",
    "list_type": "must be a list",
    "dict_type": "must be a mapping",
    "model_type": "must be a mapping",
    "too_long": "holds too many values",
    "too_short": "holds too few values",
}


def _is_numbers(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(one, int | float) for one in value)


def _form_around(
    model: type[BaseModel], location: tuple, mistakes: Sequence[Any], *, nested: bool
) -> str | None:
    """How the mapping or list that lacks something is written, with a key in it that is not known."""
    form = _form(model, location[:-1]) if nested or len(location) > 1 else None
    beside = [
        str(other["loc"][-1])
        for other in mistakes
        if other["type"] == "extra_forbidden" and other["loc"][:-1] == location[:-1]
    ]
    unknown = f"{beside[0]} is not a known key" if beside else None
    return ". ".join(part for part in (unknown, form) if part) or None


def _form(model: type[BaseModel], location: tuple) -> str | None:
    """How the value at `location`, or the list around it, is written: `Write it as [0, 0, 0]`."""
    annotation: Any = model
    shown: str | None = None
    for part in location:
        field = None
        for inner in _models_in(annotation):
            field = field or (inner.model_fields.get(part) if isinstance(part, str) else None)
        if field is not None:
            annotation = field.annotation
            shown = field.examples[0] if field.examples else _example(annotation)
        elif isinstance(part, str):  # a key of a mapping: what its values look like
            annotation = next(iter(getattr(annotation, "__args__", ())[1:]), None)
            shown = _example(annotation)
        elif annotation is not None and not _is_of_numbers(annotation):
            annotation = next(iter(getattr(annotation, "__args__", ())), None)
            shown = _example(annotation)
    if not location:
        shown = _example(model)
    return None if shown is None or shown in SCALARS.values() else f"Write it as {shown}"


SCALARS: dict[Any, str] = {float: "0.5", int: "1", str: "name", bool: "true"}


def _is_of_numbers(annotation: Any) -> bool:
    return all(inner in (float, int, type(None), Ellipsis) for inner in getattr(annotation, "__args__", ()))


def _example(annotation: Any) -> str | None:
    """The shortest value of this type as YAML writes it; None where anything may stand there."""
    if annotation in SCALARS:
        return SCALARS[annotation]
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        wanted = {name: field for name, field in annotation.model_fields.items() if field.is_required()}
        examples = {
            field.alias or name: field.examples[0] if field.examples else _example(field.annotation)
            for name, field in wanted.items()
        }
        return "{" + ", ".join(f"{name}: {value}" for name, value in examples.items()) + "}"
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return str(inner[0])
    if origin is tuple:
        return (
            "["
            + ", ".join("0" if one is float else str(_example(one)) for one in inner if one is not ...)
            + "]"
        )
    if origin in (dict, Mapping):
        value = _example(inner[1])
        return None if value is None else "{name: " + value + "}"
    if origin is list:
        return f"[{_example(inner[0])}]"
    return next((shown for one in inner if one is not type(None) and (shown := _example(one))), None)


def _keys_at(model: type[BaseModel], location: tuple) -> list[str]:
    """Known keys of the model nested at `location`."""
    for part in location:
        field = model.model_fields.get(part) if isinstance(part, str) else None
        for inner in _models_in(field.annotation) if field else ():
            model = inner
            break
    return [field.alias or name for name, field in model.model_fields.items()]


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    found = []
    for inner in getattr(annotation, "__args__", ()):
        found += _models_in(inner)
    return found
