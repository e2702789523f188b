"""The table of load: memory that grows, or another answer, is bad; a slower machine is not."""

from dataclasses import replace

import pytest

from grasptransfer.errors import SettingsError
from grasptransfer.workshop.soak import load
from grasptransfer.workshop.soak.load import LoadRow, LoadSettings, load_table, run_load

GOOD = LoadRow("one process", 1000, 0, 3.0, 700.0, 0.01, 0.4)


def test_growing_memory_and_other_answers_are_bad_and_slowness_is_told():
    rows = [GOOD, replace(GOOD, memory_growth=0.06), replace(GOOD, run="4 processes", different=1)]
    table, bad = load_table(rows)
    assert bad == 2
    assert table.row_count == 3


def test_every_way_of_running_counts_answers_that_differ(monkeypatch):
    answers = iter(range(10_000))
    monkeypatch.setattr(load, "GraspTransfer", lambda *_, **__: None)
    monkeypatch.setattr(load, "_in_processes", lambda count, how: GOOD)
    monkeypatch.setattr(load, "_answer", lambda flow: "the same")
    assert [row.different for row in run_load(LoadSettings(100))] == [0, 0, 0, 0]
    monkeypatch.setattr(load, "_answer", lambda flow: next(answers))
    assert [row.different for row in run_load(LoadSettings(100))][:3] == [100, 10, 10]
    with pytest.raises(SettingsError, match="at least 100"):
        LoadSettings(1)
