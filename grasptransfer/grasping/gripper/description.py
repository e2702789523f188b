"""The YAML file of a gripper, checked on its own."""

from pathlib import Path

import numpy as np
from pydantic import Field

from grasptransfer.data_files import read_yaml
from grasptransfer.errors import GripperError, in_millimetres
from grasptransfer.yaml_models import RigidPose, Strict, check_unit_quaternion, parse

LARGEST_PAD = 0.5  # m


class JointModel(Strict):
    """A joint that follows the driver: `ratio * driver + offset`; what is left out is the URDF's."""

    ratio: float | None = None
    offset: float | None = None


class PadModel(Strict):
    """The inner face of a finger.

    Its link, its centre in that link [m], its size along TCP y and z [m], and where its link turns the
    direction in that link in which it faces the other pad.
    """

    link: str
    centre: tuple[float, float, float]
    size: tuple[float, float]
    normal: tuple[float, float, float] | None = None


class GripperModel(Strict):
    """Every key of the file."""

    name: str
    urdf: str
    base_link: str
    base_from_tcp: RigidPose
    joints: dict[str, JointModel] = Field(default_factory=dict)
    opening: tuple[float, float]
    force_limit: float
    pads: tuple[PadModel, PadModel]
    ignore_links: tuple[str, ...] = ()
    solid_visuals: tuple[str, ...] = ()


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
    for i, pad in enumerate(model.pads):
        _check_pad(pad, f"pads.{i}", path)
        if pad.link in model.ignore_links:
            raise GripperError(
                "carries a pad and must collide", path=path, key="ignore_links", value=pad.link
            )
    return model


def _check_pad(pad: PadModel, key: str, path: Path) -> None:
    if min(pad.size) <= 0:
        raise GripperError("must be positive", path=path, key=f"{key}.size", value=list(pad.size))
    if max(pad.size) > LARGEST_PAD:
        raise in_millimetres(GripperError, path=path, key=f"{key}.size", value=list(pad.size))
    if pad.normal is not None and np.linalg.norm(pad.normal) < 1e-6:
        raise GripperError("must have a length", path=path, key=f"{key}.normal", value=list(pad.normal))
