"""One trial: pre-check, approach, close, lift, shake, turn; each phase can end it with a reason."""

import time

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.frames import invert, rotation_angle
from grasptransfer.simulation import motion
from grasptransfer.simulation.engines.seam import World
from grasptransfer.simulation.job import Job
from grasptransfer.simulation.outcome import NEAR_LIMIT, TrialResult, TrialStatus
from grasptransfer.simulation.watched_motion import TrialEnded, WatchedMotion

LEAST_ROOM = 0.001  # m: with less room on each side of the object the gripper does not get around it.
STALLED = 2e-4  # m: fingers whose opening changes by less between two checks have closed.
TOPPLED = (0.01, 5.0)  # m, degrees: an object that moves more than this does not stand by itself.
NOT_LIFTED = 0.01  # m: a hand that stops so far below the lift's height has not made the lift.
SPARE_TIME = 1.25  # Closing may take this multiple of the stroke's time at the protocol's speed.
LIMIT_SPEED = 1.0  # m/s: closed fingers are driven at this speed, so that their motors give all their force.


def run_trial(world: World, job: Job) -> TrialResult:
    """Execute one grasp in a freshly loaded world, in which nothing of earlier trials remains."""
    started = time.perf_counter()
    watched = WatchedMotion(world, job)
    try:
        Phases(watched).run()
        status, detail = TrialStatus.HELD, f"held to the end, {watched.slip_text()}"
        if watched.limit_used > NEAR_LIMIT:
            detail += f"; it came to {watched.limit_used:.0%} of a limit of {world.protocol.name}"
    except TrialEnded as end:
        status, detail = end.status, end.detail
    return TrialResult(
        grasp=job.grasp,
        trial=job.trial,
        status=status,
        phase=watched.phase,
        detail=detail,
        slip_mm=round(watched.slip * 1e3, 4),
        slip_degrees=round(watched.slip_degrees, 4),
        limit_used=round(watched.limit_used, 4),
        max_penetration_mm=round(watched.penetration * 1e3, 4),
        width_mm=round(world.width() * 1e3, 4),
        protocol=world.protocol.name,
        gripper=world.hand.name,
        engine=world.engine,
        friction=job.conditions.friction,
        mass=job.conditions.mass,
        force=job.conditions.force,
        seconds=time.perf_counter() - started,
        recording=watched.recording(),
    )


class Phases:
    """The phases of one trial."""

    def __init__(self, watched: WatchedMotion):
        self.watched, self.job = watched, watched.job
        self.world, self.gripper, self.protocol = watched.world, watched.gripper, watched.protocol

    def run(self):
        """All phases; raises `TrialEnded` in the one that fails."""
        self._stand()
        self._check_width()
        grasp = self.world.world_from_object() @ self.job.object_from_tcp
        self._check_grasp(grasp)
        self._approach(grasp)
        self.close(grasp)
        self._lift(grasp)
        if self.protocol.shake_acceleration > 0:
            self._shake()
        if self.protocol.turn_degrees > 0:
            self._turn()
        self.watched.phase = "rest"
        self.watched.stay(self.protocol.settle_time)
        self.watched.both_pads()
        self.watched.in_step()

    def _stand(self):
        """Let the object stand on the table by itself, before the gripper comes."""
        if self.protocol.support != "table":
            return
        self.watched.phase = "settle"
        before = self.world.world_from_object()
        away = np.eye(4)
        away[2, 3] = 10.0
        self.gripper.place(away, self.job.opening)
        for _ in range(round(self.protocol.table_settle_time / self.protocol.time_step)):
            self.world.step()
        moved = invert(before) @ self.world.world_from_object()
        shift, angle = float(np.linalg.norm(moved[:3, 3])), np.degrees(rotation_angle(moved[:3, :3]))
        if not (shift < TOPPLED[0] and angle < TOPPLED[1]):
            text = f"the object does not stand: it moved {shift * 1e3:.0f} mm, {angle:.0f} degrees"
            raise TrialEnded(TrialStatus.UNSTABLE, text)
        self.watched.phase = "pre-check"

    def _check_width(self):
        width, widest = self.job.width, self.world.hand.opening[1]
        if width is not None and width + 2 * LEAST_ROOM > widest:
            text = f"the object is {width * 1e3:.0f} mm wide here; the gripper opens {widest * 1e3:.0f} mm"
            raise TrialEnded(TrialStatus.TOO_WIDE, text)
        least = self.world.hand.narrowest
        if width is not None and width < least - LEAST_ROOM:
            text = f"the object is {width * 1e3:.0f} mm wide here; the gripper closes to {least * 1e3:.0f} mm"
            raise TrialEnded(TrialStatus.NO_CONTACT, text)

    def _check_grasp(self, world_from_tcp: Float[np.ndarray, "4 4"]):
        self.gripper.place(world_from_tcp, self.job.opening)
        distance, link, obstacle = self.world.nearest()
        if distance >= -self.protocol.clearance_tolerance:
            return
        fully = self.job.opening > self.world.hand.opening[1] - 1e-6
        overlapping = self.world.overlapping() if fully else set()
        if all(overlapping & body for body in self.world.hand.pad_bodies):
            text = (
                f"both fingers hit the object with the gripper fully open ({self.job.opening * 1e3:.0f} mm)"
            )
            raise TrialEnded(TrialStatus.TOO_WIDE, text)
        text = f"{link} reaches {-distance * 1e3:.1f} mm into {obstacle}{self._hint(link)}"
        raise TrialEnded(TrialStatus.IN_COLLISION, text)

    def _hint(self, link: str) -> str:
        """What may be wrong where a link that is neither base nor finger is in the way."""
        hand = self.world.hand
        if link == hand.link_names[0] or any(link in body for body in hand.pad_bodies):
            return ""
        return f" (if {link} is only a safety margin, add ignore_links: [{link}] to the gripper's YAML)"

    def _approach(self, world_from_tcp: Float[np.ndarray, "4 4"]):
        """Approach along +z without physics; a collision on the way ends the trial with its own reason."""
        self.watched.phase = "approach"
        step, back = self.protocol.approach_step, world_from_tcp.copy()
        left = self.job.approach_distance
        while left > 0:
            back[:3, 3] = world_from_tcp[:3, 3] - left * world_from_tcp[:3, 2]
            self.gripper.place(back, self.job.opening)
            distance, link, obstacle = self.world.nearest()
            self.watched.record(moment=-left / 0.2)
            if distance < -self.protocol.clearance_tolerance:
                text = (
                    f"{left * 1e3:.0f} mm before the grasp, "
                    f"{link} reaches {-distance * 1e3:.1f} mm into {obstacle}"
                )
                raise TrialEnded(TrialStatus.BLOCKED_APPROACH, text)
            # An obstacle farther away than the step cannot be touched within the step.
            longest = 0.01 if self.watched.records else np.inf
            left -= max(step, min(distance, longest))
        self.gripper.place(world_from_tcp, self.job.opening)

    def close(self, world_from_tcp: Float[np.ndarray, "4 4"]):
        """Close the fingers until they stall, then let the object hang from them."""
        self.watched.phase = "close"
        world, gripper, protocol = self.world, self.gripper, self.protocol
        force = self.job.conditions.force
        if protocol.support == "air":
            world.damp(protocol.air_damping)
        gripper.hold(world_from_tcp)
        self.watched.target = world_from_tcp
        opening = gripper.opening()
        stroke_time = SPARE_TIME * opening / (2 * protocol.finger_speed)
        longest = max(protocol.close_time, stroke_time)
        for _ in range(round(longest / (self.watched.watch_every * protocol.time_step))):
            gripper.drive_fingers(protocol.finger_speed, force, opening)
            self.watched.step(self.watched.watch_every)
            before, opening = opening, gripper.opening()
            if before - opening < STALLED:
                break
        gripper.drive_fingers(LIMIT_SPEED, force, opening)
        self.watched.step(self.watched.watch_every)
        self.watched.both_pads(TrialStatus.NO_CONTACT)
        self.watched.in_step()
        world.weigh(True)
        world.damp(0.0)
        self.watched.tcp_from_object = invert(gripper.world_from_tcp()) @ world.world_from_object()

    def _lift(self, grasp: Float[np.ndarray, "4 4"]):
        self.watched.phase = "lift"
        self.watched.stay(self.protocol.settle_time)
        before = self._heights()
        heights = motion.lift_heights(self.protocol)
        places = np.tile(grasp[:3, 3], (len(heights), 1))
        places[:, 2] += heights
        self.watched.follow(places, np.broadcast_to(grasp[:3, :3], (len(heights), 3, 3)))
        self.watched.stay(self.protocol.settle_time)
        self.watched.both_pads()
        hand, lifted = self._heights() - before
        if hand < self.protocol.lift_height - NOT_LIFTED:
            text = f"the hand rose by {hand * 1e3:.0f} of {self.protocol.lift_height * 1e3:.0f} mm"
            raise TrialEnded(TrialStatus.UNSTABLE, text)
        if lifted < self.protocol.lift_height - NOT_LIFTED - self.protocol.slip:
            raise TrialEnded(TrialStatus.SLIPPED_LIFT, f"the object rose by {lifted * 1e3:.0f} mm alone")

    def _heights(self) -> Float[np.ndarray, "2"]:
        """Heights of the TCP and of the object's centre of mass [m]."""
        placed = self.world.world_from_object()
        centre = placed[:3, :3] @ self.world.body.centre_of_mass + placed[:3, 3]
        return np.array([self.gripper.world_from_tcp()[2, 3], centre[2]])

    def _shake(self):
        self.watched.phase = "shake"
        swing, start = motion.swing(self.protocol), self.watched.target
        for axis in range(3):
            if not self.protocol.shake_jumps:
                start = self.watched.target
            places = start[:3, 3] + swing[:, None] * start[:3, axis]
            self.watched.follow(places, np.broadcast_to(start[:3, :3], (len(swing), 3, 3)))

    def _turn(self):
        self.watched.phase = "turn"
        angles, start = motion.turns(self.protocol), self.watched.target
        closing = Rotation.from_rotvec(angles[:, None] * np.array([1.0, 0, 0])).as_matrix()
        places = np.broadcast_to(start[:3, 3], (len(angles), 3))
        self.watched.follow(places, start[:3, :3] @ closing)
