"""Damaged files read in a process of their own, which is watched: its time, its memory, what it opens.

A reader of untrusted files may hang or take the whole memory inside a library, where no exception can stop
it. So each file is read in a child process. A child that does not answer in time, or dies, is counted and
replaced.
"""

import contextlib
import logging
import multiprocessing
import resource
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from grasptransfer.errors import GraspTransferError
from grasptransfer.workshop.soak.mutations import mutated
from grasptransfer.workshop.soak.samples import Format, formats

LONGEST = 10.0  # s of computing that one file may take
PATIENCE = 3.0  # times as long by the clock, as other processes may keep the cores busy
STARTING = 120.0  # s that a fresh process may take to load the package
MOST_MEMORY = 2_000_000_000  # bytes beyond what the process has once everything is loaded
FORBIDDEN = ("/etc/passwd", "/etc/hostname")  # what some mutations point to
GOOD = ("refused", "right")


@dataclass(frozen=True)
class Try:
    """What became of one damaged file.

    Args:
        outcome: "refused" (a `GraspTransferError`), "right" (read, and finite); or a failure: "traceback",
            "not finite", "hang", "crash", "memory", "outside" (a file elsewhere was opened).
        detail: the last line of a failure.
    """

    outcome: str
    detail: str = ""


class Watched:
    """A child process that reads damaged files of one format; use as a context manager."""

    def __init__(self, format_name: str):
        self.format_name = format_name
        self._process: Any = None
        self._pipe: Connection | None = None

    def __enter__(self) -> "Watched":
        return self

    def __exit__(self, *_):
        self._end()

    def attempt(self, seed: int) -> Try:
        """Read the file that is damaged by this seed."""
        if self._process is None:
            self._start()
        assert self._pipe is not None
        if not self._answers(seed):
            self._end()
            return Try("hang", f"no answer in {LONGEST:g} s")
        try:
            return self._pipe.recv()
        except EOFError:
            code = self._end()
            return Try("crash", f"the process ended with code {code}")

    def _answers(self, seed: int) -> bool:
        """Whether the child answers this seed within the time that a file may take."""
        assert self._pipe is not None
        child = psutil.Process(self._process.pid)
        allowed, until = _computed(child) + LONGEST, time.monotonic() + PATIENCE * LONGEST
        self._pipe.send(seed)
        while not self._pipe.poll(LONGEST / 10):  # The end of a child counts as an answer.
            if time.monotonic() > until or _computed(child) > allowed:
                return False
        return True

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_read_all, args=(self.format_name, theirs), daemon=True)
        self._process.start()
        theirs.close()
        if not self._pipe.poll(STARTING):
            raise RuntimeError(f"the process that reads {self.format_name} did not start")
        self._pipe.recv()

    def _end(self) -> int | None:
        """End the child, if it has not ended by itself; its exit code."""
        code, process = None, self._process
        if process is not None:
            process.join(0.5)  # A crashed child is given the time to leave its exit code.
            process.kill()
            process.join()
            code = process.exitcode
        if self._pipe is not None:
            self._pipe.close()
        self._process = self._pipe = None
        return code


def _computed(child: psutil.Process) -> float:
    """Seconds for which a process has had a core; endless once it is gone."""
    try:
        times = child.cpu_times()
    except psutil.NoSuchProcess:
        return float("inf")
    return times.user + times.system


def damaged_file(kind: Format, seed: int, folder: Path) -> Path:
    """A valid sample in `folder`, its file damaged; the path of that file."""
    kind.make(folder)
    path = folder / kind.file
    path.write_bytes(mutated(path.read_bytes(), seed, text=kind.text))
    return path


def _read_all(format_name: str, pipe: Connection) -> None:
    """The child: answers each seed with a `Try` until its parent is gone."""
    logging.disable(logging.CRITICAL)
    warnings.simplefilter("ignore")
    kind = next(one for one in formats() if one.name == format_name)
    opened = _watch_opened_files()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        kind.make(folder)
        path = folder / kind.file
        content = path.read_bytes()
        with contextlib.suppress(GraspTransferError):
            kind.read(path)  # Everything is loaded now: what is added later belongs to a damaged file.
        _limit_memory()
        pipe.send(None)
        for seed in _received(pipe):
            path.write_bytes(mutated(content, seed, text=kind.text))
            opened.clear()
            found = _attempt(kind, path)
            pipe.send(Try("outside", opened[0]) if opened else found)


def _received(pipe: Connection) -> Iterator[int]:
    with contextlib.suppress(EOFError):
        while True:
            yield pipe.recv()


def _attempt(kind: Format, path: Path) -> Try:
    try:
        result = kind.read(path)
    except GraspTransferError:
        return Try("refused")
    except MemoryError:
        return Try("memory", "".join(traceback.format_exc().splitlines()[-3:]))
    except Exception as error:  # Any foreign exception is a fault of the reader, which this run is to find.
        where = traceback.extract_tb(error.__traceback__)[-1]
        return Try("traceback", f"{type(error).__name__}: {error} ({where.filename}:{where.lineno})"[:400])
    return Try("right") if _finite(result) else Try("not finite")


def _finite(value: Any) -> bool:
    """Whether all numbers of a result are finite, as deep as its public fields go."""
    if isinstance(value, np.ndarray):
        return value.dtype.kind not in "fc" or bool(np.isfinite(value).all())
    if isinstance(value, float):
        return bool(np.isfinite(value))
    if isinstance(value, dict):
        return all(_finite(inner) for inner in value.values())
    if isinstance(value, list | tuple):
        return all(_finite(inner) for inner in value)
    if hasattr(value, "vertices"):
        return _finite(np.asarray(value.vertices))
    fields = getattr(value, "__dataclass_fields__", {})
    return all(_finite(getattr(value, name)) for name in fields if not name.startswith("_"))


def _watch_opened_files() -> list[str]:
    """A list to which every forbidden path that this process opens is added."""
    opened: list[str] = []

    def watch(event: str, arguments: tuple) -> None:
        if event == "open" and str(arguments[0]) in FORBIDDEN:
            opened.append(f"opened {arguments[0]}")
        if event in ("os.system", "subprocess.Popen"):
            opened.append(f"ran {arguments[0]}")

    sys.addaudithook(watch)
    return opened


def _limit_memory() -> None:
    import psutil

    most = psutil.Process().memory_info().vms + MOST_MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
