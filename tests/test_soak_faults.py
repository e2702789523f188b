"""Killed commands: what is left behind, lost or not resumed is noticed; what resumes passes."""

import sys

import pytest

from grasptransfer.errors import SettingsError
from grasptransfer.workshop.soak import faults
from grasptransfer.workshop.soak.fault_jobs import FaultJob, fault_jobs
from grasptransfer.workshop.soak.faults import (
    FaultSettings,
    Undisturbed,
    faults_table,
    killed_once,
    run_faults,
)

# Each writes one line after the other, and goes on with those that are missing.
RESUMING = """
import time
from pathlib import Path
path = Path("out.txt")
done = path.read_text().splitlines() if path.exists() else []
for number in range(len(done), 10):
    with path.open("a") as file:
        file.write(f"{number}\\n")
    time.sleep(0.1)
"""
DOUBLING = RESUMING.replace("len(done)", "0")
LEAVING = """
import subprocess, sys
subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
"""
# Seconds of an undisturbed run: it ends by itself before any kill, whatever else the machine does.
NEVER = 1e9


def _job(code: str) -> FaultJob:
    return FaultJob(
        "small",
        lambda folder: None,
        lambda folder: [sys.executable, "-c", code],
        lambda folder: (folder / "out.txt").read_text() if (folder / "out.txt").exists() else "",
    )


def test_a_command_that_resumes_passes_whatever_kills_it(tmp_path):
    job = _job(RESUMING)
    whole = Undisturbed.of(job, tmp_path)
    found = [killed_once(job, whole, number, seed=0) for number in (0, 1)]
    assert [line["signal"] for line in found] == ["SIGKILL", "SIGTERM"]
    assert [line["outcome"] for line in found] == ["resumed", "resumed"]


def test_what_is_done_twice_counts_as_lost(tmp_path):
    job = _job(DOUBLING)
    whole = Undisturbed("".join(f"{number}\n" for number in range(10)), 0, NEVER)
    assert killed_once(job, whole, 0, seed=0)["outcome"] == "lost"


def test_a_process_that_is_left_behind_is_noticed_and_ended(monkeypatch):
    monkeypatch.setattr(faults, "GONE", 0.3)
    line = killed_once(_job(LEAVING), Undisturbed("", 0, NEVER), 0, seed=3)
    assert line["outcome"] == "process left"
    assert "time.sleep(600)" in line["detail"]


def test_a_run_goes_on_from_its_record(tmp_path, monkeypatch):
    monkeypatch.setattr(faults, "fault_jobs", lambda: (_job(RESUMING),))
    settings = FaultSettings(tmp_path, kills=1)
    lines = run_faults(settings)
    monkeypatch.setattr(faults, "killed_once", lambda *_: pytest.fail("was done before"))
    assert run_faults(settings) == lines
    _, bad = faults_table(settings, lines)
    assert bad == 0
    _, bad = faults_table(settings, [{**lines[0], "outcome": "lost"}, {**lines[0], "outcome": "hang"}])
    assert bad == 2
    with pytest.raises(SettingsError, match="small"):
        FaultSettings(tmp_path, jobs=("large",))


def test_a_save_of_the_annotator_that_is_killed_leaves_a_whole_file(tmp_path):
    (job,) = (job for job in fault_jobs() if job.name == "annotator, save")
    assert killed_once(job, Undisturbed.of(job, tmp_path), 0, seed=0)["outcome"] == "resumed"
