"""One trial: pre-check, approach, close, lift, shake, turn; each phase can end it with a reason."""

import time

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.frames import invert, rotation_angle
from grasptransfer.simulation import motion
from grasptransfer.simulation.engines.seam import World
from grasptransfer.simulation.job import Job
from grasptransfer.simulation.outcome import Recording, TrialResult, TrialStatus

LEAST_ROOM = 0.001  # m: with less room on each side of the object the gripper does not get around it.
WATCH = 0.05  # s between two checks of contacts and slip.
STALLED = 2e-4  # m: fingers whose opening changes by less between two checks have closed.
TOPPLED = (0.01, 5.0)  # m, degrees: an object that moves more than this does not stand by itself.
RUNAWAY = 5.0  # m/s: no motion of a protocol is that fast.
OUT_OF_STEP = 0.003  # m: coupled joints may disagree about the opening by this much.
NOT_LIFTED = 0.01  # m: a hand that stops so far below the lift's height has not made the lift.
SPARE_TIME = 1.25  # Closing may take this multiple of the stroke's time at the protocol's speed.
LIMIT_SPEED = 1.0  # m/s: closed fingers are driven at this speed, so that their motors give all their force.


class _Ended(Exception):
    """A phase ended the trial."""

    def __init__(self, status: TrialStatus, detail: str):
        super().__init__(detail)
        self.status, self.detail = status, detail


def run_trial(world: World, job: Job) -> TrialResult:
    """Execute one grasp in a freshly loaded world, in which nothing of earlier trials remains."""
    started = time.perf_counter()
    trial = _Trial(world, job)
    try:
        trial.run()
        status, detail = TrialStatus.HELD, f"held to the end, {trial.slip_text()}"
    except _Ended as end:
        status, detail = end.status, end.detail
    return TrialResult(
        grasp=job.grasp,
        trial=job.trial,
        status=status,
        phase=trial.phase,
        detail=detail,
        slip_mm=round(trial.slip * 1e3, 4),
        slip_degrees=round(trial.slip_degrees, 4),
        max_penetration_mm=round(trial.penetration * 1e3, 4),
        width_mm=round(world.width() * 1e3, 4),
        protocol=world.protocol.name,
        gripper=world.hand.name,
        engine=world.engine,
        friction=job.conditions.friction,
        mass=job.conditions.mass,
        force=job.conditions.force,
        seconds=time.perf_counter() - started,
        recording=trial.recording(),
    )


class _Trial:
    """State of a running trial."""

    def __init__(self, world: World, job: Job):
        self.world, self.job, self.protocol = world, job, world.protocol
        self.gripper = world.load(job.conditions)
        self.phase = "pre-check"
        self.slip = self.slip_degrees = self.penetration = 0.0
        self.steps = 0
        self.tcp_from_object: Float[np.ndarray, "4 4"] | None = None
        self._watch_every = max(1, round(WATCH / self.protocol.time_step))
        per_frame = job.frames_per_second * self.protocol.time_step
        self._record_every = max(1, round(1 / per_frame)) if per_frame > 0 else 0
        self._moments: list[tuple] = []

    def run(self):
        """All phases; raises `_Ended` in the one that fails."""
        self._stand()
        self._check_width()
        grasp = self.world.world_from_object() @ self.job.object_from_tcp
        self._check_grasp(grasp)
        self._approach(grasp)
        self._close(grasp)
        self._lift(grasp)
        if self.protocol.shake_acceleration > 0:
            self._shake()
        if self.protocol.turn_degrees > 0:
            self._turn()
        self.phase = "rest"
        self._stay(self.protocol.settle_time)
        self._both_pads()
        self._in_step()

    def _stand(self):
        """Let the object stand on the table by itself, before the gripper comes."""
        if self.protocol.support != "table":
            return
        self.phase = "settle"
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
            raise _Ended(TrialStatus.UNSTABLE, text)
        self.phase = "pre-check"

    def _check_width(self):
        width, widest = self.job.width, self.world.hand.opening[1]
        if width is not None and width + 2 * LEAST_ROOM > widest:
            text = f"the object is {width * 1e3:.0f} mm wide here; the gripper opens {widest * 1e3:.0f} mm"
            raise _Ended(TrialStatus.TOO_WIDE, text)
        least = self.world.hand.narrowest
        if width is not None and width < least - LEAST_ROOM:
            text = f"the object is {width * 1e3:.0f} mm wide here; the gripper closes to {least * 1e3:.0f} mm"
            raise _Ended(TrialStatus.NO_CONTACT, text)

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
            raise _Ended(TrialStatus.TOO_WIDE, text)
        text = f"{link} reaches {-distance * 1e3:.1f} mm into {obstacle}{self._hint(link)}"
        raise _Ended(TrialStatus.IN_COLLISION, text)

    def _hint(self, link: str) -> str:
        """What may be wrong where a link that is neither base nor finger is in the way."""
        hand = self.world.hand
        if link == hand.link_names[0] or any(link in body for body in hand.pad_bodies):
            return ""
        return f" (if {link} is only a safety margin, add ignore_links: [{link}] to the gripper's YAML)"

    def _approach(self, world_from_tcp: Float[np.ndarray, "4 4"]):
        """Approach along +z without physics; a collision on the way ends the trial with its own reason."""
        self.phase = "approach"
        step, back = self.protocol.approach_step, world_from_tcp.copy()
        left = self.job.approach_distance
        while left > 0:
            back[:3, 3] = world_from_tcp[:3, 3] - left * world_from_tcp[:3, 2]
            self.gripper.place(back, self.job.opening)
            distance, link, obstacle = self.world.nearest()
            self._record(moment=-left / 0.2)
            if distance < -self.protocol.clearance_tolerance:
                text = (
                    f"{left * 1e3:.0f} mm before the grasp, "
                    f"{link} reaches {-distance * 1e3:.1f} mm into {obstacle}"
                )
                raise _Ended(TrialStatus.BLOCKED_APPROACH, text)
            # An obstacle farther away than the step cannot be touched within the step.
            longest = 0.01 if self._record_every else np.inf
            left -= max(step, min(distance, longest))
        self.gripper.place(world_from_tcp, self.job.opening)

    def _close(self, world_from_tcp: Float[np.ndarray, "4 4"]):
        self.phase = "close"
        world, gripper, protocol = self.world, self.gripper, self.protocol
        force = self.job.conditions.force
        if protocol.support == "air":
            world.damp(protocol.air_damping)
        gripper.hold(world_from_tcp)
        self.target = world_from_tcp
        opening = gripper.opening()
        stroke_time = SPARE_TIME * opening / (2 * protocol.finger_speed)
        longest = max(protocol.close_time, stroke_time)
        for _ in range(round(longest / (self._watch_every * protocol.time_step))):
            gripper.drive_fingers(protocol.finger_speed, force, opening)
            self._step(self._watch_every)
            before, opening = opening, gripper.opening()
            if before - opening < STALLED:
                break
        gripper.drive_fingers(LIMIT_SPEED, force, opening)
        self._step(self._watch_every)
        self._both_pads(TrialStatus.NO_CONTACT)
        self._in_step()
        world.weigh(True)
        world.damp(0.0)
        self.tcp_from_object = invert(gripper.world_from_tcp()) @ world.world_from_object()

    def _lift(self, grasp: Float[np.ndarray, "4 4"]):
        self.phase = "lift"
        self._stay(self.protocol.settle_time)
        before = self._heights()
        heights = motion.lift_heights(self.protocol)
        places = np.tile(grasp[:3, 3], (len(heights), 1))
        places[:, 2] += heights
        self._follow(places, np.broadcast_to(grasp[:3, :3], (len(heights), 3, 3)))
        self._stay(self.protocol.settle_time)
        self._both_pads()
        hand, lifted = self._heights() - before
        if hand < self.protocol.lift_height - NOT_LIFTED:
            text = f"the hand rose by {hand * 1e3:.0f} of {self.protocol.lift_height * 1e3:.0f} mm"
            raise _Ended(TrialStatus.UNSTABLE, text)
        if lifted < self.protocol.lift_height - NOT_LIFTED - self.protocol.slip:
            raise _Ended(TrialStatus.SLIPPED_LIFT, f"the object rose by {lifted * 1e3:.0f} mm alone")

    def _heights(self) -> Float[np.ndarray, "2"]:
        """Heights of the TCP and of the object's centre of mass [m]."""
        placed = self.world.world_from_object()
        centre = placed[:3, :3] @ self.world.body.centre_of_mass + placed[:3, 3]
        return np.array([self.gripper.world_from_tcp()[2, 3], centre[2]])

    def _shake(self):
        self.phase = "shake"
        swing, start = motion.swing(self.protocol), self.target
        for axis in range(3):
            if not self.protocol.shake_jumps:
                start = self.target
            places = start[:3, 3] + swing[:, None] * start[:3, axis]
            self._follow(places, np.broadcast_to(start[:3, :3], (len(swing), 3, 3)))

    def _turn(self):
        self.phase = "turn"
        angles, start = motion.turns(self.protocol), self.target
        closing = Rotation.from_rotvec(angles[:, None] * np.array([1.0, 0, 0])).as_matrix()
        places = np.broadcast_to(start[:3, 3], (len(angles), 3))
        self._follow(places, start[:3, :3] @ closing)

    def _follow(self, places: Float[np.ndarray, "t 3"], rotations: Float[np.ndarray, "t 3 3"]):
        """Carry the TCP along a path, one place for each step."""
        orientations = Rotation.from_matrix(rotations).as_quat().tolist()
        for i, (place, orientation) in enumerate(zip(places.tolist(), orientations, strict=True)):
            self.gripper.carry(place, orientation)
            self._step(1)
            if (i + 1) % self._watch_every == 0:
                self._watch()
        self.target = np.eye(4)
        self.target[:3, :3], self.target[:3, 3] = rotations[-1], places[-1]
        self._watch()

    def _stay(self, seconds: float):
        for _ in range(max(1, round(seconds / (self._watch_every * self.protocol.time_step)))):
            self._step(self._watch_every)
            self._watch()

    def _step(self, count: int):
        for _ in range(count):
            self.world.step()
            self.steps += 1
            if self._record_every and self.steps % self._record_every == 0:
                self._record(moment=self.steps * self.protocol.time_step)

    def _watch(self):
        """End the trial when the object slips or the physics goes wrong."""
        world, gripper, protocol = self.world, self.gripper, self.protocol
        if world.object_speed() > RUNAWAY:
            raise _Ended(TrialStatus.UNSTABLE, f"the object flies off at {world.object_speed():.0f} m/s")
        self._penetrate(world.touching()[1])
        assert self.tcp_from_object is not None
        now = invert(gripper.world_from_tcp()) @ world.world_from_object()
        moved = now @ invert(self.tcp_from_object)
        centre = world.body.centre_of_mass
        before = self.tcp_from_object[:3, :3] @ centre + self.tcp_from_object[:3, 3]
        self.slip = float(np.linalg.norm(now[:3, :3] @ centre + now[:3, 3] - before))
        self.slip_degrees = float(np.degrees(rotation_angle(moved[:3, :3])))
        if not (self.slip < protocol.slip and self.slip_degrees < protocol.slip_degrees):
            raise _Ended(self._slipped(), self.slip_text())

    def _penetrate(self, depth: float):
        self.penetration = max(self.penetration, depth)
        if depth > self.protocol.penetration:
            text = f"gripper and object overlap by {depth * 1e3:.1f} mm"
            raise _Ended(TrialStatus.UNSTABLE, text)

    def _both_pads(self, otherwise: TrialStatus | None = None):
        links, _ = self.world.touching()
        pads = zip(("-x", "+x"), self.world.hand.pad_bodies, strict=True)
        missing = [side for side, pad in pads if not pad & links]
        if missing:
            text = f"the {' and the '.join(missing)} pad touches nothing"
            raise _Ended(otherwise or self._slipped(), text)

    def _in_step(self):
        error = self.gripper.coupling_error()
        if error > OUT_OF_STEP:
            text = f"joints that follow each other disagree by {error * 1e3:.1f} mm of the opening"
            raise _Ended(TrialStatus.OUT_OF_STEP, text)

    def _slipped(self) -> TrialStatus:
        return TrialStatus.SLIPPED_LIFT if self.phase == "lift" else TrialStatus.SLIPPED_SHAKE

    def slip_text(self) -> str:
        """How far the object moved in the gripper."""
        return f"the object moved {self.slip * 1e3:.1f} mm and {self.slip_degrees:.1f} degrees in the gripper"

    def _record(self, moment: float):
        if self._record_every:
            poses = self.world.world_from_object(), self.gripper.link_poses()
            self._moments.append((moment, self.phase, *poses))

    def recording(self) -> Recording | None:
        """The poses so far, or None where no recording was asked for."""
        if not self._record_every:
            return None
        if not self._moments:  # The trial ended before anything moved: show the start.
            self._record(moment=0.0)
        seconds, phases, objects, links = zip(*self._moments, strict=True)
        poses = {name: np.stack([pose[name] for pose in links]) for name in links[0]}
        return Recording(
            np.array(seconds) - seconds[0], phases, np.stack(objects), poses, self.world.table_height
        )
