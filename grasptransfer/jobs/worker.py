"""A worker process: `python -m grasptransfer.jobs.worker FILE_DESCRIPTOR`.

A process of its own, and no fork: the physics engine may crash, and the caller may hold threads and GPU
contexts that do not survive a fork. Nor does the caller's script run again, as with `spawn`.
"""

import fcntl
import os
import pickle
import select
import signal
import sys
import traceback
from functools import cache
from multiprocessing.connection import Connection

BEGUN, VALUE, ERROR = "begun", "value", "error"  # what a worker says


def serve(connection: Connection) -> None:
    """Receive the shared arguments, then functions with their own; say when each begins and how it ended."""
    packed = connection.recv_bytes()
    while True:
        message = connection.recv_bytes()
        try:
            shared = _unpacked(packed)
            task, piece = pickle.loads(message)  # imports what is needed
            connection.send((BEGUN, None, ""))
            answer = _packed(VALUE, task(*shared, *piece))
        except Exception as error:
            answer = _packed(ERROR, error)
        connection.send_bytes(answer)


@cache
def _unpacked(message: bytes) -> tuple:
    return pickle.loads(message)


def _packed(kind: str, content: object) -> bytes:
    """An answer; an error travels with its traceback, and one that cannot travel as text."""
    trace = traceback.format_exc() if kind == ERROR else ""
    try:
        message = pickle.dumps((kind, content, trace))
        pickle.loads(message)  # an error may be written and yet not be read
    except Exception as error:
        trace = trace or "".join(traceback.format_exception(error))
        return pickle.dumps((ERROR, RuntimeError(f"{kind} of a worker cannot be sent: {error!r}"), trace))
    return message


def end_with_parent() -> None:
    """Let the kernel end this process as soon as its parent is gone, whatever either is doing then.

    Standard input is a pipe of which only the parent holds the other end, and into which it never writes.
    When that end closes, the kernel sends SIGIO, whose default action is to end the process: no Python needs
    to run for it, as in the middle of a long call of a physics engine.
    """
    fcntl.fcntl(0, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(0, fcntl.F_SETFL, fcntl.fcntl(0, fcntl.F_GETFL) | os.O_ASYNC)
    if select.select([0], [], [], 0)[0]:
        os._exit(1)  # it went before the kernel watched it


if __name__ == "__main__":
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the parent ends this one
    try:
        serve(Connection(int(sys.argv[1])))
    except (EOFError, ConnectionResetError, BrokenPipeError):
        sys.exit(0)  # the parent is ending
