"""What a gripper does with boxes of known width: the quickest check of a gripper of one's own.

Each box stands upright, 40 mm deep and 100 mm high; the gripper comes from above, the box's middle between
its opened pads, and holds the uppermost quarter of the pads' height.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from grasptransfer.frames import rigid
from grasptransfer.grasping.grasp import Grasp
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.simulation.execution import simulate
from grasptransfer.simulation.outcome import TrialResult

if TYPE_CHECKING:
    import trimesh

DEPTH, HEIGHT = 0.04, 0.1  # m: all boxes share these two sides.
DOWNWARDS = np.diag([1.0, -1.0, -1.0])
COVERED = 0.25  # The box's top lies above the middle of the pads by this share of their height.


def box_widths(gripper: Gripper) -> tuple[float, float, float]:
    """The three widths [m]: 20 mm, 50 mm, and nine tenths of the largest opening."""
    return 0.02, 0.05, 0.9 * gripper.max_width


def box_of(width: float) -> "trimesh.Trimesh":
    """A box of this width along x [m], its middle at the origin."""
    import trimesh

    return trimesh.creation.box(extents=(width, DEPTH, HEIGHT))


def box_grasp(gripper: Gripper, width: float) -> Grasp:
    """The grasp of a box of this width [m] from above."""
    opening, pads = gripper.approach_opening(width), np.clip([width], *gripper.opening)
    # This is the position of the pads' middle along the TCP's z.
    along = float(gripper.pad_faces(pads).across[0, :, 1].mean())
    covered = COVERED * min(pad.size[1] for pad in gripper.pads)
    middle = float(gripper.pad_middle(np.array([opening]))[0])
    position = np.array([-middle, 0.0, HEIGHT / 2 - covered + along])
    return Grasp("top", "box", rigid(DOWNWARDS, position), width)


def hold_boxes(
    gripper: Gripper, widths: Sequence[float] | None = None, *, engine: str | None = None
) -> list[TrialResult]:
    """Execute the grasp of each box, by `lift-shake-v1`.

    Args:
        gripper: the gripper to check.
        widths: widths of the boxes [m]; None takes those of `box_widths`.
        engine: physics engine, as for `simulate`.
    """
    widths = box_widths(gripper) if widths is None else widths
    return [
        simulate([box_grasp(gripper, width)], box_of(width), gripper, engine=engine)[0] for width in widths
    ]
