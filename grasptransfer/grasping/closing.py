"""Where the pads touch when a gripper closes: ray casts between them, many grasps at once.

Each ray leaves a point of an opened pad along the TCP's x and meets what that point would touch. Pads stand
as they will when they touch: a linkage moves them along z as it closes, and a jaw turns.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float

from grasptransfer.grasping.gripper import SIDE, Gripper
from grasptransfer.grasping.surface import Surface

RAYS = 5  # per pad side: 25 rays, 4.5 mm apart on a Panda's pad
GRAZE = 2e-4  # m that an object may reach into a jaw that stands against it already, as in a trial
TOUCH = 0.001  # m behind the first hit that a soft pad also touches


@dataclass(frozen=True)
class Closing:
    """What the two pads (-x, +x) meet, for g grasps.

    Args:
        points: middle of each touched patch of the surface, its frame [m]; NaN where nothing is touched.
        normals: unit outward normals there, averaged over the patch.
        local: the points of the pads that meet them, TCP frame [m].
        touching: whether each pad meets anything.
        buried: whether a pad starts inside the object: a ray from it meets a face from behind.
        coverage: touched share of each pad, 0 to 1.
        cosines: of the angle between each normal and its pad's; 1 is flat, 0 grazing.
        width: distance along x between what the pads touch, when both do [m]; NaN where one does not.
        opening: distance between the pads' centres then [m]; other than `width` where a pad is tilted.
        off_centre: how far the middle of the object lies from the middle between the opened pads, along x
            [m]; NaN where a pad touches nothing.
    """

    points: Float[np.ndarray, "g 2 3"]
    normals: Float[np.ndarray, "g 2 3"]
    local: Float[np.ndarray, "g 2 3"]
    touching: Bool[np.ndarray, "g 2"]
    buried: Bool[np.ndarray, "g 2"]
    coverage: Float[np.ndarray, "g 2"]
    cosines: Float[np.ndarray, "g 2"]
    width: Float[np.ndarray, "g"]
    opening: Float[np.ndarray, "g"]
    off_centre: Float[np.ndarray, "g"]


@lru_cache(maxsize=8)
def _pad_grid(gripper: Gripper) -> Float[np.ndarray, "2 r 2"]:
    """Ray origins on each pad, along its y and z from its centre [m]."""
    # Rays stand in the middles of equal cells: each speaks for its share of the pad.
    steps = (np.arange(RAYS) + 0.5) / RAYS - 0.5
    cells = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.stack([cells * pad.size for pad in gripper.pads])


def _ray_starts(
    gripper: Gripper, opening: Float[np.ndarray, "g"], expected: Float[np.ndarray, "g"]
) -> tuple[Float[np.ndarray, "g 2 r 3"], Float[np.ndarray, "g 2 3"]]:
    """Where the rays leave the opened pads, and the pads' normals, TCP frame [m].

    Args:
        opening: distance between the pads at the start [m].
        expected: distance between them when they touch, which decides how they stand [m].
    """
    grid = _pad_grid(gripper)
    apart, which = np.unique(expected, return_inverse=True)
    faces = gripper.pad_faces(apart).take(which)
    starts = np.empty((len(opening), *grid.shape[:2], 3))
    # A tilted face is shorter, seen along TCP x.
    starts[..., 1:] = grid * np.sqrt(1 - faces.normals[..., 1:] ** 2)[:, :, None]
    recede = (starts[..., 1:] @ faces.slopes[..., None])[..., 0]
    centres = gripper.pad_middle(opening)[:, None] + opening[:, None] / 2 * SIDE
    starts[..., 0] = centres[:, :, None] + recede
    starts[..., 1:] += faces.across[:, :, None]
    return starts, faces.normals


def _rays(
    object_from_gripper: Float[np.ndarray, "g 4 4"], starts: Float[np.ndarray, "g 2 r 3"]
) -> tuple[Float[np.ndarray, "g 2 r 3"], Float[np.ndarray, "g 2 r 3"]]:
    """Origins and directions of the rays from the pads inwards, object frame [m]."""
    rotation, position = object_from_gripper[:, :3, :3], object_from_gripper[:, :3, 3]
    origins = starts @ rotation[:, None].swapaxes(2, 3) + position[:, None, None]
    inward = -SIDE[None, :, None] * rotation[:, None, :, 0]
    return origins, np.broadcast_to(inward[:, :, None], origins.shape)


def _first_hits(
    surface: Surface,
    origins: Float[np.ndarray, "g 2 r 3"],
    directions: Float[np.ndarray, "g 2 r 3"],
    graze: float,
) -> tuple[Float[np.ndarray, "g 2 r"], Float[np.ndarray, "g 2 r 3"]]:
    """Distance [m] to the first face that each ray meets, infinite where none is, and its normal.

    Args:
        graze: the rays start this far behind their origins [m].
    """
    hit = surface.first_hits((origins - graze * directions).reshape(-1, 3), directions.reshape(-1, 3))
    distance, faces = (values.reshape(origins.shape[:-1]) for values in hit)
    return np.maximum(distance - graze, 0.0), surface.mesh.face_normals[faces]


def _unit(vectors: Float[np.ndarray, "g 2 3"]) -> Float[np.ndarray, "g 2 3"]:
    """Of length 1; zero stays zero."""
    length = np.linalg.norm(vectors, axis=2, keepdims=True)
    return vectors / np.where(length > 0, length, 1)


def close_pads(
    surface: Surface,
    object_from_gripper: Float[np.ndarray, "g 4 4"],
    opening: Float[np.ndarray, "g"],
    gripper: Gripper,
    *,
    expected: Float[np.ndarray, "g"] | None = None,
) -> Closing:
    """Close the pads of every grasp from its opening until they touch the surface.

    Args:
        object_from_gripper: TCP poses in the mesh's frame [m].
        opening: distance between the pads at the start [m].
        expected: about how wide the object is [m]: pads stand as they do at this opening.
    """
    expected = opening if expected is None else expected
    closing = _close_as(surface, object_from_gripper, opening, gripper, expected)
    if not gripper.pads_turn:
        return closing
    # Pads that turn stand otherwise at the opening that this finds.
    found = np.where(np.isfinite(closing.opening), closing.opening, expected)
    return _close_as(surface, object_from_gripper, opening, gripper, found)


def _close_as(
    surface: Surface,
    object_from_gripper: Float[np.ndarray, "g 4 4"],
    opening: Float[np.ndarray, "g"],
    gripper: Gripper,
    expected: Float[np.ndarray, "g"],
) -> Closing:
    """Close pads that stand all the way as they do at the expected opening."""
    starts, pad_normals = _ray_starts(gripper, opening, expected)
    rotation = object_from_gripper[:, :3, :3]
    origins, directions = _rays(object_from_gripper, starts)
    distance, face_normals = _first_hits(surface, origins, directions, 0.0 if gripper.pads_mirror else GRAZE)
    behind = np.einsum("gprj,gprj->gpr", face_normals, directions) > 0
    # A pad can only touch what lies between the pads.
    within = np.where(distance < opening[:, None, None], distance, np.inf)
    first = within.min(axis=2)
    touching = np.isfinite(first)
    patch = (within <= first[..., None] + TOUCH) & touching[..., None]
    weight = patch / np.maximum(patch.sum(axis=2, keepdims=True), 1)
    local = (weight[:, :, None] @ starts)[:, :, 0]
    if gripper.pads_turn:  # the point of a tilted face that touches first, not the middle of those near it
        nearest = within.argmin(axis=2)[..., None]
        local[..., 0] = np.take_along_axis(starts[..., 0], nearest, axis=2)[..., 0]
    local[..., 0] -= SIDE * np.where(touching, first, 0.0)
    hits = origins + np.where(patch, within, 0.0)[..., None] * directions
    points = (weight[:, :, None] @ hits)[:, :, 0]
    normals = _unit((weight[:, :, None] @ face_normals)[:, :, 0])
    facing = np.einsum("gij,gpj->gpi", rotation, pad_normals)
    nowhere, both = ~touching[..., None], touching.all(axis=1)
    return Closing(
        points=np.where(nowhere, np.nan, points),
        normals=np.where(nowhere, np.nan, normals),
        local=np.where(nowhere, np.nan, local),
        touching=touching,
        buried=(behind & np.isfinite(distance)).any(axis=2),
        coverage=patch.mean(axis=2),
        cosines=np.where(touching, -np.einsum("gpi,gpi->gp", normals, facing), 0.0),
        width=np.where(both, local[:, 1, 0] - local[:, 0, 0], np.nan),
        opening=np.where(both, opening - np.where(touching, first, 0.0).sum(axis=1), np.nan),
        off_centre=np.where(both, local[..., 0].mean(axis=1) - gripper.pad_middle(opening), np.nan),
    )
