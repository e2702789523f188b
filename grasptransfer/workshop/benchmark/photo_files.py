"""A folder of photographs: `photos.yaml`, and the sets of given poses beside it."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
import yaml
from jaxtyping import Float
from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from grasptransfer.camera import Camera
from grasptransfer.data_files import read_data
from grasptransfer.errors import SettingsError
from grasptransfer.perception.several_pictures import seen_from
from grasptransfer.workshop.benchmark.given_poses import REGIMES, GivenPoses
from grasptransfer.workshop.benchmark.seen_instances import APART

TOLD_POSES = "told_poses.yaml"  # image -> set -> camera_from_object, of `--told NAME`


class _Intrinsics(BaseModel):
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int


class Photo(BaseModel):
    """One entry of `photos.yaml`; paths are relative to its folder, unknown keys are ignored."""

    model_config = ConfigDict(extra="ignore")
    image: str
    category: str
    camera: _Intrinsics
    camera_from_object: list[list[float]]
    object: str | None = None
    mesh: str | None = None
    size_m: tuple[float, float, float] | None = None
    box: tuple[float, float, float, float] | None = None
    pose_kind: Literal["ground_truth", "pseudo"] | None = None
    depth: str | None = None
    mask: str | None = None


def read_photos(folder: Path) -> list[Photo]:
    """The entries of `folder/photos.yaml`.

    Raises:
        SettingsError: the file is missing or not YAML, or an entry has a wrong key; names entry and key.
    """
    path = folder / "photos.yaml"
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
        return TypeAdapter(list[Photo]).validate_python(data)
    except OSError as error:
        raise SettingsError("cannot be read", path=path, fix=error.strerror) from error
    except yaml.YAMLError as error:
        raise SettingsError(f"is not valid YAML: {error}", path=path) from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise SettingsError(first["msg"], path=path, key=f"entry {key}") from error


def camera_of_photo(photo: Photo) -> Camera:
    """Intrinsics of the photograph."""
    return Camera(**photo.camera.model_dump())


def given_pose(photo: Photo, folder: Path, given: GivenPoses) -> Float[np.ndarray, "4 4"]:
    """The given pose of a photograph, drawn or from a set on file.

    Raises:
        SettingsError: the set has no pose of this photograph.
    """
    true_pose = np.array(photo.camera_from_object)
    if given.told in REGIMES:
        return given.apply(true_pose, np.random.default_rng(list(photo.image.encode())))
    found = given_poses_of(folder).get(photo.image, {}).get(given.told)
    if found is None:
        raise SettingsError(
            "has no pose of this set", path=folder / TOLD_POSES, key=photo.image, value=given.told
        )
    return np.array(found["camera_from_object"], float)


def taken_beside(photo: Photo, photos: Sequence[Photo], count: int) -> list[Photo]:
    """The next `count` photographs of the same object to see together with one: about `APART` aside each.

    Args:
        photos: of the object.
        count: how many besides this one; fewer where there are fewer.
    """
    others = [other for other in photos if other.image != photo.image]
    poses = np.array([one.camera_from_object for one in (photo, *others)], float)
    directions = seen_from(poses)
    aside = np.arccos(np.clip(directions[1:] @ directions[0], -1, 1))
    chosen: list[int] = []
    for number in range(1, min(count, len(others)) + 1):
        free = [index for index in range(len(others)) if index not in chosen]
        chosen.append(min(free, key=lambda index: abs(aside[index] - number * APART)))
    return [others[index] for index in chosen]


def poses_on_file(folder: Path) -> tuple[str, ...]:
    """Names of the sets of given poses in the folder's told_poses.yaml; none without one."""
    return tuple(sorted({name for sets in given_poses_of(folder).values() for name in sets}))


@lru_cache(maxsize=2)
def given_poses_of(folder: Path) -> dict[str, dict[str, dict]]:
    """Content of told_poses.yaml: image -> set -> given pose; empty without the file."""
    path = folder / TOLD_POSES
    return read_data(path, error=SettingsError) if path.is_file() else {}
