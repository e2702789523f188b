"""Pieces of work in processes of their own.

Each worker has a connection of its own and at most one piece: a process that is killed, crashes or hangs
takes nothing of the others with it. That is why no pool of a library stands here: in those of the standard
library and of loky one death breaks the pool, and workers that share a queue, as Pebble's do, may take its
lock with them.
"""

import contextlib
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

from grasptransfer.errors import GraspTransferError
from grasptransfer.jobs.threads import cores, limited
from grasptransfer.jobs.worker import BEGUN, ERROR

START_TIME = 120.0  # s: on a busy machine a process takes this long to import its packages.
ATTEMPTS = 3
# The package has imported the worker's module before `-m` runs it; that is meant, and no reason to warn.
QUIET = ("-W", "ignore::RuntimeWarning:runpy")


class LostError(GraspTransferError):
    """A piece of work that no process could finish: each one crashed, was killed or hung."""


@dataclass(frozen=True)
class Ended:
    """A piece that has ended.

    Args:
        index: number of the piece.
        value: what the function returned.
        error: the exception that the function raised, or `LostError`; None if the function returned.
    """

    index: int
    value: Any = None
    error: Exception | None = None

    def result(self) -> Any:
        """Return the value, or raise the error if there is one."""
        if self.error is not None:
            raise self.error
        return self.value


class Workers:
    """A context manager of processes that compute pieces of work, and that end with the block.

    Ctrl-C and SIGTERM end the processes, too. They start when there is work.

    Args:
        count: number of processes; 0 computes in the calling process, where errors are raised at once.
        shared: first arguments of every function, sent to each process once.
        threads: threads of each process; None shares the cores of the calling process among them.
    """

    def __init__(self, count: int, *, shared: tuple = (), threads: int | None = None):
        self.count, self.shared = count, shared
        self.threads = threads or max(1, cores() // max(count, 1))
        self._workers: list[_Worker] = []
        self._sigterm = _ending_on_sigterm()

    def __enter__(self) -> "Workers":
        self._sigterm.__enter__()
        return self

    def __exit__(self, *caught):
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.end()
        self._workers.clear()
        self._sigterm.__exit__(*caught)

    def run(
        self,
        task: Callable,
        pieces: Sequence[tuple],
        *,
        limit: float | None = None,
        attempts: int = ATTEMPTS,
    ) -> Iterator[Ended]:
        """Yield `task(*shared, *piece)` for every piece, as soon as it has ended.

        Args:
            task: a function of a module, so that other processes can import it.
            pieces: arguments of each piece.
            limit: most seconds for one piece; None sets no limit.
            attempts: how often a piece is tried whose process crashes, is killed or hangs.
        """
        if self.count == 0:
            for index, piece in enumerate(pieces):
                yield Ended(index, task(*self.shared, *piece))
            return
        waiting = deque(range(len(pieces)))
        begun = [0] * len(pieces)
        while waiting or any(worker.index is not None for worker in self._workers):
            for worker in self._idle(len(waiting)):
                index = waiting.popleft()
                begun[index] += 1
                worker.give(index, pickle.dumps((task, pieces[index])), limit)
            for worker in self._answering():
                ended = worker.answer()
                if worker.gone:
                    self._workers.remove(worker)
                if ended is None:
                    continue
                if worker.gone and begun[ended.index] < attempts:
                    waiting.appendleft(ended.index)
                else:
                    yield ended

    def _idle(self, wanted: int) -> list["_Worker"]:
        """At most `wanted` workers without a piece; missing ones start together, to load at the same time."""
        idle = [worker for worker in self._workers if worker.index is None]
        missing = min(self.count - len(self._workers), wanted - len(idle))
        if missing > 0:
            packed = pickle.dumps(self.shared)
            started = [_Worker(self.threads, packed) for _ in range(missing)]
            self._workers += started
            idle += started
        return idle[:wanted]

    def _answering(self) -> list["_Worker"]:
        """Workers that have sent a message, have ended, or have used up their time."""
        busy = [worker for worker in self._workers if worker.index is not None]
        ready = wait([worker.connection for worker in busy], timeout=1.0)
        now = time.monotonic()
        return [worker for worker in busy if worker.connection in ready or now > worker.deadline]


def run(
    task: Callable,
    pieces: Sequence[tuple],
    *,
    workers: int,
    shared: tuple = (),
    threads: int | None = None,
    limit: float | None = None,
    attempts: int = ATTEMPTS,
) -> Iterator[Ended]:
    """Yield `task(*shared, *piece)` for every piece, from processes that end with the last piece.

    A caller who leaves the loop early ends the processes.

    Args:
        task, pieces, limit, attempts: as for `Workers.run`.
        workers: number of processes, as `count` of `Workers`.
        shared, threads: as for `Workers`.
    """
    with Workers(min(workers, len(pieces)), shared=shared, threads=threads) as team:
        yield from team.run(task, pieces, limit=limit, attempts=attempts)


def run_fresh(task: Callable, *arguments: object, threads: int | None = None) -> Any:
    """`task(*arguments)` in one fresh process, in which nothing is loaded yet.

    Raises:
        LostError: the process ended before it had an answer.
        Exception: whatever the task raises.
    """
    (ended,) = run(task, [arguments], workers=1, threads=threads, attempts=1)
    return ended.result()


class _Worker:
    """One process and the piece that it computes."""

    def __init__(self, threads: int, shared: bytes):
        ours, theirs = socket.socketpair()
        path = os.pathsep.join(part for part in sys.path if part)
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, *QUIET, "-m", "grasptransfer.jobs.worker", str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.PIPE,  # Nothing is written to it: it closes when this process ends.
                stdout=subprocess.DEVNULL,
                env=os.environ | limited(threads) | {"PYTHONPATH": path},
            )
        self.connection = Connection(ours.detach())
        self.index: int | None = None  # The number of the piece at work.
        self.limit: float | None = None
        self.deadline = 0.0
        self.gone = False
        self._shared: bytes | None = shared

    def give(self, index: int, message: bytes, limit: float | None) -> None:
        """Send the process a piece; its first piece comes after the shared arguments."""
        self.index, self.limit = index, limit
        time_to_begin = START_TIME if self._shared is not None else limit or float("inf")
        # A process that has ended is noticed by the next read.
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            if self._shared is not None:
                self.connection.send_bytes(self._shared)
                self._shared = None
            self.connection.send_bytes(message)
        self.deadline = time.monotonic() + time_to_begin

    def answer(self) -> Ended | None:
        """The ended piece; None if the process has only said that it begins the piece."""
        assert self.index is not None
        index = self.index
        if not self.connection.poll():
            return self._lost(index, f"did not end within {self.limit or START_TIME:g} s")
        try:
            kind, content, trace = self.connection.recv()
        except (EOFError, ConnectionResetError):
            return self._lost(index, "ended by itself")
        if kind == BEGUN:
            self.deadline = time.monotonic() + (self.limit or float("inf"))
            return None
        self.index = None
        if kind == ERROR:
            content.__cause__ = _InWorker(trace)
            return Ended(index, error=content)
        return Ended(index, content)

    def _lost(self, index: int, what: str) -> Ended:
        self.index, self.gone = None, True
        self.process.kill()
        code = self.end()
        return Ended(index, error=LostError(f"the process of this piece {what} (exit code {code})"))

    def end(self) -> int:
        """Close the connections to a process that was killed, and return its exit code."""
        self.connection.close()
        assert self.process.stdin is not None
        self.process.stdin.close()
        return self.process.wait()


class _InWorker(Exception):
    """The traceback of an error in the other process."""

    def __str__(self) -> str:
        return "\n" + self.args[0]


@contextlib.contextmanager
def _ending_on_sigterm() -> Iterator[None]:
    """Let SIGTERM end this process within the block as Ctrl-C does, so that `finally` clauses run."""
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield  # The caller's own handler, or the main thread's, stays in charge.
        return

    def end(number, _):
        sys.exit(128 + number)  # Shells report a process that a signal ended so.

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
