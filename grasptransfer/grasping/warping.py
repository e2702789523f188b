"""Grasps of the canonical model, moved to an instance by its deformation field.

| method | position | orientation |
| --- | --- | --- |
| `contacts` | rigid fit to the warped contacts and the patches around them | the same fit |
| `jacobian` | the TCP, p' = p + v(p) | polar decomposition of J R, J = I + dv/dp |
| `nearest` | the displacement of the nearest surface point | that point's Jacobian, decomposed |

Measured on the test instances of all shipped categories, moved by their true fields, before refinement
(265 grasps): `contacts` leaves 254 free, and nine in ten close within 18 degrees of flat; `jacobian` 245 and
21; `nearest` 244 and 24. Executed (114 of them, lift-shake-v1): 67, 64 and 64 % held, and after refinement
77, 75 and 77 %. So `contacts` is the default where a grasp has them, and refinement evens the rest out.

The field is learned on the surface: `contacts` and `nearest` ask it there, `jacobian` also beside it.
Sources: Rodriguez, Huber and Behnke 2020, section III (warping by the field); Arun, Huang and Blostein,
Least-Squares Fitting of Two 3-D Point Sets, 1987 (rigid fit).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import GraspFileError, SettingsError
from grasptransfer.frames import nearest_rotation, rigid
from grasptransfer.grasping.grasp import Grasp, order_contacts

METHODS = ("contacts", "jacobian", "nearest")

PATCH = 0.005  # m around each contact: the part of a finger tip that touches


@runtime_checkable
class Field(Protocol):
    """What a deformation field answers: `registration.DeformationField`, or a pair of them."""

    def __call__(self, points: Float[np.ndarray, "m 3"], /) -> Float[np.ndarray, "m 3"]:
        """Warped points [m]."""
        ...

    def jacobian(self, points: Float[np.ndarray, "m 3"], /) -> Float[np.ndarray, "m 3 3"]:
        """I + dv/dp at the points."""
        ...


@dataclass(frozen=True)
class WarpedGrasp:
    """A grasp moved to an instance.

    Args:
        source: the annotated grasp.
        object_from_gripper: the TCP pose (4, 4) on the instance [m].
        width: distance between the pads when they touch, from the warped contacts [m].
        contacts: warped contacts (2, 3), -x side first, object frame [m].
        opening: distance between the pads on the way in [m], or None for a little more than `width`.
        method: the way in which it was moved.
        stretch: smallest and largest singular value of the field's Jacobian at the contacts, or at the
            TCP without them; the smallest is negative where the field turns space inside out.
    """

    source: Grasp
    object_from_gripper: Float[np.ndarray, "4 4"]
    width: float
    contacts: Float[np.ndarray, "2 3"] | None
    opening: float | None
    method: str
    stretch: tuple[float, float]

    @property
    def name(self) -> str:
        """As annotated; members of a symmetry family carry their turn in it."""
        return self.source.name

    @property
    def approach_distance(self) -> float:
        """Straight way along +z that ends at the grasp [m], as annotated."""
        return self.source.approach_distance

    def closing_at(
        self, object_from_gripper: Float[np.ndarray, "4 4"], width: float, contacts: Float[np.ndarray, "2 3"]
    ) -> "WarpedGrasp":
        """The grasp at another TCP pose (4, 4) [m], where the pads close on this width; its room stays."""
        opening = None if self.opening is None else self.opening + width - self.width
        return replace(
            self, object_from_gripper=object_from_gripper, width=width, contacts=contacts, opening=opening
        )


def warp_grasps(
    grasps: Sequence[Grasp],
    field: Field,
    *,
    method: str = "contacts",
    surface_points: Float[np.ndarray, "n 3"] | None = None,
) -> tuple[WarpedGrasp, ...]:
    """Move grasps from the canonical model to the instance that a field describes.

    Args:
        grasps: annotated grasps; expand their symmetry first.
        field: field from canonical points to the instance's [m].
        method: a grasp without contacts falls back from `contacts` to `jacobian`.
        surface_points: points of the canonical surface [m], for `nearest`; None takes the field's
            control points.

    Raises:
        SettingsError: unknown method, or no surface points for `nearest`.
    """
    if method not in METHODS:
        raise SettingsError("is not a way to warp", key="method", value=method, choices=METHODS)
    if not grasps:
        return ()
    poses = np.stack([grasp.canonical_from_gripper for grasp in grasps])
    anchors = poses[:, :3, 3].copy()
    if method == "nearest":
        anchors = _nearest(anchors, field, surface_points)
    jacobians, moved = field.jacobian(anchors), field(anchors)
    rotations = nearest_rotation(jacobians @ poses[:, :3, :3])
    positions = moved + poses[:, :3, 3] - anchors
    stretches = _stretches(grasps, field, jacobians)
    contacts = _warped_contacts(grasps, field)
    warped = []
    for i, grasp in enumerate(grasps):
        used, pose, patches = method, rigid(rotations[i], positions[i]), contacts[i]
        if method == "contacts":
            if patches is None:
                used = "jacobian"
            else:
                pose = _fitted(grasp, patches)
        ends = None if patches is None else order_contacts(patches[[0, 5]], pose)
        stretch = (float(stretches[i, 0]), float(stretches[i, 1]))
        warped.append(_warped(grasp, pose, ends, jacobians[i], used, stretch))
    return tuple(warped)


def on_canonical(grasps: Sequence[Grasp]) -> tuple[WarpedGrasp, ...]:
    """Grasps as they were annotated, on the canonical model itself."""
    return tuple(
        _warped(grasp, grasp.canonical_from_gripper, grasp.contacts, np.eye(3), "contacts", (1.0, 1.0))
        for grasp in grasps
    )


def _stretches(
    grasps: Sequence[Grasp], field: Field, jacobians: Float[np.ndarray, "g 3 3"]
) -> Float[np.ndarray, "g 2"]:
    """Signed smallest and largest singular value, of the mean Jacobian of a grasp's contacts."""
    known = [grasp.contacts is not None for grasp in grasps]
    ends = [grasp.contacts for grasp in grasps if grasp.contacts is not None]
    jacobians = jacobians.copy()
    if ends:
        at_ends = field.jacobian(np.concatenate(ends)).reshape(-1, 2, 3, 3)
        jacobians[known] = at_ends.mean(axis=1)
    values = np.linalg.svd(jacobians, compute_uv=False)[:, [2, 0]]
    values[:, 0] *= np.sign(np.linalg.det(jacobians))
    return values


def _nearest(
    points: Float[np.ndarray, "g 3"], field: Field, surface_points: Float[np.ndarray, "n 3"] | None
) -> Float[np.ndarray, "g 3"]:
    from scipy.spatial import KDTree

    if surface_points is None:
        surface_points = getattr(field, "control_points", None)
    if surface_points is None:
        raise SettingsError("must be given for the nearest method with this field", key="surface_points")
    return surface_points[KDTree(surface_points).query(points)[1]]


def _patches(grasp: Grasp) -> Float[np.ndarray, "10 3"]:
    """Each contact, then four points around it along the gripper's y and z."""
    y, z = grasp.canonical_from_gripper[:3, 1] * PATCH, grasp.canonical_from_gripper[:3, 2] * PATCH
    offsets = np.stack([np.zeros(3), y, -y, z, -z])
    assert grasp.contacts is not None
    return (grasp.contacts[:, None] + offsets).reshape(10, 3)


def _warped_contacts(grasps: Sequence[Grasp], field: Field) -> list[Float[np.ndarray, "10 3"] | None]:
    """Warped patches of every grasp that has contacts, in one call of the field."""
    known = [i for i, grasp in enumerate(grasps) if grasp.contacts is not None]
    result: list[Float[np.ndarray, "10 3"] | None] = [None] * len(grasps)
    if known:
        moved = field(np.concatenate([_patches(grasps[i]) for i in known])).reshape(-1, 10, 3)
        for i, patch in zip(known, moved, strict=True):
            result[i] = patch
    return result


def _fitted(grasp: Grasp, warped: Float[np.ndarray, "10 3"]) -> Float[np.ndarray, "4 4"]:
    """The pose after the rigid motion that best takes the patches to their warped places."""
    patches, pose = _patches(grasp), grasp.canonical_from_gripper
    centred, centred_warped = patches - patches.mean(axis=0), warped - warped.mean(axis=0)
    rotation = nearest_rotation(centred_warped.T @ centred)
    middle, middle_warped = (points[[0, 5]].mean(axis=0) for points in (patches, warped))
    # The TCP keeps its place relative to the middle of the contacts.
    position = middle_warped + rotation @ (pose[:3, 3] - middle)
    return rigid(nearest_rotation(rotation @ pose[:3, :3]), position)


def _warped(
    grasp: Grasp,
    object_from_gripper: Float[np.ndarray, "4 4"],
    contacts: Float[np.ndarray, "2 3"] | None,
    jacobian: Float[np.ndarray, "3 3"],
    method: str,
    stretch: tuple[float, float],
) -> WarpedGrasp:
    if contacts is not None:
        width = float((contacts[1] - contacts[0]) @ object_from_gripper[:3, 0])
    elif grasp.width is None:
        raise GraspFileError(
            "its width is not known",
            key=grasp.name,
            fix="Give contacts or width, or load the grasps with their category, which measures them",
        )
    else:
        width = grasp.width * float(np.linalg.norm(jacobian @ grasp.canonical_from_gripper[:3, 0]))
    return WarpedGrasp(
        source=grasp,
        object_from_gripper=object_from_gripper,
        width=width,
        contacts=contacts,
        # The annotator's room beside the object stays as it was.
        opening=None if grasp.opening is None else grasp.opening + width - (grasp.width or 0.0),
        method=method,
        stretch=stretch,
    )
