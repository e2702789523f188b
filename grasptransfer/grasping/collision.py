"""Whether a gripper can reach a grasp: opened, along its approach, and with something to close on.

Every grasp gets a status and a sentence that names the link, the obstacle and how deep they overlap.
"""

import dataclasses
import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from grasptransfer.grasping.closing import Closing, close_pads
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.grasping.passage import passage
from grasptransfer.grasping.scene import Scene
from grasptransfer.grasping.surface import Surface
from grasptransfer.grasping.warping import WarpedGrasp
from grasptransfer.grasping.world import CollisionWorld, OpenedGripper, Touch, as_world

if TYPE_CHECKING:
    import trimesh


MARGIN = 0.002  # m kept from obstacles: a calibrated arm's own error, and some of a camera's
LIFT = 0.10  # m along which the closed hand is checked against obstacles, as the protocols lift
STEP = 0.004  # m between checked poses of the approach: less than a third of a finger's thickness
SWEEP_STEP = 0.010  # m of opening between checks of the closing: each finger moves half of it
LEAST_ROOM = 0.001  # m on each side of the object, below which the opened gripper does not get around it
TRIED_ROOM = (0.005, 0.002)  # m on each side, tried where the usual room does not fit
SAME_WIDTH = 0.003  # m; where the pads close on another width, they close on another part
LARGEST_STRETCH = 5.0  # of the field's Jacobian: no two mugs differ that much beside a contact
LARGEST_LATENT = 3.0  # RMS in standard deviations; about 1 for members of the category


class CheckStatus(enum.Enum):
    """Outcome of the check; `advice` says what to do about it."""

    FREE = "free"
    IN_COLLISION = "in collision"
    BLOCKED_APPROACH = "blocked approach"
    BLOCKED_LIFT = "blocked lift"
    TOO_WIDE = "too wide"
    NO_CONTACT = "no contact"
    OUT_OF_SHAPE_SPACE = "out of the shape space"
    UNLIKELY_TO_HOLD = "unlikely to hold"
    OUT_OF_REACH = "out of reach"

    @property
    def usable(self) -> bool:
        """Whether the gripper reaches the grasp and closes on the object."""
        return self is CheckStatus.FREE

    @property
    def advice(self) -> str:
        """One sentence of advice."""
        return _ADVICE[self]


_ADVICE = {
    CheckStatus.FREE: "The gripper reaches this grasp and closes on the object.",
    CheckStatus.IN_COLLISION: "Refine the grasp, use slimmer fingers, or clear the named obstacle away.",
    CheckStatus.BLOCKED_APPROACH: "Come in along another direction, or shorten approach_distance.",
    CheckStatus.BLOCKED_LIFT: "Clear the named obstacle away, or take the object out another way.",
    CheckStatus.TOO_WIDE: "Use a gripper that opens wider, or grasp the object elsewhere.",
    CheckStatus.NO_CONTACT: "Refine the grasp: as it stands a pad closes beside the object.",
    CheckStatus.UNLIKELY_TO_HOLD: "Prefer another grasp: this one would slip on many plausible shapes.",
    CheckStatus.OUT_OF_REACH: "Move the robot's base or the object: its arm does not get to this grasp.",
    CheckStatus.OUT_OF_SHAPE_SPACE: "Do not trust this grasp: the object differs too much from its category.",
}


@dataclass(frozen=True)
class GraspCheck:
    """The answer for one grasp.

    Args:
        status: what was found.
        reason: one sentence with the numbers.
        opening: distance between the pads on the way in [m].
        link, obstacle: what touches what, where something does.
        depth: how far the obstacle reaches into the link [m].
        before_grasp: how far before the grasp the approach, or above it the lift, is blocked [m].
        contacts: points (2, 3) where the pads close, object frame [m], or None.
        width: distance between the pads then [m], or None.
        antipodality: cosine between the worse contact's normal and the closing axis; 1 is perfect.
        room: between the gripper and the nearest obstacle, on the way in and in the lift [m]; None without
            obstacles.
    """

    status: CheckStatus
    reason: str
    opening: float
    link: str | None = None
    obstacle: str | None = None
    depth: float | None = None
    before_grasp: float | None = None
    contacts: Float[np.ndarray, "2 3"] | None = None
    width: float | None = None
    antipodality: float | None = None
    room: float | None = None

    @property
    def usable(self) -> bool:
        """Whether the gripper reaches the grasp and closes on the object."""
        return self.status.usable


def check_grasps(
    grasps: Sequence[WarpedGrasp],
    mesh: "trimesh.Trimesh | Surface | CollisionWorld",
    gripper: Gripper,
    *,
    scene: Scene | None = None,
    camera_from_object: Float[np.ndarray, "4 4"] | None = None,
    latent: Float[np.ndarray, "k"] | None = None,
) -> tuple[GraspCheck, ...]:
    """Check that the gripper reaches each grasp and closes on the object.

    Args:
        grasps: in the mesh's frame.
        mesh: the object's surface, object frame [m]; a `CollisionWorld` brings its own scene.
        scene: obstacles and support plane, camera frame.
        camera_from_object: pose of the object (4, 4) [m]; matters with a scene only.
        latent: of the shape, standard deviations; too far out, and no grasp on it is trusted.
    """
    if not grasps:
        return ()
    world = as_world(mesh, scene, camera_from_object)
    poses = np.stack([grasp.object_from_gripper for grasp in grasps])
    far = 0.0 if latent is None or not len(latent) else float(np.sqrt(np.mean(latent**2)))
    if far > LARGEST_LATENT:
        reason = f"the shape lies {far:.1f} standard deviations from its category's mean"
        opening = gripper.max_width
        return tuple(GraspCheck(CheckStatus.OUT_OF_SHAPE_SPACE, reason, opening) for _ in grasps)
    found = [_reach(grasp, world, gripper) for grasp in grasps]
    openings = np.array([check.opening for check in found])
    widths = np.array([grasp.width for grasp in grasps])
    closing = close_pads(world.surface, poses, openings, gripper, expected=widths)
    return _with_hint([_close(check, closing, i, gripper) for i, check in enumerate(found)], gripper)


def _reach(grasp: WarpedGrasp, world: CollisionWorld, gripper: Gripper) -> GraspCheck:
    """Status of the way in, before anything closes."""
    usual = gripper.approach_opening(grasp.width) if grasp.opening is None else grasp.opening
    usual = float(np.clip(usual, *gripper.opening))
    low, high = grasp.stretch
    if low <= 0 or high > LARGEST_STRETCH:
        what = "folds" if low <= 0 else f"stretches {high:.1f} times"
        reason = f"the deformation field {what} at this grasp"
        return GraspCheck(CheckStatus.OUT_OF_SHAPE_SPACE, reason, usual)
    if grasp.width + 2 * LEAST_ROOM > gripper.max_width:
        reason = (
            f"the object is {grasp.width * 1e3:.0f} mm wide here; "
            f"{gripper.name} opens {gripper.max_width * 1e3:.0f} mm"
        )
        return GraspCheck(CheckStatus.TOO_WIDE, reason, usual)
    tried = [usual, gripper.max_width, *(grasp.width + 2 * room for room in TRIED_ROOM)]
    first = None
    for opening in dict.fromkeys(float(np.clip(value, *gripper.opening)) for value in tried):
        if opening < grasp.width + 2 * LEAST_ROOM:
            continue
        if opening > usual and not _closes_alike(grasp, world, gripper, opening):
            continue
        check = _approach(grasp, world, gripper, opening)
        if check.usable:
            return check
        first = first or check
    assert first is not None
    return first


def _closes_alike(grasp: WarpedGrasp, world: CollisionWorld, gripper: Gripper, opening: float) -> bool:
    """Whether pads that start farther apart close on the same part of the object."""
    pose, width = grasp.object_from_gripper[None], np.array([grasp.width])
    closing = close_pads(world.surface, pose, np.array([opening]), gripper, expected=width)
    return bool(closing.touching.all() and abs(closing.width[0] - grasp.width) < SAME_WIDTH)


def _approach(grasp: WarpedGrasp, world: CollisionWorld, gripper: Gripper, opening: float) -> GraspCheck:
    """Status of one opening: at the grasp, then along the way in."""
    opened, pose = OpenedGripper(gripper, opening), grasp.object_from_gripper
    touching = world.touching(pose, opened)
    pairs = touching or world.swallowed(pose, opened)
    if pairs:
        hit = {opened.parts[i].name for i, j in pairs if j == 0}
        touch = world.deepest(pose, opened, pairs)
        if all(hit & body for body in gripper.pad_bodies) and opening > gripper.max_width - 1e-6:
            reason = f"both fingers hit the object with the gripper fully open ({opening * 1e3:.0f} mm)"
            return _blocked(CheckStatus.TOO_WIDE, reason, opening, touch)
        reason = _overlap(touch) if touching else f"{touch.link} lies inside {touch.obstacle}"
        return _blocked(CheckStatus.IN_COLLISION, reason, opening, touch)
    steps = max(1, int(np.ceil(grasp.approach_distance / STEP)))
    back = pose.copy()
    for distance in np.linspace(grasp.approach_distance, 0, steps, endpoint=False):
        back[:3, 3] = pose[:3, 3] - distance * pose[:3, 2]
        pairs = world.touching(back, opened)
        if pairs:
            touch = world.deepest(back, opened, pairs)
            reason = f"{distance * 1e3:.0f} mm before the grasp, {_overlap(touch)}"
            return _blocked(CheckStatus.BLOCKED_APPROACH, reason, opening, touch, float(distance))
    check = _sweep(grasp, world, gripper, opening)
    return _beside_obstacles(check, grasp, world, gripper) if check.usable and world.has_obstacles else check


def _beside_obstacles(
    check: GraspCheck, grasp: WarpedGrasp, world: CollisionWorld, gripper: Gripper
) -> GraspCheck:
    """Add the room beside obstacles, on the way in and in the lift; refuse less than `MARGIN`."""
    pose, room = grasp.object_from_gripper, np.inf
    closed = float(np.clip(grasp.width, *gripper.opening))
    ways = (
        (check.opening, -grasp.approach_distance * pose[:3, 2], "before", CheckStatus.BLOCKED_APPROACH),
        (closed, LIFT * world.up, "above", CheckStatus.BLOCKED_LIFT),
    )
    for opening, way, where, status in ways:
        nearest = passage(world, pose, OpenedGripper(gripper, opening), way, least=MARGIN)
        room = min(room, nearest.room)
        if nearest.room < MARGIN:
            touch, before = Touch(nearest.link, nearest.obstacle, 0.0), nearest.distance or None
            at = f"{nearest.distance * 1e3:.0f} mm {where} the grasp, " if before else ""
            passes = f"{at}{touch.link} passes {nearest.room * 1e3:.1f} mm beside {touch.obstacle}"
            reason, status = (
                f"{passes}; {MARGIN * 1e3:.0f} mm are kept",
                status if before else CheckStatus.IN_COLLISION,
            )
            return _blocked(status, reason, check.opening, touch, before)
    return dataclasses.replace(check, room=room)


def _sweep(grasp: WarpedGrasp, world: CollisionWorld, gripper: Gripper, opening: float) -> GraspCheck:
    """Status of the closing itself: nothing but the object may stop the fingers."""
    pose = grasp.object_from_gripper
    last = max(grasp.width + 2 * LEAST_ROOM, gripper.opening[0])
    for width in [*np.arange(opening - SWEEP_STEP, last, -SWEEP_STEP), last]:
        opened = OpenedGripper(gripper, float(width))
        pairs = [
            (i, j)
            for i, j in world.touching(pose, opened)
            # A pad that touches the object early has simply closed.
            if j != 0 or opened.parts[i].name not in gripper.finger_links
        ]
        if pairs:
            touch = world.deepest(pose, opened, pairs)
            reason = f"while closing, at {width * 1e3:.0f} mm, {_overlap(touch)}"
            return _blocked(CheckStatus.IN_COLLISION, reason, opening, touch)
    return GraspCheck(CheckStatus.FREE, "reachable", opening)


def _overlap(touch: Touch) -> str:
    if touch.depth < 1e-4:
        return f"{touch.link} grazes {touch.obstacle}"
    return f"{touch.link} reaches {touch.depth * 1e3:.1f} mm into {touch.obstacle}"


def _blocked(
    status: CheckStatus, reason: str, opening: float, touch: Touch, before: float | None = None
) -> GraspCheck:
    return GraspCheck(status, reason, opening, touch.link, touch.obstacle, touch.depth, before)


def _with_hint(checks: list[GraspCheck], gripper: Gripper) -> tuple[GraspCheck, ...]:
    """The checks; where one link that is no finger blocks every grasp, each reason says what may be wrong."""
    links = {check.link for check in checks}
    link = links.pop()
    if len(checks) < 2 or links or link is None or link in gripper.finger_links:
        return tuple(checks)
    hint = (
        f"{link} blocks every grasp: if its collision geometry is only a safety margin, "
        f"add ignore_links: [{link}] to {gripper.path.name}"
    )
    return tuple(dataclasses.replace(check, reason=f"{check.reason} ({hint})") for check in checks)


def _close(check: GraspCheck, closing: Closing, i: int, gripper: Gripper) -> GraspCheck:
    """Add what the pads meet."""
    if not check.usable:
        return check
    touching = closing.touching[i]
    if not touching.all():
        sides = [side for side, touches in zip(("-x", "+x"), touching, strict=True) if not touches]
        reason = f"closing from {check.opening * 1e3:.0f} mm, the {' and the '.join(sides)} pad meets nothing"
        return dataclasses.replace(check, status=CheckStatus.NO_CONTACT, reason=reason)
    width, cosine = float(closing.width[i]), float(closing.cosines[i].min())
    if closing.opening[i] < gripper.opening[0] - LEAST_ROOM:
        reason = (
            f"the object is {1e3 * width:.0f} mm wide here; {gripper.name} closes to "
            f"{1e3 * gripper.opening[0]:.0f} mm"
        )
        return dataclasses.replace(check, status=CheckStatus.NO_CONTACT, reason=reason)
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return dataclasses.replace(
        check,
        reason=f"free; the pads close on {width * 1e3:.1f} mm, at most {angle:.0f} degrees from flat",
        contacts=closing.points[i],
        width=width,
        antipodality=cosine,
    )
