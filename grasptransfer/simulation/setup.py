"""Everything the trials of one call share, and the warm world of a process."""

import hashlib
import threading
from dataclasses import dataclass

from grasptransfer.simulation.body import Body
from grasptransfer.simulation.hand import Hand
from grasptransfer.simulation.outcome import TrialResult
from grasptransfer.simulation.protocol import Protocol
from grasptransfer.simulation.trial import Job, run_trial
from grasptransfer.simulation.world import World

_LOCK = threading.Lock()  # a process has one physics client; a Dask worker may have several threads
_WARM: dict[str, World] = {}


@dataclass(frozen=True)
class Setup:
    """Object, gripper and protocol."""

    body: Body
    hand: Hand
    protocol: Protocol

    def digest(self) -> str:
        """Changes whenever a trial could."""
        text = repr((self.body.digest, self.hand.digest, self.protocol.as_data()))
        return hashlib.sha256(text.encode()).hexdigest()


def job_key(setup: Setup, job: Job) -> str:
    """Names one trial by all that decides its outcome."""
    pose = [round(float(value), 12) + 0.0 for value in job.object_from_tcp.ravel()]
    numbers = (pose, job.width, job.opening, job.approach_distance, job.friction)
    text = repr((setup.digest(), job.grasp, job.trial, numbers))
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def execute(setup: Setup, job: Job) -> TrialResult:
    """Run one trial in this process; the world is kept for the next one."""
    digest = setup.digest()
    with _LOCK:
        if digest not in _WARM:
            for world in _WARM.values():
                world.close()
            _WARM.clear()
            _WARM[digest] = World(setup.body, setup.hand, setup.protocol)
        return run_trial(_WARM[digest], job)
