"""Files for PyBullet, which reads shapes from files only, in folders that no killed process leaves behind.

A process keeps a lock on its folder for as long as it lives: the system releases the lock however the process
ends. A process that makes a folder, or has lost a worker, removes all folders that nobody has locked.
"""

import contextlib
import fcntl
import shutil
import tempfile
import weakref
from pathlib import Path
from typing import BinaryIO

PREFIX, LOCK = "grasptransfer-world-", "owner"


class OwnedFolder:
    """A temporary folder of this process; `close`, or the process's end, removes it."""

    def __init__(self):
        remove_orphans()
        while True:
            self.path = Path(tempfile.mkdtemp(prefix=PREFIX))
            lock = open(self.path / LOCK, "wb")  # noqa: SIM115  (held as long as the folder)
            fcntl.flock(lock, fcntl.LOCK_EX)
            if (self.path / LOCK).exists():  # Otherwise it was removed as an orphan before it was locked.
                break
            lock.close()
        self._remove = weakref.finalize(self, _remove, self.path, lock)

    def close(self) -> None:
        """Remove the folder."""
        self._remove()


def _remove(path: Path, lock: BinaryIO) -> None:
    shutil.rmtree(path, ignore_errors=True)
    lock.close()


def remove_orphans() -> None:
    """Remove the folders whose process has gone."""
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        # The folder is another user's, or is just being removed.
        with contextlib.suppress(OSError), open(folder / LOCK, "rb") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)
