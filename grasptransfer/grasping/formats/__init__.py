"""Grasp files of other projects: isaac_grasp YAML, ACRONYM h5, graspnetAPI npy, GraspGen JSON.

Every reader ends at the TCP between the pads, +z approach, +x closing, metres; `grasp_set` has the
table of their frames.
"""

from pathlib import Path
from types import ModuleType

from grasptransfer.errors import GraspFileError
from grasptransfer.grasping.formats import acronym, graspgen, graspnet, isaac_grasp
from grasptransfer.grasping.formats.grasp_set import GraspSet
from grasptransfer.grasping.gripper import Gripper, load_gripper

__all__ = ["GraspSet", "convert", "read_grasps", "write_grasps"]

_BY_SUFFIX: dict[str, ModuleType] = {
    ".yaml": isaac_grasp,
    ".yml": isaac_grasp,
    ".h5": acronym,
    ".hdf5": acronym,
    ".npy": graspnet,
    ".json": graspgen,
}


def read_grasps(path: str | Path, *, gripper: str | Path | Gripper = "panda") -> GraspSet:
    """Read a grasp file of any of these formats, told by its suffix.

    Args:
        gripper: the one whose base and finger lengths the file means.

    Raises:
        GraspFileError: unknown suffix, or a mistake in the file.
    """
    path = Path(path)
    module = _module(path)
    if not path.is_file():
        raise GraspFileError("does not exist", path=path)
    return module.read(path, _loaded(gripper))


def write_grasps(grasp_set: GraspSet, path: str | Path, *, gripper: str | Path | Gripper = "panda") -> Path:
    """Write grasps in the format told by the suffix.

    Raises:
        GraspFileError: unknown suffix, or no grasps.
        SettingsError: the folder cannot be written.
    """
    path = Path(path)
    if not grasp_set.grasps:
        raise GraspFileError("there is no grasp to write", path=path)
    _module(path).write(grasp_set, path, _loaded(gripper))
    return path


def convert(source: str | Path, target: str | Path, *, gripper: str | Path | Gripper = "panda") -> int:
    """Convert a grasp file to another format, both told by suffix; returns how many grasps.

    Names, labels, contacts and approach distances survive in YAML only; ACRONYM and GraspGen keep
    neither width nor graded confidence.

    Raises:
        GraspFileError: unknown suffix, or a mistake in the source.
    """
    _module(Path(target))
    grasp_set = read_grasps(source, gripper=gripper)
    write_grasps(grasp_set, target, gripper=gripper)
    return len(grasp_set.grasps)


def _module(path: Path) -> ModuleType:
    if path.suffix.lower() not in _BY_SUFFIX:
        raise GraspFileError(
            "has a suffix that names no grasp format", path=path, value=path.suffix, choices=_BY_SUFFIX
        )
    return _BY_SUFFIX[path.suffix.lower()]


def _loaded(gripper: str | Path | Gripper) -> Gripper:
    return gripper if isinstance(gripper, Gripper) else load_gripper(gripper)
