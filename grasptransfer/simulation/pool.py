"""Trials on several processes; one that crashes or hangs loses only its trial and is replaced."""

import os
import socket
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection, wait

from grasptransfer.simulation.job import Job
from grasptransfer.simulation.outcome import TrialResult, TrialStatus
from grasptransfer.simulation.setup import Setup

START_TIME = 60.0  # s for a process to import and answer its first trial, on a busy machine


class _Worker:
    """One process and the job it is at."""

    def __init__(self, setup: Setup):
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "grasptransfer.simulation.worker", str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(part for part in sys.path if part)},
            )
        self.connection = Connection(ours.detach())
        self.job: tuple[int, Job] | None = None
        self.deadline = 0.0
        self._fresh = True
        self._send(setup)

    def give(self, index: int, job: Job, limit: float):
        self.job = (index, job)
        self.deadline = time.monotonic() + limit + (START_TIME if self._fresh else 0.0)
        self._fresh = False
        self._send(job)

    def _send(self, message: object):
        try:
            self.connection.send(message)
        except (BrokenPipeError, ConnectionResetError):
            return  # it has died; the next read says so

    def end(self, *, now: bool) -> int:
        """Stop the process; its exit code."""
        if now:
            self._process.kill()
        else:
            self._send(None)
        self.connection.close()
        try:
            return self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()


def run_in_processes(
    setup: Setup, jobs: Sequence[Job], workers: int, *, limit: float
) -> Iterator[tuple[int, TrialResult]]:
    """Index and result of each job, as they end.

    Args:
        workers: number of processes.
        limit: most seconds for one trial.
    """
    waiting = deque(enumerate(jobs))
    busy: list[_Worker] = []
    try:
        while waiting or busy:
            while waiting and len(busy) < workers:
                busy.append(_Worker(setup))
                busy[-1].give(*waiting.popleft(), limit)
            ready = wait([worker.connection for worker in busy], timeout=1.0)
            for worker in list(busy):
                if worker.connection in ready:
                    answered = _answer(worker)
                elif time.monotonic() > worker.deadline:
                    answered = _lost(worker, f"did not end within {limit:g} s")
                else:
                    continue
                assert worker.job is not None
                index = worker.job[0]
                crashed = answered.status is TrialStatus.CRASHED
                if not crashed and waiting:
                    worker.give(*waiting.popleft(), limit)
                else:
                    busy.remove(worker)
                    if not crashed:
                        worker.end(now=False)
                yield index, answered
    finally:
        for worker in busy:
            worker.end(now=True)


def _answer(worker: _Worker) -> TrialResult:
    try:
        return worker.connection.recv()
    except (EOFError, ConnectionResetError):
        return _lost(worker, "ended by itself")


def _lost(worker: _Worker, what: str) -> TrialResult:
    assert worker.job is not None
    job = worker.job[1]
    code = worker.end(now=True)
    detail = f"the process of this trial {what} (exit code {code})"
    return crashed_trial(job, detail)


def crashed_trial(job: Job, detail: str) -> TrialResult:
    """The result of a trial that nobody could finish."""
    return TrialResult(
        job.grasp, job.trial, TrialStatus.CRASHED, "", detail, friction=job.conditions.friction
    )
