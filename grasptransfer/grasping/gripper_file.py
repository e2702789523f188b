"""The YAML file of a gripper, checked on its own and against its URDF."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from grasptransfer.errors import GripperError, in_millimetres
from grasptransfer.files import read_yaml
from grasptransfer.grasping.urdf_geometry import Joint
from grasptransfer.grasping.yaml_models import RigidPose, Strict, check_unit_quaternion, parse


class JointModel(Strict):
    """A joint that follows the driver: `ratio * driver + offset`."""

    ratio: float = 1.0
    offset: float = 0.0


class PadModel(Strict):
    """The inner face of a finger: its link, its centre in that link [m], its size along TCP y and z [m]."""

    link: str
    centre: tuple[float, float, float]
    size: tuple[float, float]


class GripperModel(Strict):
    """Every key of the file."""

    name: str
    urdf: str
    base_link: str
    base_from_tcp: RigidPose
    joints: dict[str, JointModel]
    opening: tuple[float, float]
    force_limit: float
    pads: tuple[PadModel, PadModel]


LARGEST_PAD = 0.5  # m


def read_gripper_file(path: Path) -> GripperModel:
    """Read a gripper's YAML.

    Raises:
        GripperError: a mistake in it, named by file, key, value and choices.
    """
    model = parse(GripperModel, read_yaml(path, error=GripperError), path, error=GripperError)
    check_unit_quaternion(
        model.base_from_tcp.orientation, path, "base_from_tcp.orientation", error=GripperError
    )
    low, high = model.opening
    if not 0 <= low < high <= 1:
        raise GripperError(
            "must be two rising lengths in metres", path=path, key="opening", value=[low, high]
        )
    if model.force_limit <= 0:
        raise GripperError("must be positive", path=path, key="force_limit", value=model.force_limit)
    if not model.joints:
        raise GripperError("must name at least one joint", path=path, key="joints")
    for i, pad in enumerate(model.pads):
        if min(pad.size) <= 0:
            raise GripperError("must be positive", path=path, key=f"pads.{i}.size", value=list(pad.size))
        if max(pad.size) > LARGEST_PAD:
            raise in_millimetres(GripperError, path=path, key=f"pads.{i}.size", value=list(pad.size))
    return model


def check_against_urdf(
    model: GripperModel, moving: Mapping[str, Joint], links: Sequence[str], path: Path
) -> None:
    """Refuse joints and links that the URDF does not have, and joints that the file forgets.

    Args:
        moving: the URDF's moving joints below the base link, by name.
        links: names of the links at and below it.

    Raises:
        GripperError: named by key and choices.
    """
    for name in model.joints:
        if name not in moving:
            raise GripperError(
                "is not a moving joint below the base link", path=path, key=f"joints.{name}", choices=moving
            )
    missing = [name for name in moving if name not in model.joints]
    if missing:
        raise GripperError(
            "moves below the base link and must be listed, with its ratio to the driver",
            path=path,
            key=f"joints.{missing[0]}",
        )
    if next(iter(model.joints.values())).ratio == 0:
        raise GripperError("the driver's ratio must not be 0", path=path, key="joints")
    for i, pad in enumerate(model.pads):
        if pad.link not in links:
            raise GripperError(
                "is not a link below the base link",
                path=path,
                key=f"pads.{i}.link",
                value=pad.link,
                choices=links,
            )
