"""Annotated grasps and their YAML file.

The file is isaac_grasp YAML with `object_frame: canonical`, `gripper_frame: tcp` and a `grasptransfer`
block; `objects/README.md` describes every key. A mistake in it raises a `GraspFileError` that names
the file, the key, the value and the choices.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from grasptransfer.errors import GraspFileError
from grasptransfer.frames import rigid
from grasptransfer.files import replacing
from grasptransfer.grasping.grasp import DEFAULT_APPROACH_DISTANCE, Grasp, Symmetry, expand_symmetry
from grasptransfer.grasping.gripper import Gripper, list_grippers, load_gripper
from grasptransfer.grasping.yaml_models import (
    Quaternion,
    Strict,
    check_unit_quaternion,
    dump_yaml,
    parse,
    pose_as_data,
    read_yaml,
)

if TYPE_CHECKING:
    from grasptransfer.category import Category

LARGEST_OBJECT = 2.0  # m; a position beyond it was given in millimetres
WIDTH_TOLERANCE = 0.005  # m between a typed-in width and its contacts

__all__ = [
    "Grasp",
    "GraspFile",
    "Symmetry",
    "expand_symmetry",
    "load_grasps",
    "read_grasp_file",
    "save_grasps",
]

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class GraspFile:
    """Everything in a grasp file: the grasps, and for which model and gripper they were made."""

    grasps: tuple[Grasp, ...]
    category: str
    gripper: str
    canonical_sha256: str | None


class _SymmetryModel(Strict):
    axis: Triple
    point: Triple = (0.0, 0.0, 0.0)
    degrees: tuple[float, ...] | None = None
    samples: int | None = Field(default=None, ge=1, le=360)
    range_degrees: tuple[float, float] = (0.0, 360.0)
    flip: bool = False


class _GraspModel(Strict):
    confidence: float = Field(default=1.0, ge=0, le=1)
    position: Triple
    orientation: Quaternion
    label: str | None = None
    width: float | None = Field(default=None, ge=0)
    opening: float | None = Field(default=None, ge=0)
    approach_distance: float = Field(default=DEFAULT_APPROACH_DISTANCE, ge=0, le=1)
    contacts: tuple[Triple, Triple] | None = None
    symmetry: _SymmetryModel | None = None
    cspace_position: dict[str, float] | None = None
    pregrasp_cspace_position: dict[str, float] | None = None


class _BlockModel(Strict):
    version: Literal[1]
    category: str
    length_unit: Literal["m"] = "m"
    gripper: str = "panda"
    canonical_sha256: str | None = None


class _FileModel(Strict):
    format: Literal["isaac_grasp"]
    # The string is what some writers put there.
    format_version: Literal[1.0, "1.0"] = 1.0  # type: ignore[valid-type]
    object_frame: Literal["canonical"]
    gripper_frame: Literal["tcp"]
    grasptransfer: _BlockModel
    grasps: dict[str, Any]


def load_grasps(path: str | Path, *, category: "Category | str | None" = None) -> tuple[Grasp, ...]:
    """Grasps of a grasp file.

    Args:
        category: the category they must be for; of a loaded one, also the canonical model must be
            the one they were made on, where the file says which.

    Raises:
        GraspFileError: a mistake in the file, or another category or canonical model.
    """
    file = read_grasp_file(path)
    if category is None:
        return file.grasps
    name = category if isinstance(category, str) else category.name
    if file.category != name:
        raise GraspFileError(
            "is for another category",
            path=path,
            key="grasptransfer.category",
            value=file.category,
            choices=[name],
        )
    if not isinstance(category, str) and file.canonical_sha256 not in (None, category.canonical_sha256):
        raise GraspFileError(
            "grasps were made on another canonical model",
            path=path,
            key="grasptransfer.canonical_sha256",
            value=file.canonical_sha256,
            choices=[category.canonical_sha256],
            fix="Check the grasps on the new model, then put its checksum there",
        )
    return file.grasps


def read_grasp_file(path: str | Path) -> GraspFile:
    """Everything in a grasp file.

    Raises:
        GraspFileError: unreadable, or a mistake in it, named by key, value and choices.
    """
    path = Path(path)
    model = parse(_FileModel, read_yaml(path, error=GraspFileError), path, error=GraspFileError)
    block = model.grasptransfer
    if not model.grasps:
        raise GraspFileError("holds no grasp", path=path, key="grasps")
    gripper = _gripper(block.gripper, path)
    grasps = tuple(_grasp(str(name), data, gripper, path) for name, data in model.grasps.items())
    return GraspFile(grasps, block.category, block.gripper, block.canonical_sha256)


def _gripper(name: str, path: Path) -> Gripper:
    if name in list_grippers():
        return load_gripper(name)
    beside = path.parent / name
    if beside.suffix in (".yaml", ".yml") and beside.is_file():
        return load_gripper(beside)
    raise GraspFileError(
        "is not a known gripper",
        path=path,
        key="grasptransfer.gripper",
        value=name,
        choices=[*list_grippers(), "a YAML file beside this one"],
    )


def _grasp(name: str, data: object, gripper: Gripper, path: Path) -> Grasp:
    key = f"grasps.{name}"
    model = parse(_GraspModel, data, path, key=key, error=GraspFileError)
    check_unit_quaternion(model.orientation, path, f"{key}.orientation", error=GraspFileError)
    _check_lengths(model, gripper, path, key)
    canonical_from_gripper = rigid(model.orientation.matrix(), np.array(model.position))
    contacts = None if model.contacts is None else np.array(model.contacts)
    width = model.width
    if contacts is not None:
        width = _check_contacts(contacts, width, canonical_from_gripper, path, key)
    return Grasp(
        name=name,
        label=model.label or name,
        canonical_from_gripper=canonical_from_gripper,
        # Without width and contacts nothing is known but that the gripper closes from fully open.
        width=gripper.max_width if width is None else width,
        approach_distance=model.approach_distance,
        contacts=contacts,
        symmetry=None if model.symmetry is None else _symmetry(model.symmetry, path, f"{key}.symmetry"),
        confidence=model.confidence,
        opening=model.opening,
    )


def _check_lengths(model: _GraspModel, gripper: Gripper, path: Path, key: str) -> None:
    if np.linalg.norm(model.position) > LARGEST_OBJECT:
        raise GraspFileError(
            "position looks like millimetres, not metres",
            path=path,
            key=f"{key}.position",
            value=list(model.position),
            fix="Divide it by 1000",
        )
    for name in ("width", "opening"):
        value = getattr(model, name)
        if value is not None and value > gripper.max_width + 1e-6:
            raise GraspFileError(
                f"is more than {gripper.name} opens ({gripper.max_width:g} m)",
                path=path,
                key=f"{key}.{name}",
                value=value,
            )
    if model.opening is not None and model.width is not None and model.opening < model.width:
        raise GraspFileError(
            "must be at least the width", path=path, key=f"{key}.opening", value=model.opening
        )


def _check_contacts(
    contacts: Float[np.ndarray, "2 3"],
    width: float | None,
    canonical_from_gripper: Float[np.ndarray, "4 4"],
    path: Path,
    key: str,
) -> float:
    """Refuse contacts that do not belong to the pose or the width; return the width [m]."""
    between = contacts[1] - contacts[0]
    measured = abs(float(between @ canonical_from_gripper[:3, 0]))
    if measured < 0.5 * np.linalg.norm(between) or np.linalg.norm(between) == 0:
        raise GraspFileError(
            "contacts do not lie along the closing axis, the gripper's x",
            path=path,
            key=f"{key}.contacts",
            value=contacts.tolist(),
        )
    away = np.linalg.norm(contacts.mean(axis=0) - canonical_from_gripper[:3, 3])
    if away > 0.05:
        raise GraspFileError(
            f"contacts are {away * 100:.0f} cm away from the grasp",
            path=path,
            key=f"{key}.contacts",
            value=contacts.tolist(),
        )
    if width is not None and abs(width - measured) > WIDTH_TOLERANCE:
        raise GraspFileError(
            f"does not agree with the contacts, which are {measured:.4f} m apart",
            path=path,
            key=f"{key}.width",
            value=width,
        )
    return measured if width is None else width


def _symmetry(model: _SymmetryModel, path: Path, key: str) -> Symmetry:
    length = float(np.linalg.norm(model.axis))
    if length < 1e-6:
        raise GraspFileError("must not be zero", path=path, key=f"{key}.axis", value=list(model.axis))
    if model.degrees is not None and model.samples is not None:
        raise GraspFileError("give either degrees or samples", path=path, key=key)
    if model.degrees == ():
        raise GraspFileError("must hold at least one turn", path=path, key=f"{key}.degrees")
    low, high = model.range_degrees
    if not low < high <= low + 360:
        raise GraspFileError(
            "must rise, by at most 360", path=path, key=f"{key}.range_degrees", value=[low, high]
        )
    return Symmetry(
        np.array(model.axis) / length,
        np.array(model.point),
        model.degrees,
        model.samples,
        model.range_degrees,
        model.flip,
    )


def save_grasps(
    grasps: Sequence[Grasp],
    path: str | Path,
    *,
    category: str,
    gripper: str = "panda",
    canonical_sha256: str | None = None,
) -> Path:
    """Write grasps of the canonical model as a grasp file.

    Raises:
        GraspFileError: two grasps share a name.
        SettingsError: the folder cannot be written.
    """
    path = Path(path)
    names = [grasp.name for grasp in grasps]
    for name in names:
        if names.count(name) > 1:
            raise GraspFileError("two grasps share a name", path=path, key="grasps", value=name)
    block = {"version": 1, "category": category, "length_unit": "m", "gripper": gripper}
    if canonical_sha256 is not None:
        block["canonical_sha256"] = canonical_sha256
    data = {
        "format": "isaac_grasp",
        "format_version": 1.0,
        "object_frame": "canonical",
        "gripper_frame": "tcp",
        "grasptransfer": block,
        "grasps": {grasp.name: _as_data(grasp) for grasp in grasps},
    }
    with replacing(path) as temporary:
        temporary.write_text(dump_yaml(data), encoding="utf-8")
    return path


def _as_data(grasp: Grasp) -> dict:
    data: dict[str, Any] = {"label": grasp.label, "confidence": float(grasp.confidence)}
    data |= pose_as_data(grasp.canonical_from_gripper)
    data |= {"width": float(grasp.width), "approach_distance": float(grasp.approach_distance)}
    if grasp.opening is not None:
        data["opening"] = float(grasp.opening)
    if grasp.contacts is not None:
        data["contacts"] = [[round(float(value), 9) for value in point] for point in grasp.contacts]
    if grasp.symmetry is not None:
        symmetry = grasp.symmetry
        block: dict[str, Any] = {"axis": symmetry.axis.tolist(), "point": symmetry.point.tolist()}
        if symmetry.degrees is not None:
            block["degrees"] = list(symmetry.degrees)
        if symmetry.samples is not None:
            block |= {"samples": symmetry.samples, "range_degrees": list(symmetry.range_degrees)}
        data["symmetry"] = block | {"flip": symmetry.flip}
    return data
