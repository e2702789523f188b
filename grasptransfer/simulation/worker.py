"""A worker process: `python -m grasptransfer.simulation.worker FILE_DESCRIPTOR`.

A process of its own, and no fork: the physics engine may crash, and the caller may hold threads and
GPU contexts that do not survive a fork. Nor does the caller's script run again, as with `spawn`.
"""

import sys
from multiprocessing.connection import Connection


def serve(connection: Connection) -> None:
    """Receive a setup, then jobs; answer each with its result, until None."""
    from grasptransfer.simulation.setup import execute

    setup = connection.recv()
    while (job := connection.recv()) is not None:
        connection.send(execute(setup, job))


if __name__ == "__main__":
    try:
        serve(Connection(int(sys.argv[1])))
    except (EOFError, ConnectionResetError, BrokenPipeError, KeyboardInterrupt):
        sys.exit(0)  # the caller has gone
