"""A PyBullet client in DIRECT mode, and poses as Bullet writes them."""

import functools
import os
import sys

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

BASE = -1  # Bullet's index of a body's root link


class BulletClient:
    """One connection to the physics engine."""

    def __init__(self):
        self.bullet = _pybullet()
        self._number = self.bullet.connect(self.bullet.DIRECT)
        self._calls: dict[str, functools.partial] = {}

    def close(self):
        """Disconnect."""
        self.bullet.disconnect(physicsClientId=self._number)

    def call(self, name: str, *arguments, **options):
        """A function of pybullet, on this client."""
        bound = self._calls.get(name)
        if bound is None:
            function = getattr(self.bullet, name)
            bound = self._calls[name] = functools.partial(function, physicsClientId=self._number)
        return bound(*arguments, **options)


def quaternion(rotation: Float[np.ndarray, "3 3"]) -> list[float]:
    """The rotation as (x, y, z, w)."""
    return Rotation.from_matrix(rotation).as_quat().tolist()


def position_and_quaternion(a_from_b: Float[np.ndarray, "4 4"]) -> tuple[list[float], list[float]]:
    """The transform as Bullet takes it: position [m] and (x, y, z, w)."""
    return a_from_b[:3, 3].tolist(), quaternion(a_from_b[:3, :3])


def transform(position, orientation) -> Float[np.ndarray, "4 4"]:
    """`a_from_b` from Bullet's position and quaternion; written out, as a trial needs it a thousand times."""
    x, y, z, w = orientation
    a_from_b = np.eye(4)
    a_from_b[:3, :3] = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    a_from_b[:3, 3] = position
    return a_from_b


def _pybullet():
    """The module `pybullet`, imported without the greeting that its C code writes to standard error."""
    if "pybullet" in sys.modules:
        return sys.modules["pybullet"]
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        import pybullet
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
    return pybullet
