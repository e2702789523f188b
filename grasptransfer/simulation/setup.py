"""Everything the trials of one call share, and the warm world of a process."""

import threading
from dataclasses import dataclass
from functools import cached_property

from grasptransfer import __version__
from grasptransfer.files import content_key
from grasptransfer.simulation.body import Body
from grasptransfer.simulation.engines import engine_version, open_world
from grasptransfer.simulation.engines.seam import World
from grasptransfer.simulation.hand import Hand
from grasptransfer.simulation.job import Job
from grasptransfer.simulation.outcome import TrialResult
from grasptransfer.simulation.protocol import Protocol
from grasptransfer.simulation.trial import run_trial

_LOCK = threading.Lock()  # A process has one physics client, but a Dask worker may have several threads.
_WARM: dict[str, World] = {}


@dataclass(frozen=True)
class Setup:
    """Object, gripper, protocol and physics engine."""

    body: Body
    hand: Hand
    protocol: Protocol
    engine: str

    @cached_property
    def key(self) -> str:
        """A key that changes whenever the outcome of a trial could change."""
        versions = (__version__, self.engine, engine_version(self.engine))
        return content_key(versions, self.body, self.hand, self.protocol)


def job_key(setup: Setup, job: Job) -> str:
    """Return the key of one trial, made from everything that decides its outcome."""
    pose = [round(float(value), 12) + 0.0 for value in job.object_from_tcp.ravel()]
    numbers = (pose, job.width, job.opening, job.approach_distance, job.conditions)
    return content_key(setup.key, job.grasp, job.trial, numbers)[:24]


def execute(setup: Setup, job: Job) -> TrialResult:
    """Run one trial in this process; the world is kept for the next one."""
    with _LOCK:
        if setup.key not in _WARM:
            for world in _WARM.values():
                world.close()
            _WARM.clear()
            _WARM[setup.key] = open_world(setup.engine, setup.body, setup.hand, setup.protocol)
        return run_trial(_WARM[setup.key], job)
