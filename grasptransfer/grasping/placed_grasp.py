"""A grasp of one object, in that object's own frame: what grasp files hold and what is executed."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import GraspFileError
from grasptransfer.grasping.grasp import DEFAULT_APPROACH_DISTANCE, Grasp, keep_pose_and_contacts


@runtime_checkable
class Executable(Protocol):
    """What a grasp must say so that it can be executed: `WarpedGrasp` and `TransferredGrasp` do."""

    @property
    def name(self) -> str:
        """Unique among those that are executed together."""
        ...

    @property
    def object_from_gripper(self) -> Float[np.ndarray, "4 4"]:
        """TCP pose [m]."""
        ...

    @property
    def width(self) -> float | None:
        """Distance between the pads when they touch [m]; None: they close from open."""
        ...

    @property
    def opening(self) -> float | None:
        """Distance between the pads on the way in [m]; None: a little more than `width`."""
        ...

    @property
    def approach_distance(self) -> float | None:
        """Straight way in along +z [m]; None: the default."""
        ...


@dataclass(frozen=True)
class PlacedGrasp:
    """A grasp of one object, in that object's frame.

    Args:
        name: unique in its file.
        label: what it is for (`rim`, `handle`, `hand-over`, ...).
        object_from_gripper: TCP pose (4, 4) [m].
        width: distance between the pads when they touch [m]; None where it is not known.
        approach_distance: straight way along +z that ends at the grasp [m].
        contacts: points (2, 3) of the surface under the -x and the +x pad, object frame [m].
        confidence: 0 to 1.
        opening: distance between the pads on the way in [m]; None: a little more than `width`.
    """

    name: str
    label: str
    object_from_gripper: Float[np.ndarray, "4 4"]
    width: float | None
    approach_distance: float = DEFAULT_APPROACH_DISTANCE
    contacts: Float[np.ndarray, "2 3"] | None = None
    confidence: float = 1.0
    opening: float | None = None

    def __post_init__(self):
        keep_pose_and_contacts(self, "object_from_gripper")

    @staticmethod
    def on_canonical(grasp: Grasp) -> "PlacedGrasp":
        """An annotated grasp on the canonical model itself, whose frame is the object's then."""
        return PlacedGrasp(
            grasp.name,
            grasp.label,
            grasp.canonical_from_gripper,
            grasp.width,
            grasp.approach_distance,
            grasp.contacts,
            grasp.confidence,
            grasp.opening,
        )


def placed(grasp: "PlacedGrasp | Grasp | Executable | np.ndarray", index: int) -> PlacedGrasp:
    """Any grasp as a `PlacedGrasp`.

    Args:
        grasp: an annotated one lies on the canonical model; a bare (4, 4) array is `object_from_gripper` [m].
        index: among the grasps, to name a bare array by.

    Raises:
        GraspFileError: none of these.
        PoseError: the pose is not rigid, or in millimetres.
    """
    if isinstance(grasp, PlacedGrasp):
        return grasp
    if isinstance(grasp, Grasp):
        return PlacedGrasp.on_canonical(grasp)
    if isinstance(grasp, np.ndarray):
        return PlacedGrasp(f"grasp_{index}", "grasp", grasp, None)
    if not isinstance(grasp, Executable):
        raise GraspFileError(
            "is no grasp",
            key=f"grasps[{index}]",
            value=type(grasp).__name__,
            fix="Give PlacedGrasp(name, label, object_from_gripper, width), or a (4, 4) array",
        )
    return placed_at(grasp, grasp.object_from_gripper)


def placed_at(grasp: Executable, object_from_gripper: Float[np.ndarray, "4 4"]) -> PlacedGrasp:
    """A grasp at another TCP pose (4, 4) [m], as where the object does not stand where it was believed to.

    Raises:
        PoseError: the pose is not rigid, or in millimetres.
    """
    approach = DEFAULT_APPROACH_DISTANCE if grasp.approach_distance is None else grasp.approach_distance
    return PlacedGrasp(
        str(grasp.name), "grasp", object_from_gripper, grasp.width, approach, opening=grasp.opening
    )
