"""The hand and the object of a running trial, watched while they move; what goes wrong ends the trial."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.frames import invert, rotation_angle
from grasptransfer.simulation.engines.seam import World
from grasptransfer.simulation.job import Job
from grasptransfer.simulation.outcome import Recording, TrialStatus

WATCH = 0.05  # s between two checks of contacts and slip.
RUNAWAY = 5.0  # m/s: no motion of a protocol is that fast.
OUT_OF_STEP = 0.003  # m: coupled joints may disagree about the opening by this much.


class TrialEnded(Exception):
    """Something ended the trial: the status that says what, and a sentence about it."""

    def __init__(self, status: TrialStatus, detail: str):
        super().__init__(detail)
        self.status, self.detail = status, detail


class WatchedMotion:
    """Moves the hand step by step, and keeps what is measured and recorded on the way.

    Args:
        world: a world in which nothing of earlier trials remains.
        job: the grasp to execute and its conditions.

    Attributes:
        phase: phase of the trial.
        slip, slip_degrees: motion of the object in the gripper since the fingers closed [m, degrees].
        penetration: deepest overlap of gripper and object so far [m].
        limit_used: largest share so far of what the protocol allows of slip, turn and overlap.
        target: `world_from_tcp` where the hand was last sent.
        tcp_from_object: the object in the gripper when the fingers had closed; None before.
        watch_every: steps between two checks.
        records: whether the poses are recorded.
    """

    def __init__(self, world: World, job: Job):
        self.world, self.job, self.protocol = world, job, world.protocol
        self.gripper = world.load(job.conditions)
        self.phase = "pre-check"
        self.slip = self.slip_degrees = self.penetration = 0.0
        self.limit_used = 0.0
        self.target = np.eye(4)
        self.tcp_from_object: Float[np.ndarray, "4 4"] | None = None
        self.watch_every = max(1, round(WATCH / self.protocol.time_step))
        per_frame = job.frames_per_second * self.protocol.time_step
        self.records = per_frame > 0
        self._record_every = max(1, round(1 / per_frame)) if self.records else 0
        self._steps = 0
        self._moments: list[tuple] = []

    def follow(self, places: Float[np.ndarray, "t 3"], rotations: Float[np.ndarray, "t 3 3"]):
        """Carry the TCP along a path, one place for each step."""
        orientations = Rotation.from_matrix(rotations).as_quat().tolist()
        for i, (place, orientation) in enumerate(zip(places.tolist(), orientations, strict=True)):
            self.gripper.carry(place, orientation)
            self.step(1)
            if (i + 1) % self.watch_every == 0:
                self.watch()
        self.target = np.eye(4)
        self.target[:3, :3], self.target[:3, 3] = rotations[-1], places[-1]
        self.watch()

    def stay(self, seconds: float):
        """Hold the hand still."""
        for _ in range(max(1, round(seconds / (self.watch_every * self.protocol.time_step)))):
            self.step(self.watch_every)
            self.watch()

    def step(self, count: int):
        """Let the physics take so many steps."""
        for _ in range(count):
            self.world.step()
            self._steps += 1
            if self.records and self._steps % self._record_every == 0:
                self.record(moment=self._steps * self.protocol.time_step)

    def watch(self):
        """End the trial when the object slips or the physics goes wrong."""
        world, gripper, protocol = self.world, self.gripper, self.protocol
        if world.object_speed() > RUNAWAY:
            raise TrialEnded(TrialStatus.UNSTABLE, f"the object flies off at {world.object_speed():.0f} m/s")
        self._penetrate(world.touching()[1])
        assert self.tcp_from_object is not None
        now = invert(gripper.world_from_tcp()) @ world.world_from_object()
        moved = now @ invert(self.tcp_from_object)
        centre = world.body.centre_of_mass
        before = self.tcp_from_object[:3, :3] @ centre + self.tcp_from_object[:3, 3]
        self.slip = float(np.linalg.norm(now[:3, :3] @ centre + now[:3, 3] - before))
        self.slip_degrees = float(np.degrees(rotation_angle(moved[:3, :3])))
        shares = self.slip / protocol.slip, self.slip_degrees / protocol.slip_degrees
        self.limit_used = max(self.limit_used, *shares, self.penetration / protocol.penetration)
        if not (self.slip < protocol.slip and self.slip_degrees < protocol.slip_degrees):
            raise TrialEnded(self._slipped(), self.slip_text())

    def _penetrate(self, depth: float):
        self.penetration = max(self.penetration, depth)
        if depth > self.protocol.penetration:
            text = f"gripper and object overlap by {depth * 1e3:.1f} mm"
            raise TrialEnded(TrialStatus.UNSTABLE, text)

    def both_pads(self, otherwise: TrialStatus | None = None):
        """End the trial where a pad does not touch the object, as slipped or with another status."""
        links, _ = self.world.touching()
        pads = zip(("-x", "+x"), self.world.hand.pad_bodies, strict=True)
        missing = [side for side, pad in pads if not pad & links]
        if missing:
            text = f"the {' and the '.join(missing)} pad touches nothing"
            raise TrialEnded(otherwise or self._slipped(), text)

    def in_step(self):
        """End the trial where joints that follow each other have come apart."""
        error = self.gripper.coupling_error()
        if error > OUT_OF_STEP:
            text = f"joints that follow each other disagree by {error * 1e3:.1f} mm of the opening"
            raise TrialEnded(TrialStatus.OUT_OF_STEP, text)

    def _slipped(self) -> TrialStatus:
        return TrialStatus.SLIPPED_LIFT if self.phase == "lift" else TrialStatus.SLIPPED_SHAKE

    def slip_text(self) -> str:
        """How far the object moved in the gripper."""
        return f"the object moved {self.slip * 1e3:.1f} mm and {self.slip_degrees:.1f} degrees in the gripper"

    def record(self, moment: float):
        """Add the poses of object and links at a moment [s] to the recording, where one is made."""
        if self.records:
            poses = self.world.world_from_object(), self.gripper.link_poses()
            self._moments.append((moment, self.phase, *poses))

    def recording(self) -> Recording | None:
        """The poses so far, or None where no recording was asked for."""
        if not self.records:
            return None
        if not self._moments:  # The trial ended before anything moved: show the start.
            self.record(moment=0.0)
        seconds, phases, objects, links = zip(*self._moments, strict=True)
        poses = {name: np.stack([pose[name] for pose in links]) for name in links[0]}
        return Recording(
            np.array(seconds) - seconds[0], phases, np.stack(objects), poses, self.world.table_height
        )
