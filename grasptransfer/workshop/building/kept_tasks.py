"""Steps of a build: in parallel over instances, and each result kept, so that a killed build resumes.

A result's file name holds the checksum of everything it depends on. Each task runs in a process of its
own with one thread, so that its bytes depend neither on the number of workers nor on where it was cut.
"""

import contextlib
import dataclasses
import hashlib
import io
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from pathlib import Path
from threading import Thread

import numpy as np

from grasptransfer.category.settings import software_versions
from grasptransfer.files import write_whole

Arrays = dict[str, np.ndarray]
ONE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)


@dataclass(frozen=True)
class Progress:
    """Where a build is.

    Args:
        step: what is being done.
        done, total: instances.
        name: the instance that was finished last; empty at the start of a step.
    """

    step: str
    done: int
    total: int
    name: str = ""


class Workshop:
    """Runs steps and keeps their results in a folder; use as a context manager.

    Args:
        folder: for the results; created when needed.
        workers: processes.
        progress: called in this process.
    """

    def __init__(self, folder: Path, *, workers: int, progress: Callable[[Progress], None]):
        self.folder, self.workers, self.progress = folder, workers, progress
        self._pool: ProcessPoolExecutor | None = None
        self._versions = sorted(software_versions().items())

    def __enter__(self) -> "Workshop":
        return self

    def __exit__(self, *_):
        if self._pool:
            self._pool.shutdown(cancel_futures=True)

    def clear(self):
        """Remove the kept results."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def map(
        self, step: str, task: Callable[..., Arrays], arguments: Mapping[str, dict[str, object]]
    ) -> dict[str, Arrays]:
        """`task(**arguments[name])` of every name, in that order; what is known is not done again.

        Args:
            step: for people, and part of the file names.
            task: a function of a module; its arguments: arrays, numbers, strings, bytes, and tuples and
                dataclasses of them.

        Raises:
            Whatever the first failing task raises, in the order of the names.
        """
        paths = {name: self._path(step, task, name, given) for name, given in arguments.items()}
        missing = [name for name, path in paths.items() if not path.is_file()]
        done = len(arguments) - len(missing)
        self.progress(Progress(step, done, len(arguments)))
        futures = {self._submit(task, paths[name], arguments[name]): name for name in missing}
        for future in as_completed(futures):
            if future.exception() is None:
                done += 1
                self.progress(Progress(step, done, len(arguments), futures[future]))
        for future in futures:
            future.result()
        return {name: _load(path) for name, path in paths.items()}

    def _submit(self, task, path: Path, given: dict):
        if self._pool is None:
            with _one_thread():
                self._pool = ProcessPoolExecutor(
                    self.workers, mp_context=get_context("spawn"), initializer=_end_with_parent
                )
        with _one_thread():  # the pool starts its processes when work arrives
            return self._pool.submit(_run, task, path, given)

    def _path(self, step: str, task, name: str, given: dict) -> Path:
        digest = hashlib.sha256(f"{task.__module__}.{task.__qualname__} {name} {self._versions}".encode())
        for key in sorted(given):
            digest.update(key.encode())
            _feed(digest, given[key])
        return self.folder / f"{step.replace(' ', '_')}-{name}-{digest.hexdigest()[:16]}.npz"


def _run(task, path: Path, given: dict) -> None:
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **task(**given))
    write_whole(path, buffer.getvalue())


def _load(path: Path) -> Arrays:
    with np.load(path, allow_pickle=False) as data:
        return {name: data[name] for name in data.files}


def _feed(digest, value: object) -> None:
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, tuple | list):
        for one in value:
            _feed(digest, one)
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            digest.update(field.name.encode())
            _feed(digest, getattr(value, field.name))
    else:
        digest.update(repr(value).encode())


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Processes started inside count on one thread each: the libraries read this when they load."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _end_with_parent() -> None:
    """A worker whose parent was killed would wait for work for ever."""
    parent = parent_process()
    if parent is not None:
        Thread(target=_watch, args=(parent.sentinel,), daemon=True).start()


def _watch(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
