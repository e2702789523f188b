"""The table of what long runs tested is made of their records."""

import json

import pytest

from grasptransfer.errors import SettingsError
from grasptransfer.workshop import figures
from grasptransfer.workshop.soak.summary import summarise


def test_records_of_all_runs_make_one_table_and_failures_count(tmp_path):
    with pytest.raises(SettingsError, match="holds no run"):
        summarise(tmp_path)
    files = [
        {"format": "npz", "first": 0, "outcomes": {"refused": 90, "right": 9, "hang": 1}, "failures": []},
        {"format": "npz", "first": 100, "outcomes": {"refused": 100}, "failures": []},
    ]
    kills = [{"job": "train", "outcome": name} for name in ("resumed", "ended first", "lost", "process left")]
    (tmp_path / "files.jsonl").write_text("".join(json.dumps(line) + "\n" for line in files))
    (tmp_path / "faults.jsonl").write_text("".join(json.dumps(line) + "\n" for line in kills))
    arguments = {"rows": [{"subject": "transfer_grasps", "answered": 3, "refused": 7, "failed": 0}]}
    (tmp_path / "arguments.json").write_text(json.dumps(arguments))
    (tmp_path / "load.json").write_text(
        json.dumps({"rows": [{"run": "one", "transfers": 50, "different": 0}]})
    )
    rows = summarise(tmp_path)
    counts = {row["subject"]: (row["tried"], row["failed"], row["lost"]) for row in rows}
    wanted = {"npz": (200, 1, 0), "transfer_grasps": (10, 0, 0), "train": (4, 1, 1), "one": (50, 0, 0)}
    assert counts == wanted
    readme = f"a {figures.START} {figures.END} b {figures.TESTED[0]} old {figures.TESTED[1]} c"
    made = figures.with_figures(readme, [("soak", {"benchmark": "soak", "rows": rows, "summary": {}})])
    assert "| damaged files | npz | 200 | 1 | 0 |" in made
    assert "old" not in made
