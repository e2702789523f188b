"""Damaged files: every failure of a reader is noticed, and a run goes on where it stopped."""

import json
import os
import time
from pathlib import Path

import numpy as np
import pytest

from grasptransfer.errors import GraspTransferError, SettingsError
from grasptransfer.workshop.soak import run, watch
from grasptransfer.workshop.soak.mutations import mutated
from grasptransfer.workshop.soak.samples import Format, formats
from grasptransfer.workshop.soak.watch import Watched

BAD = ("traceback", "not finite", "hang", "crash", "outside")


def _behave(path: Path):
    """A reader that does what its file's length says: everything that must be noticed, and what is right."""
    kinds = ("refused", "right", "traceback", "not finite", "hang", "crash", "outside")
    kind = kinds[len(path.read_bytes()) % len(kinds)]
    if kind == "refused":
        raise GraspTransferError("is damaged")
    if kind == "traceback":
        raise RuntimeError("inside")
    if kind == "hang":
        time.sleep(60)
    if kind == "crash":
        os._exit(3)
    if kind == "outside":
        open("/etc/hostname").close()
    return np.array([np.nan if kind == "not finite" else 1.0])


BEHAVING = Format("behaving", "a.txt", lambda folder: (folder / "a.txt").write_text("1"), _behave)


def _only_behaving():
    return (BEHAVING,)


@pytest.fixture
def behaving(monkeypatch):
    monkeypatch.setattr(run, "formats", _only_behaving)
    monkeypatch.setattr(watch, "formats", _only_behaving)
    monkeypatch.setattr(watch, "LONGEST", 0.3)
    # A forked child sees these replacements; a spawned one would load the true list of formats.
    context = watch.multiprocessing.get_context("fork")
    monkeypatch.setattr(watch.multiprocessing, "get_context", lambda kind: context)


def test_every_kind_of_failure_is_noticed(behaving, tmp_path):
    settings = run.SoakSettings(tmp_path, files=60)
    entries = run.run_soak(settings)
    found = {name for entry in entries for name in entry["outcomes"]}
    assert found == {"refused", "right", *BAD}
    table, bad = run.soak_table(settings, entries)
    assert bad == sum(count for entry in entries for name, count in entry["outcomes"].items() if name in BAD)
    assert list(table.columns[1].cells) == ["60"]
    kept = list((tmp_path / "failures").iterdir())
    assert len(kept) == bad


def test_a_run_goes_on_where_it_stopped_and_counts_nothing_twice(tmp_path):
    short = run.SoakSettings(tmp_path, files=run.CHUNK, formats=("camera YAML",))
    run.run_soak(short)
    record = tmp_path / run.RECORD
    record.write_text(record.read_text() + '{"format": "camera YA')  # cut off by a kill
    long = run.SoakSettings(tmp_path, files=2 * run.CHUNK, formats=("camera YAML",))
    run.run_soak(long)
    lines = [line for line in record.read_text().splitlines() if line.endswith("}")]
    firsts = [json.loads(line)["first"] for line in lines]
    assert sorted(firsts) == [0, run.CHUNK]
    table, bad = run.soak_table(long, run.run_soak(long))
    assert (list(table.columns[1].cells), bad) == ([str(2 * run.CHUNK)], 0)


@pytest.mark.parametrize("kind", formats(), ids=lambda kind: kind.name)
def test_an_undamaged_sample_is_read(kind, tmp_path):
    kind.make(tmp_path)
    assert watch._finite(kind.read(tmp_path / kind.file))


@pytest.mark.parametrize("kind", [kind for kind in formats() if kind.text], ids=lambda kind: kind.name)
def test_damaged_text_is_refused_or_read_right(kind):
    with Watched(kind.name) as watched:
        tries = [watched.attempt(seed) for seed in range(25)]
    assert [found for found in tries if found.outcome not in watch.GOOD] == []
    assert any(found.outcome == "refused" for found in tries)


def test_the_same_seed_gives_the_same_damage():
    content = b"a: 1\nb: [1, 2, 3]\n" * 20
    assert mutated(content, 7, text=True) == mutated(content, 7, text=True)
    assert len({mutated(content, seed, text=True) for seed in range(50)}) > 40


def test_settings_of_a_run_are_checked(tmp_path):
    with pytest.raises(SettingsError, match="files"):
        run.SoakSettings(tmp_path, files=0)
    with pytest.raises(SettingsError, match="camera YAML"):
        run.SoakSettings(tmp_path, formats=("camera",))
