"""A grasp of the canonical model, and its symmetry."""

import dataclasses
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.errors import GraspFileError
from grasptransfer.frames import check_rigid, rigid, transform_points

DEFAULT_APPROACH_DISTANCE = 0.10  # m; a finger's length and a bit


@dataclass(frozen=True)
class Symmetry:
    """Turns of a grasp about an axis that give grasps just as good.

    Args:
        axis: direction of the axis, canonical frame.
        point: a point on the axis, canonical frame [m].
        degrees: the turns, or None for `samples` turns spread over `range_degrees`.
        samples: how many turns to take from the range.
        range_degrees: first and last turn; a full circle does not repeat its start.
        flip: also turn each half about the approach: the same grasp of a two-finger gripper.
    """

    axis: Float[np.ndarray, "3"]
    point: Float[np.ndarray, "3"]
    degrees: tuple[float, ...] | None = None
    samples: int | None = None
    range_degrees: tuple[float, float] = (0.0, 360.0)
    flip: bool = False

    def turns(self) -> tuple[float, ...]:
        """Every turn in degrees."""
        if self.degrees is not None:
            return self.degrees
        if self.samples is None:
            return (0.0,)
        low, high = self.range_degrees
        closed = np.isclose(high - low, 360)
        return tuple(float(turn) for turn in np.linspace(low, high, self.samples, endpoint=not closed))


LONGEST = 5.0  # m: anything longer was given in millimetres


@dataclass(frozen=True)
class Grasp:
    """A grasp of the canonical model.

    Args:
        name: name that no other grasp of its file has.
        label: what it is for (`rim`, `handle`, `hand-over`, ...).
        canonical_from_gripper: TCP pose (4, 4) [m].
        width: distance between the pads when they touch [m]; None: not known, they close from open.
        approach_distance: straight way along +z that ends at the grasp [m].
        contacts: points (2, 3) of the surface under the -x and the +x pad, canonical frame [m].
        symmetry: turns that give equally good grasps.
        confidence: the annotator's, 0 to 1.
        opening: distance between the pads on the way in [m]; None: a little more than `width`.
    """

    name: str
    label: str
    canonical_from_gripper: Float[np.ndarray, "4 4"]
    width: float | None
    approach_distance: float = DEFAULT_APPROACH_DISTANCE
    contacts: Float[np.ndarray, "2 3"] | None = None
    symmetry: Symmetry | None = None
    confidence: float = 1.0
    opening: float | None = None

    def __post_init__(self):
        keep_pose_and_contacts(self, "canonical_from_gripper")


def keep_pose_and_contacts(grasp: Any, pose: str) -> None:
    """Check the pose and order the contacts of a new grasp, and keep both as arrays that nobody can write to.

    Args:
        grasp: a frozen record with a name, this pose and contacts.
        pose: name of its `a_from_gripper`.

    Raises:
        PoseError: the pose is not rigid, or in millimetres.
        GraspFileError: a length that is none.
    """
    for key in ("width", "approach_distance", "opening"):
        value = getattr(grasp, key)
        if value is not None and not 0 <= value <= LONGEST:
            message = f"must be a length from 0 to {LONGEST:g} m"
            raise GraspFileError(message, key=f"{grasp.name}.{key}", value=value)
    a_from_gripper = check_rigid(getattr(grasp, pose), f"{grasp.name}: {pose}")
    kept = {pose: a_from_gripper}
    if grasp.contacts is not None:
        kept["contacts"] = order_contacts(np.array(grasp.contacts, dtype=float), a_from_gripper)
    for field, array in kept.items():
        array.setflags(write=False)
        object.__setattr__(grasp, field, array)


def order_contacts(
    contacts: Float[np.ndarray, "2 3"], a_from_gripper: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "2 3"]:
    """The two points with the one on the gripper's -x side first."""
    closing = a_from_gripper[:3, 0]
    return contacts if (contacts[1] - contacts[0]) @ closing >= 0 else contacts[::-1].copy()


# Half a turn about the approach: the two fingers change places.
GRIPPER_FROM_FLIPPED = np.diag([-1.0, -1.0, 1.0, 1.0])


def flipped(grasp: Grasp) -> Grasp:
    """The same two-finger grasp with the fingers exchanged."""
    return dataclasses.replace(
        grasp,
        name=f"{grasp.name}/flip",
        canonical_from_gripper=grasp.canonical_from_gripper @ GRIPPER_FROM_FLIPPED,
        symmetry=None,
    )


def expand_symmetry(grasps: Iterable[Grasp], *, flip: bool = False) -> tuple[Grasp, ...]:
    """Every member of each grasp's symmetry family, named `name/30deg` and `name/30deg/flip`.

    Args:
        flip: also turn every grasp half about its approach, whether or not its symmetry says so.

    Raises:
        GraspFileError: two members share a name.
    """
    expanded = []
    for grasp in grasps:
        symmetry = grasp.symmetry
        family = [grasp] if symmetry is None else [_turned(grasp, turn) for turn in symmetry.turns()]
        for member in family:
            plain = dataclasses.replace(member, symmetry=None)
            expanded.append(plain)
            if flip or (symmetry is not None and symmetry.flip):
                expanded.append(flipped(plain))
    for name, count in Counter(grasp.name for grasp in expanded).items():
        if count > 1:
            raise GraspFileError("two grasps, or turns of one, share a name", key="grasps", value=name)
    return tuple(expanded)


def _turned(grasp: Grasp, degrees: float) -> Grasp:
    symmetry = grasp.symmetry
    assert symmetry is not None
    if degrees % 360 == 0:
        return grasp
    turn = _about(symmetry.axis, symmetry.point, np.radians(degrees))
    return dataclasses.replace(
        grasp,
        name=f"{grasp.name}/{degrees:.4g}deg",
        canonical_from_gripper=turn @ grasp.canonical_from_gripper,
        contacts=None if grasp.contacts is None else transform_points(turn, grasp.contacts),
    )


def _about(
    axis: Float[np.ndarray, "3"], point: Float[np.ndarray, "3"], angle: float
) -> Float[np.ndarray, "4 4"]:
    """Turn by `angle` [rad] about the axis through `point`."""
    rotation = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    return rigid(rotation, point - rotation @ point)
