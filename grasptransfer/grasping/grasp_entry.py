"""One grasp of a grasp file: from its YAML entry, with every check, and back."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from pydantic import Field

from grasptransfer.errors import GraspFileError, in_millimetres
from grasptransfer.frames import rigid
from grasptransfer.grasping.grasp import DEFAULT_APPROACH_DISTANCE, Grasp, Symmetry
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.yaml_models import (
    Quaternion,
    Strict,
    check_unit_quaternion,
    parse,
    pose_as_data,
)

LARGEST_OBJECT = 2.0  # m; a position beyond it was given in millimetres
WIDTH_TOLERANCE = 0.005  # m between a typed-in width and its contacts

Triple = tuple[float, float, float]


class SymmetryModel(Strict):
    """The `symmetry` block; see `Symmetry`."""

    axis: Triple
    point: Triple = (0.0, 0.0, 0.0)
    degrees: tuple[float, ...] | None = None
    samples: int | None = Field(default=None, ge=1, le=360)
    range_degrees: tuple[float, float] = (0.0, 360.0)
    flip: bool = False


class EntryModel(Strict):
    """Every key of one grasp."""

    confidence: float = Field(default=1.0, ge=0, le=1)
    position: Triple
    orientation: Quaternion
    label: str | None = None
    width: float | None = Field(default=None, ge=0)
    opening: float | None = Field(default=None, ge=0)
    approach_distance: float = Field(default=DEFAULT_APPROACH_DISTANCE, ge=0, le=1)
    contacts: tuple[Triple, Triple] | None = None
    symmetry: SymmetryModel | None = None
    cspace_position: dict[str, float] | None = None
    pregrasp_cspace_position: dict[str, float] | None = None


def read_entry(name: str, data: object, gripper: Gripper, path: Path) -> Grasp:
    """Check an entry, and make it a grasp.

    Args:
        gripper: the file's; what it opens bounds the widths.

    Raises:
        GraspFileError: named by file, key, value and choices.
    """
    key = f"grasps.{name}"
    model = parse(EntryModel, data, path, key=key, error=GraspFileError)
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
        width=width,
        approach_distance=model.approach_distance,
        contacts=contacts,
        symmetry=None if model.symmetry is None else _symmetry(model.symmetry, path, f"{key}.symmetry"),
        confidence=model.confidence,
        opening=model.opening,
    )


def _check_lengths(model: EntryModel, gripper: Gripper, path: Path, key: str) -> None:
    if np.linalg.norm(model.position) > LARGEST_OBJECT:
        raise in_millimetres(GraspFileError, path=path, key=f"{key}.position", value=list(model.position))
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


def _symmetry(model: SymmetryModel, path: Path, key: str) -> Symmetry:
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


def write_entry(grasp: Grasp) -> dict:
    """The entry of a grasp, plain numbers and names."""
    data: dict[str, Any] = {"label": grasp.label, "confidence": float(grasp.confidence)}
    data |= pose_as_data(grasp.canonical_from_gripper)
    if grasp.width is not None:
        data["width"] = float(grasp.width)
    data["approach_distance"] = float(grasp.approach_distance)
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
