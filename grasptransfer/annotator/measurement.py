"""What the pads meet at a grasp on the canonical model, and whether the gripper gets there."""

from dataclasses import dataclass, replace

import numpy as np
import trimesh
from jaxtyping import Float

from grasptransfer.grasping import CheckStatus, CollisionWorld, Grasp, Gripper, check_grasps, on_canonical
from grasptransfer.grasping.closing import close_pads


@dataclass(frozen=True)
class Measurement:
    """Where the pads close, and the check of the way there.

    Args:
        status, reason: of the check.
        opening: distance between the pads on the way in [m].
        width: when they touch [m], or None.
        contacts: (2, 3) under the -x and the +x pad, canonical frame [m], or None.
        offset: how far the middle of the contacts is from the TCP along the closing axis [m].
    """

    status: CheckStatus
    reason: str
    opening: float
    width: float | None
    contacts: Float[np.ndarray, "2 3"] | None
    offset: float

    @property
    def usable(self) -> bool:
        """Whether every check passed."""
        return self.status.usable


class Measurer:
    """Measures grasps on one mesh with one gripper.

    Args:
        mesh: canonical frame [m].
    """

    def __init__(self, mesh: trimesh.Trimesh, gripper: Gripper):
        self.world, self.gripper = CollisionWorld(mesh), gripper

    def measure(self, grasp: Grasp) -> Measurement:
        """Close the pads and check the gripper's way to a grasp."""
        opening = self.gripper.max_width if grasp.opening is None else grasp.opening
        stated = self.gripper.max_width if grasp.width is None else grasp.width
        points, width, offset = self._touched(grasp.canonical_from_gripper, opening)
        if width is None:
            # Nothing between wide-open pads may still be something between nearly closed ones.
            closer = self.gripper.approach_opening(min(stated, self.gripper.max_width))
            points, width, offset = self._touched(grasp.canonical_from_gripper, closer)
        seen = replace(grasp, contacts=points, width=stated if width is None else width)
        check = check_grasps(on_canonical([seen]), self.world, self.gripper)[0]
        return Measurement(check.status, check.reason, check.opening, width, points, offset)

    def _touched(
        self, pose: Float[np.ndarray, "4 4"], opening: float
    ) -> tuple[Float[np.ndarray, "2 3"] | None, float | None, float]:
        """Contacts, width and offset of the pads closed from `opening`; nothing unless both touch."""
        closing = close_pads(self.world.surface, pose[None], np.array([opening]), self.gripper)
        if not closing.touching[0].all():
            return None, None, 0.0
        offset = float(closing.local[0, :, 0].mean())
        return closing.points[0], float(closing.width[0]), offset
