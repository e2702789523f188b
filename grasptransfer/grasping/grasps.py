"""Annotated grasps and their YAML file.

The file is isaac_grasp YAML with `object_frame: canonical`, `gripper_frame: tcp` and a `grasptransfer`
block; `objects/README.md` describes every key. A mistake in it raises a `GraspFileError` that names
the file, the key, the value and the choices.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from grasptransfer.data_files import read_yaml
from grasptransfer.errors import GraspFileError
from grasptransfer.files import replacing
from grasptransfer.grasping.grasp import Grasp, Symmetry, expand_symmetry
from grasptransfer.grasping.grasp_entry import read_entry, write_entry
from grasptransfer.grasping.gripper import Gripper, list_grippers, load_gripper
from grasptransfer.yaml_models import Strict, dump_yaml, parse

if TYPE_CHECKING:
    from grasptransfer.category import Category

__all__ = [
    "Grasp",
    "GraspFile",
    "Symmetry",
    "expand_symmetry",
    "load_grasps",
    "read_grasp_file",
    "save_grasps",
]


@dataclass(frozen=True)
class GraspFile:
    """Everything in a grasp file: the grasps, and for which model and gripper they were made."""

    grasps: tuple[Grasp, ...]
    category: str
    gripper: str
    canonical_sha256: str | None


class _BlockModel(Strict):
    version: Literal[1]
    category: str
    length_unit: Literal["m"] = "m"
    gripper: str = "panda"
    canonical_sha256: str | None = None


class _FileModel(Strict):
    format: Literal["isaac_grasp"]
    # The string is what some writers put there. pydantic knows literal floats, the type checker does not.
    format_version: Literal[1.0, "1.0"] = 1.0  # pyright: ignore[reportInvalidTypeForm]
    object_frame: Literal["canonical"]
    gripper_frame: Literal["tcp"]
    grasptransfer: _BlockModel
    grasps: dict[str, Any] = Field(
        examples=["{my_grasp: {position: [0, 0, 0.05], orientation: {w: 1, xyz: [0, 0, 0]}}}"]
    )


def load_grasps(path: str | Path, *, category: "Category | str | None" = None) -> tuple[Grasp, ...]:
    """Grasps of a grasp file.

    Args:
        category: the category they must be for; of a loaded one, also the canonical model must be
            the one they were made on, where the file says which, and contacts that the file leaves
            out are measured on it.

    Raises:
        GraspFileError: a mistake in the file, another category or canonical model, or a grasp without
            contacts whose pads meet nothing.
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
    if isinstance(category, str):
        return file.grasps
    return _measured(file, category, Path(path))


def _measured(file: GraspFile, category: "Category", path: Path) -> tuple[Grasp, ...]:
    """The grasps, with the contacts that the pads make on the canonical model where there are none."""
    unknown = [grasp for grasp in file.grasps if grasp.contacts is None]
    if not unknown:
        return file.grasps
    from grasptransfer.grasping.closing import close_pads
    from grasptransfer.grasping.surface import Surface

    gripper = file_gripper(file.gripper, path)
    poses = np.stack([grasp.canonical_from_gripper for grasp in unknown])
    openings = np.array([_open(grasp, gripper) for grasp in unknown])
    closing = close_pads(Surface(category.canonical), poses, openings, gripper)
    found = {}
    for i, grasp in enumerate(unknown):
        if not closing.touching[i].all():
            raise GraspFileError(
                "has no contacts, and its pads meet nothing between them",
                path=path,
                key=f"grasps.{grasp.name}",
                fix="Move it onto the canonical model, or give its contacts",
            )
        found[grasp.name] = replace(grasp, contacts=closing.points[i], width=float(closing.width[i]))
    return tuple(found.get(grasp.name, grasp) for grasp in file.grasps)


def _open(grasp: Grasp, gripper: Gripper) -> float:
    """Distance between the pads on the way in [m]."""
    if grasp.opening is not None:
        return grasp.opening
    return gripper.max_width if grasp.width is None else gripper.approach_opening(grasp.width)


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
    gripper = file_gripper(block.gripper, path)
    grasps = tuple(read_entry(str(name), data, gripper, path) for name, data in model.grasps.items())
    return GraspFile(grasps, block.category, block.gripper, block.canonical_sha256)


def file_gripper(name: str, path: Path) -> Gripper:
    """The gripper that a grasp file names: a known one, or a YAML file beside the grasp file.

    Raises:
        GraspFileError: neither.
    """
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
    data = {
        "format": "isaac_grasp",
        "format_version": 1.0,
        "object_frame": "canonical",
        "gripper_frame": "tcp",
        "grasptransfer": file_block(category, gripper, canonical_sha256),
        "grasps": {grasp.name: write_entry(grasp) for grasp in grasps},
    }
    with replacing(path) as temporary:
        temporary.write_text(dump_yaml(data), encoding="utf-8")
    return path


def file_block(category: str, gripper: str, canonical_sha256: str | None) -> dict[str, Any]:
    """The `grasptransfer` block of a grasp file: for which model and gripper its grasps are."""
    block: dict[str, Any] = {"version": 1, "category": category, "length_unit": "m", "gripper": gripper}
    return block if canonical_sha256 is None else block | {"canonical_sha256": canonical_sha256}
