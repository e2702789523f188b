"""A worker process: `python -m grasptransfer.jobs.worker FILE_DESCRIPTOR`.

A worker is a fresh process, because the physics engine may crash, and because the caller may hold threads and
GPU contexts that do not survive a fork. Unlike `spawn`, a worker does not run the caller's script again.
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

BEGUN, VALUE, ERROR = "begun", "value", "error"  # The kinds of message that a worker sends.


def serve(connection: Connection) -> None:
    """Receive the shared arguments, then functions with theirs; report beginning and end of each call."""
    packed = connection.recv_bytes()
    while True:
        message = connection.recv_bytes()
        try:
            shared = _unpacked(packed)
            task, piece = pickle.loads(message)  # This imports the task's module.
            connection.send((BEGUN, None, ""))
            answer = _packed(VALUE, task(*shared, *piece))
        except Exception as error:
            answer = _packed(ERROR, error)
        connection.send_bytes(answer)


@cache
def _unpacked(message: bytes) -> tuple:
    return pickle.loads(message)


def _packed(kind: str, content: object) -> bytes:
    """Pickle an answer; an error comes with its traceback, and becomes text if it cannot be pickled."""
    trace = traceback.format_exc() if kind == ERROR else ""
    try:
        message = pickle.dumps((kind, content, trace))
        pickle.loads(message)  # Some errors can be pickled but not read again.
    except Exception as error:
        trace = trace or "".join(traceback.format_exception(error))
        return pickle.dumps((ERROR, RuntimeError(f"{kind} of a worker cannot be sent: {error!r}"), trace))
    return message


def end_with_parent() -> None:
    """Let the kernel end this process as soon as its parent is gone, whatever this process is doing.

    Standard input is a pipe of which only the parent holds the other end, and into which it never writes.
    When that end closes, the kernel sends SIGIO, whose default action is to end the process: no Python needs
    to run for it, as in the middle of a long call of a physics engine.
    """
    fcntl.fcntl(0, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(0, fcntl.F_SETFL, fcntl.fcntl(0, fcntl.F_GETFL) | os.O_ASYNC)
    if select.select([0], [], [], 0)[0]:
        os._exit(1)  # The parent had ended before the kernel watched for it.


if __name__ == "__main__":
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is sent to all processes; the parent ends this one.
    try:
        serve(Connection(int(sys.argv[1])))
    except (EOFError, ConnectionResetError, BrokenPipeError):
        sys.exit(0)  # The parent is ending.
