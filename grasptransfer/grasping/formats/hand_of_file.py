"""For which gripper a grasp file was made: by the name that the file gives, or by its joints.

The base and the TCP of two hands lie centimetres apart, so grasps of one are never read as those of another.
"""

import re
from collections.abc import Iterable
from pathlib import Path

from grasptransfer.errors import GraspFileError
from grasptransfer.grasping.gripper import Gripper, list_grippers, load_gripper

DEFAULT = "panda"  # of files that name no gripper: ACRONYM's and graspnetAPI's data are made for it
GENERIC = {"gripper", "hand", "default", "urdf", "usd", "model", "description"}  # words of any hand's name
MAKERS = {"robotiq", "onrobot", "schunk", "weiss", "kinova", "franka", "emika", "interbotix", "ufactory"}
ALSO = {"panda": ("franka", "franka_emika")}  # other names of shipped grippers
AT_REST = 1e-3  # m or rad by which a joint may go beyond its range, from rounding


def choose_gripper(
    given: Gripper | None, named: str | None, path: Path, *, key: str, joints: Iterable[str] = ()
) -> Gripper:
    """The gripper whose frames a file means.

    Args:
        given: the caller's gripper; None: the one that the file names or whose joints it has, else the Panda.
        named: what the file says: a name, or the path of a gripper's model.
        path, key: path of the file, and key of the name in it.
        joints: names of the joints in the file.

    Raises:
        GraspFileError: the file names another gripper than the given one, or one that is not known.
    """
    if named is not None and not _words(named) - GENERIC:
        named = None
    if given is not None:
        if named is not None and not _same(named, given):
            raise GraspFileError(
                f"is another gripper than {given.name}, which it is to be read for",
                path=path,
                key=key,
                value=named,
                fix=_way_out(),
            )
        return given
    shipped = [load_gripper(name) for name in list_grippers()]
    if named is None:
        moved = set(joints)
        found = [gripper for gripper in shipped if gripper.finger_joints[0].name in moved]
        if not found:
            return load_gripper(DEFAULT)
    else:
        found = [gripper for gripper in shipped if _same(named, gripper)]
        found = [gripper for gripper in found if _letters(gripper.name) == _letters(named)] or found
    if len(found) == 1:
        return found[0]
    raise GraspFileError(
        "may be any of several grippers" if found else f"is not known, and {DEFAULT} is not assumed for it",
        path=path,
        key=key,
        value=named or sorted(joints),
        choices=[gripper.name for gripper in found or shipped],
        fix="Give the gripper of the file: --gripper NAME or YAML",
    )


def check_joints(joints: Iterable[str], gripper: Gripper, path: Path, *, key: str) -> None:
    """Refuse joint positions of another gripper.

    Raises:
        GraspFileError: there are joints, and the gripper's driver is none of them.
    """
    joints, driver = list(joints), gripper.finger_joints[0].name
    if joints and driver not in joints:
        raise GraspFileError(
            f"names joints of another gripper than {gripper.name}, which is driven by {driver}",
            path=path,
            key=key,
            value=joints,
            choices=[joint.name for joint in gripper.finger_joints],
            fix=_way_out(),
        )


def check_driver(value: float, gripper: Gripper, path: Path, *, key: str) -> None:
    """Refuse a position that the gripper's driver does not take, of a joint that happens to have its name.

    Args:
        value: value of the driver [m or rad], without the joint's own ratio and offset.

    Raises:
        GraspFileError: beyond the range of the driver.
    """
    low, high = float(gripper.driver_table.min()), float(gripper.driver_table.max())
    if not low - AT_REST <= value <= high + AT_REST:
        raise GraspFileError(
            f"is beyond what {gripper.name} moves, {low:.4g} to {high:.4g}",
            path=path,
            key=key,
            value=value,
            fix="Is the file for another gripper? Give it: --gripper NAME or YAML",
        )


def _way_out() -> str:
    known = ", ".join(list_grippers())
    return f"Give the file's: --gripper with a YAML that carries its name, or one of {known}"


def _words(name: str) -> set[str]:
    """Letters and numbers of a name apart: `robotiq_2f85.usd` -> robotiq, 2, f, 85."""
    return set(re.findall(r"[a-z]+|[0-9]+", Path(name).stem.lower()))


def _same(named: str, gripper: Gripper) -> bool:
    """Whether a name may mean this gripper: one inside the other, or alike but for the maker."""
    plain, words = _letters(named), _words(named) - GENERIC
    for own in (gripper.name, gripper.path.stem, gripper.urdf_path.stem, *ALSO.get(gripper.name, ())):
        other, own_words = _letters(own), _words(own) - GENERIC
        if own_words and (other in plain or plain in other or words == own_words):
            return True
        if own_words - MAKERS and words - MAKERS == own_words - MAKERS:
            return True
    return False


def _letters(name: str) -> str:
    return "".join(re.findall(r"[a-z0-9]", Path(name).stem.lower()))
