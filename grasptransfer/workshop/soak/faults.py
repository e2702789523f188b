"""Commands killed at random moments, by SIGKILL and SIGTERM, themselves or one of their workers.

No process may be left, the same command must go on and end well, and what it leaves must equal what an
undisturbed run leaves.
"""

import contextlib
import json
import os
import signal
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from rich.table import Table

from grasptransfer.errors import SettingsError
from grasptransfer.jobs import Record
from grasptransfer.workshop.soak.fault_jobs import FaultJob, fault_jobs

RECORD = "faults.jsonl"
KILLS = tuple((name, victim) for victim in ("command", "worker") for name in ("SIGKILL", "SIGTERM"))
GONE = 30.0  # s after which a process counts as left behind; the kernel ends workers at once
LONGEST = 3600.0  # s of one run
GOOD = ("resumed", "ended first")


@dataclass(frozen=True)
class FaultSettings:
    """What is killed, and how often.

    Args:
        out: folder for the record; a run goes on from the record in it.
        kills: of each command.
        jobs: names of commands; none given: all.
        seed: of the moments.
    """

    out: Path
    kills: int = 30
    jobs: tuple[str, ...] = ()
    seed: int = 0

    def __post_init__(self):
        if self.kills < 1:
            raise SettingsError("must be at least 1", key="kills", value=self.kills)
        known = [job.name for job in fault_jobs()]
        for name in self.jobs:
            if name not in known:
                raise SettingsError("is no command that is killed", key="jobs", value=name, choices=known)

    def chosen(self) -> list[FaultJob]:
        """The commands that are killed."""
        return [job for job in fault_jobs() if not self.jobs or job.name in self.jobs]


def run_faults(
    settings: FaultSettings, *, progress: Callable[[str, int, int], None] = lambda name, done, total: None
) -> list[dict]:
    """Kill commands; the lines of the record.

    Args:
        progress: called with (command, kills done, in all).
    """
    with Record(settings.out / RECORD) as record:
        lines = record.lines()
        done = {(line["job"], line["number"]) for line in lines}
        for job in settings.chosen():
            missing = [number for number in range(settings.kills) if (job.name, number) not in done]
            if not missing:
                continue
            with tempfile.TemporaryDirectory() as name:
                whole = Undisturbed.of(job, Path(name))
            for number in missing:
                line = {"job": job.name, "number": number} | killed_once(job, whole, number, settings.seed)
                record.add(line)
                lines.append(line)
                progress(job.name, number + 1, settings.kills)
    return lines


@dataclass(frozen=True)
class Undisturbed:
    """A run that nothing killed: its result, exit code and seconds."""

    result: Any
    code: int
    seconds: float

    @staticmethod
    def of(job: FaultJob, folder: Path) -> "Undisturbed":
        """Run the command once.

        Raises:
            RuntimeError: it fails by itself.
        """
        job.make(folder)
        start = time.monotonic()
        ended = subprocess.run(job.command(folder), cwd=folder, capture_output=True, text=True)
        if ended.returncode not in (0, 1):
            raise RuntimeError(f"{job.name} fails undisturbed: {ended.stderr[-2000:]}")
        return Undisturbed(job.result(folder), ended.returncode, time.monotonic() - start)


def killed_once(job: FaultJob, whole: Undisturbed, number: int, seed: int) -> dict:
    """One kill, its end, the resumption and the comparison."""
    rng = np.random.default_rng([seed, number])
    signal_name, victim = KILLS[number % len(KILLS)]
    line = {"signal": signal_name, "victim": victim, "after": round(float(rng.uniform(0.03, 0.97)), 3)}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        job.make(folder)
        outcome, detail = _disturbed(job, folder, whole, line, rng)
        if outcome is None:
            outcome, detail = _resumed(job, folder, whole)
    return line | {"outcome": outcome, "detail": detail}


def faults_table(settings: FaultSettings, lines: Sequence[dict]) -> tuple[Table, int]:
    """What was tried and what became of it; and how many failed or lost something."""
    table = Table("command", *("killed", "workers", "ended first", "failed", "lost"), "failures")
    bad = 0
    for job in settings.chosen():
        of_job = [line for line in lines if line["job"] == job.name]
        outcomes = Counter(line["outcome"] for line in of_job)
        failures = {name: count for name, count in outcomes.items() if name not in (*GOOD, "lost")}
        bad += sum(failures.values()) + outcomes["lost"]
        workers = sum(line["victim"] == "worker" for line in of_job)
        numbers = (len(of_job), workers, outcomes["ended first"], sum(failures.values()), outcomes["lost"])
        words = ", ".join(f"{count} {name}" for name, count in failures.items())
        table.add_row(job.name, *(str(value) for value in numbers), words)
    return table, bad


def _disturbed(
    job: FaultJob, folder: Path, whole: Undisturbed, line: dict, rng: np.random.Generator
) -> tuple[str | None, str]:
    """Start, kill, wait for the end; an outcome where it failed, else None."""
    with open(folder / "said.txt", "w+") as said:
        process = subprocess.Popen(
            job.command(folder), cwd=folder, stdout=said, stderr=said, start_new_session=True
        )
        until = time.monotonic() + line["after"] * whole.seconds
        while time.monotonic() < until and process.poll() is None:
            time.sleep(0.01)
        workers = _workers(process.pid)
        while line["victim"] == "worker" and job.has_workers and not workers and process.poll() is None:
            time.sleep(0.05)  # They begin later, or have ended and others will begin.
            workers = _workers(process.pid)
        if line["victim"] == "worker" and workers:
            target = int(rng.choice(workers))
        else:  # it has none, or none began any more
            target, line["victim"] = process.pid, "command"
        ended_first = process.poll() is not None
        if not ended_first:
            _kill(target, line["signal"])
        try:
            code = process.wait(LONGEST)
        except subprocess.TimeoutExpired:
            _kill_session(process.pid)
            return "hang", f"did not end within {LONGEST:g} s"
        said.seek(0)
        text = said.read()
    left = _left_behind(process.pid)
    if left:
        return "process left", left
    if (line["victim"] == "worker" or ended_first) and code != whole.code:
        return "exit code", f"{code}: {text[-1000:]}"
    if "Traceback" in text:
        return "traceback", text[-1000:]
    return None, ""


def _resumed(job: FaultJob, folder: Path, whole: Undisturbed) -> tuple[str, str]:
    """The same command again: it must end as the undisturbed one, and leave the same."""
    ended = subprocess.run(job.command(folder), cwd=folder, capture_output=True, text=True)
    if ended.returncode != whole.code:
        exists = "exists already" in ended.stderr  # what a finished build says
        if not exists:
            return "not resumed", f"{ended.returncode}: {ended.stderr[-1000:]}"
    try:
        found = job.result(folder)
    except (OSError, ValueError, KeyError) as error:
        return "lost", repr(error)
    return ("resumed", "") if found == whole.result else ("lost", _difference(found, whole.result))


def _difference(found: Any, wanted: Any) -> str:
    if isinstance(found, dict) and isinstance(wanted, dict):
        names = sorted(key for key in found.keys() | wanted.keys() if found.get(key) != wanted.get(key))
        return f"differ: {names}"
    return json.dumps([str(found)[:200], str(wanted)[:200]])


def _session(leader: int) -> list[psutil.Process]:
    """All living processes of a session."""
    found = []
    for process in psutil.process_iter():
        try:
            if os.getsid(process.pid) == leader and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except (OSError, psutil.Error):
            continue
    return found


def _workers(leader: int) -> list[int]:
    return [one.pid for one in _session(leader) if one.pid != leader]


def _left_behind(leader: int) -> str:
    until = time.monotonic() + GONE
    while found := _session(leader):
        if time.monotonic() > until:
            text = "; ".join(" ".join(one.cmdline())[:100] for one in found if one.is_running())
            _kill_session(leader)
            return text
        time.sleep(0.1)
    return ""


def _kill_session(leader: int) -> None:
    for process in _session(leader):
        _kill(process.pid, "SIGKILL")


def _kill(number: int, name: str) -> None:
    with contextlib.suppress(ProcessLookupError):  # it may just have ended by itself
        os.kill(number, getattr(signal, name))
