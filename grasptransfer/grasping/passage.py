"""How near a gripper passes obstacles on a straight way."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.grasping.world import CollisionWorld, OpenedGripper

STEP = 0.004  # m between poses, near an obstacle
NEAR = 0.01  # m: obstacles farther away are not measured exactly


@dataclass(frozen=True)
class Passage:
    """Where a gripper is nearest to an obstacle.

    Args:
        room: between them [m].
        distance: from the start of the way [m].
        link, obstacle: which they are.
    """

    room: float
    distance: float
    link: str
    obstacle: str


def passage(
    world: CollisionWorld,
    object_from_gripper: Float[np.ndarray, "4 4"],
    opened: OpenedGripper,
    way: Float[np.ndarray, "3"],
    *,
    least: float,
) -> Passage:
    """The nearest obstacle on a way; the way ends early where there is less room than wanted.

    Args:
        world: with an obstacle or a support plane at least.
        object_from_gripper: (4, 4) where the way starts [m].
        way: from there, object frame [m].
        least: room that is wanted [m].
    """
    length = float(np.linalg.norm(way))
    pose, distance, nearest = object_from_gripper.copy(), 0.0, None
    while True:
        beside = world.beside(pose, opened)
        row = int(np.argmin(beside.distance))
        here = Passage(float(beside.distance[row]), distance, beside.links[row], beside.obstacles[row])
        nearest = here if nearest is None or here.room < nearest.room else nearest
        if nearest.room < least or distance >= length:
            return nearest
        # What is far away cannot come near within that way.
        distance = min(distance + max(STEP, here.room - min(nearest.room, NEAR)), length)
        pose[:3, 3] = object_from_gripper[:3, 3] + distance / length * way
