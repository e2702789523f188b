"""Steps of a build: in parallel over instances, and each result kept, so that a killed build resumes.

A result's file name holds the checksum of everything it depends on. Each task runs in a process of its
own with one thread, so that its bytes depend neither on the number of workers nor on where it was cut.
"""

import io
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grasptransfer.category.settings import software_versions
from grasptransfer.files import content_key, write_whole
from grasptransfer.jobs import Workers

Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class BuildProgress:
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
    """Runs steps and keeps their results in a folder; a context manager.

    Args:
        folder: for the results; created when needed.
        workers: processes.
        progress: called in this process.
    """

    def __init__(self, folder: Path, *, workers: int, progress: Callable[[BuildProgress], None]):
        self.folder, self.progress = folder, progress
        self._workers = Workers(workers, threads=1)
        self._versions = sorted(software_versions().items())

    def __enter__(self) -> "Workshop":
        self._workers.__enter__()
        return self

    def __exit__(self, *caught):
        self._workers.__exit__(*caught)

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
        self.progress(BuildProgress(step, done, len(arguments)))
        pieces = [(task, paths[name], arguments[name]) for name in missing]
        errors: dict[int, Exception] = {}
        for ended in self._workers.run(_keep, pieces):
            if ended.error is not None:
                errors[ended.index] = ended.error
                continue
            done += 1
            self.progress(BuildProgress(step, done, len(arguments), missing[ended.index]))
        if errors:
            raise errors[min(errors)]
        return {name: _load(path) for name, path in paths.items()}

    def _path(self, step: str, task, name: str, given: dict) -> Path:
        key = content_key(task.__module__, task.__qualname__, name, self._versions, given)
        return self.folder / f"{step.replace(' ', '_')}-{name}-{key[:16]}.npz"


def _keep(task: Callable[..., Arrays], path: Path, given: dict) -> None:
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **task(**given))
    write_whole(path, buffer.getvalue())


def _load(path: Path) -> Arrays:
    with np.load(path, allow_pickle=False) as data:
        return {name: data[name] for name in data.files}
