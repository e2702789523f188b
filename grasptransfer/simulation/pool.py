"""Trials in this process, in several, or on a cluster; one that crashes or hangs loses only its trial."""

from collections.abc import Iterator, Sequence

from grasptransfer.jobs import LostError, run, run_on_cluster
from grasptransfer.simulation.job import Job
from grasptransfer.simulation.outcome import TrialResult, TrialStatus
from grasptransfer.simulation.setup import Setup, execute


def run_trials(
    setup: Setup, jobs: Sequence[Job], *, workers: int, cluster: str | None, limit: float
) -> Iterator[tuple[int, TrialResult]]:
    """Yield index and result of each trial as it ends.

    Args:
        setup: object, gripper, protocol and engine of all trials.
        jobs: the trials.
        workers: number of processes; one means this process.
        cluster: address of a Dask scheduler, instead of `workers`.
        limit: most seconds for one trial in another process.
    """
    pieces = [(job,) for job in jobs]
    if not pieces:
        return
    if cluster is not None:
        ended = run_on_cluster(execute, pieces, cluster, shared=(setup,))
    else:
        others = workers if workers > 1 else 0
        ended = run(execute, pieces, workers=others, shared=(setup,), limit=limit, attempts=1)
    for one in ended:
        if isinstance(one.error, LostError):
            yield one.index, crashed_trial(jobs[one.index], str(one.error))
        else:
            yield one.index, one.result()


def crashed_trial(job: Job, detail: str) -> TrialResult:
    """The result of a trial that no process could finish."""
    friction = job.conditions.friction
    return TrialResult(job.grasp, job.trial, TrialStatus.CRASHED, "", detail, friction=friction)
