"""Grasp files of other projects: isaac_grasp YAML, ACRONYM h5, graspnetAPI npy, GraspGen JSON.

Every reader ends at the TCP between the pads, +z approach, +x closing, metres; `grasp_set` has the
table of their frames.
"""

from pathlib import Path
from types import ModuleType

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import GraspFileError
from grasptransfer.grasping.formats import acronym, graspgen, graspnet, isaac_grasp
from grasptransfer.grasping.formats.grasp_set import GraspSet
from grasptransfer.grasping.formats.hand_of_file import DEFAULT
from grasptransfer.grasping.gripper import Gripper, load_gripper
from grasptransfer.grasping.placed_grasp import PlacedGrasp

__all__ = ["GraspSet", "PlacedGrasp", "convert", "read_grasps", "write_grasps"]

_BY_SUFFIX: dict[str, ModuleType] = {
    ".yaml": isaac_grasp,
    ".yml": isaac_grasp,
    ".h5": acronym,
    ".hdf5": acronym,
    ".npy": graspnet,
    ".json": graspgen,
}


def read_grasps(path: str | Path, *, gripper: str | Path | Gripper | None = None) -> GraspSet:
    """Read a grasp file of any of these formats, by its suffix.

    Args:
        gripper: the one whose base and finger lengths the file means; None: the one that the file names,
            or the Panda where it names none.

    Raises:
        GraspFileError: unknown suffix, another gripper than the file's, or a mistake in the file.
    """
    path = Path(path)
    module = _module(path)
    if not path.is_file():
        raise GraspFileError("does not exist", path=path)
    return module.read(path, None if gripper is None else _loaded(gripper))


def write_grasps(
    grasp_set: GraspSet, path: str | Path, *, gripper: str | Path | Gripper | None = None
) -> Path:
    """Write grasps in the format of the suffix.

    Args:
        gripper: whose base and finger lengths the file shall mean; None: the one of the grasps, or the Panda.

    Raises:
        GraspFileError: unknown suffix, no grasps, or a format that cannot hold their frame.
        SettingsError: the folder cannot be written.
    """
    path = Path(path)
    if not grasp_set.grasps:
        raise GraspFileError("there is no grasp to write", path=path)
    if gripper is None:
        gripper = grasp_set.gripper or DEFAULT
    _module(path).write(grasp_set, path, _loaded(gripper))
    return path


def convert(
    source: str | Path,
    target: str | Path,
    *,
    gripper: str | Path | Gripper | None = None,
    camera_from_object: Float[np.ndarray, "4 4"] | None = None,
) -> int:
    """Convert a grasp file to another format, both by suffix; returns how many grasps.

    Names, labels, contacts and approach distances survive in YAML only; ACRONYM and GraspGen keep
    neither width nor graded confidence.

    Args:
        gripper: the gripper, as for `read_grasps`.
        camera_from_object: (4, 4) pose of the object [m], for grasps in a camera's frame.

    Raises:
        GraspFileError: unknown suffix, or a mistake in the source.
    """
    _module(Path(target))
    grasp_set = read_grasps(source, gripper=gripper)
    if camera_from_object is not None:
        grasp_set = grasp_set.in_object_frame(camera_from_object)
    write_grasps(grasp_set, target)
    return len(grasp_set.grasps)


def _module(path: Path) -> ModuleType:
    if path.suffix.lower() not in _BY_SUFFIX:
        raise GraspFileError(
            "has a suffix that names no grasp format", path=path, value=path.suffix, choices=_BY_SUFFIX
        )
    return _BY_SUFFIX[path.suffix.lower()]


def _loaded(gripper: str | Path | Gripper) -> Gripper:
    return gripper if isinstance(gripper, Gripper) else load_gripper(gripper)
