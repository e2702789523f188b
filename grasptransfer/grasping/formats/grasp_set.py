"""What every format is read into and written from, and the frames they use for a grasp.

| format | gripper axes | origin |
| --- | --- | --- |
| ours | +z approach, +x closing | TCP, between the pads |
| ACRONYM, GraspGen, Contact-GraspNet | +z approach, +x closing | gripper base |
| isaac_grasp | those of the link it names | that link |
| graspnetAPI | +x approach, +y closing | grasp centre, finger tips `depth` ahead |
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped

from grasptransfer.errors import NOT_NUMBERS, GraspFileError, PoseError
from grasptransfer.frames import check_rigid, invert
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.grasping.placed_grasp import PlacedGrasp

LARGEST_SCALE = 1e6  # no mesh is given in a smaller unit than micrometres
LOG = logging.getLogger(__name__)
OBJECT, CAMERA, CANONICAL = "object", "camera", "canonical"
WORLDS = ("world", "map", "odom", "base", "base_link", "robot")  # frames that are no object's


@dataclass(frozen=True)
class GraspSet:
    """Grasps of one object.

    Args:
        grasps: the grasps, in `object_frame`.
        object_frame: the frame they are in: the object's, by the name in the file, or "camera".
        object_file: mesh the grasps belong to, where the file says so.
        object_scale: factor from that mesh to metres; the grasps are in metres.
        gripper: whose TCP poses they are; None where they come from no file.

    Raises:
        GraspFileError: a scale of 0 or below.
    """

    grasps: tuple[PlacedGrasp, ...]
    object_frame: str = OBJECT
    object_file: str | None = None
    object_scale: float = 1.0
    gripper: Gripper | None = None

    def __post_init__(self):
        if not (np.isfinite(self.object_scale) and self.object_scale > 0):
            raise GraspFileError("must be above 0", key="object_scale", value=self.object_scale)

    @property
    def in_other_frame(self) -> bool:
        """Whether the poses are a camera's or the world's, and the object's only by its pose there."""
        name = self.object_frame.lower().removeprefix("/")
        if "/" in name:  # the path of a prim, as Isaac writes it: /World/camera is a photo camera
            return False
        return name in WORLDS or name.startswith(CAMERA) or "optical" in name

    def in_object_frame(self, camera_from_object: Float[np.ndarray, "4 4"] | None) -> "GraspSet":
        """The same grasps in the frame of the object.

        Args:
            camera_from_object: (4, 4) where the object stood [m]; asked only of grasps in another frame than
                the object's: a camera's, or the world's.

        Raises:
            GraspFileError: the pose is wanted and missing, or given where nothing is in a camera's frame.
        """
        if not self.in_other_frame:
            if camera_from_object is not None:
                raise GraspFileError(
                    "is for grasps in a camera's or the world's frame", key="pose", value=self.object_frame
                )
            return self
        if camera_from_object is None:
            raise GraspFileError(
                "grasps are in a camera's or the world's frame, not in the object's",
                key="object_frame",
                value=self.object_frame,
                fix="Give the object's pose in the picture: --pose FILE; the identity if they are its own",
            )
        object_from_camera = invert(camera_from_object)
        moved = tuple(
            replace(grasp, object_from_gripper=object_from_camera @ grasp.object_from_gripper)
            for grasp in self.grasps
        )
        return replace(self, grasps=moved, object_frame=OBJECT)


def base_from_tcp(gripper: Gripper) -> Float[np.ndarray, "4 4"]:
    """From the TCP to the gripper base with the TCP's axes: ACRONYM's and GraspGen's frame."""
    moved = np.eye(4)
    moved[:3, 3] = gripper.base_from_tcp[:3, :3].T @ gripper.base_from_tcp[:3, 3]
    return moved


def rigid_poses(values: object, path: Path, key: str) -> Float[np.ndarray, "g 4 4"]:
    """Check a list of poses, naming the one at fault.

    Raises:
        GraspFileError: not (n, 4, 4), or one of them not rigid or in millimetres.
    """
    try:
        poses = np.array(values, dtype=float)
    except NOT_NUMBERS as error:
        raise GraspFileError("must hold 4x4 matrices of numbers", path=path, key=key) from error
    if poses.size == 0:
        raise GraspFileError("holds no grasp", path=path, key=key)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise GraspFileError("must be of shape (n, 4, 4)", path=path, key=key, value=poses.shape)
    checked = []
    for i, pose in enumerate(poses):
        try:
            checked.append(check_rigid(pose, f"{key}[{i}]"))
        except PoseError as error:
            raise error.at(path, kind=GraspFileError) from error
    return np.stack(checked)


def confidences_of(scores: Shaped[np.ndarray, "g"], path: Path, key: str) -> Float[np.ndarray, "g"]:
    """Scores as confidences of 0 to 1; what goes beyond is squeezed evenly, which keeps their order.

    Raises:
        GraspFileError: not finite.
    """
    scores = np.asarray(scores, float)
    if not np.isfinite(scores).all():
        raise GraspFileError("must be finite", path=path, key=key)
    low, high = min(0.0, float(scores.min(initial=0))), max(1.0, float(scores.max(initial=1)))
    if (low, high) != (0.0, 1.0):
        LOG.warning("%s: scores of %g to %g were scaled to 0 to 1, in their order.", path, low, high)
    return (scores - low) / (high - low)


def scale_of(value: object, path: Path, key: str) -> float:
    """Factor from the object's mesh to metres.

    Raises:
        GraspFileError: no number above 0.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        raise GraspFileError("must be a number", path=path, key=key, value=value)
    if not 0 < value <= LARGEST_SCALE:
        raise GraspFileError(
            f"must be above 0 and at most {LARGEST_SCALE:g}", path=path, key=key, value=value
        )
    return float(value)


def numbered(
    poses: Float[np.ndarray, "g 4 4"],
    confidences: Float[np.ndarray, "g"],
    widths: Sequence[float | None],
) -> tuple[PlacedGrasp, ...]:
    """Grasps of a format without names: `grasp_0`, `grasp_1`, ..."""
    return tuple(
        PlacedGrasp(f"grasp_{i}", "grasp", pose, width, confidence=float(confidence))
        for i, (pose, confidence, width) in enumerate(zip(poses, confidences, widths, strict=True))
    )


def stacked(grasp_set: GraspSet, path: Path) -> Float[np.ndarray, "g 4 4"]:
    """TCP poses in the object's frame, for a file that has no place for another frame.

    Raises:
        GraspFileError: they are in a camera's frame.
    """
    try:
        grasps = grasp_set.in_object_frame(None).grasps
    except GraspFileError as error:
        raise error.at(path) from error
    return np.stack([grasp.object_from_gripper for grasp in grasps])
