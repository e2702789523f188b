"""A box, grasps of it, and protocols: what the tests of the simulation share."""

import dataclasses

import numpy as np
import trimesh

from grasptransfer.grasping import load_gripper
from grasptransfer.simulation import PROTOCOLS

PANDA = load_gripper("panda")
LIFT_SHAKE = PROTOCOLS["lift-shake-v1"]
BOX = trimesh.creation.box([0.04, 0.05, 0.12])  # 0.12 kg


@dataclasses.dataclass
class Placed:
    """A grasp as `simulate` takes it."""

    name: str
    object_from_gripper: np.ndarray
    width: float | None = None
    opening: float | None = None
    approach_distance: float | None = None


def from_above(x=0.0, y=0.0, z=0.0):
    """Down along z, closing along x."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = x, y, z
    return pose


def from_the_side(x=0.0, y=0.0, z=0.0):
    """Along +y, closing along x."""
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    pose[:3, 3] = x, y, z
    return pose


def own(**numbers):
    return dataclasses.replace(LIFT_SHAKE, name="own", **numbers)


def held(results):
    return sum(result.held for result in results)
