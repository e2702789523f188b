"""What `bench grasp` makes of executed grasps."""

import io
from functools import partial

import numpy as np
import pytest
from rich.console import Console

from grasptransfer.category import load_category
from grasptransfer.cli.bench.run import Results, run
from grasptransfer.errors import SettingsError
from grasptransfer.grasping import CheckStatus, Grasp, GraspCheck, load_gripper, on_canonical
from grasptransfer.result import TransferredGrasp
from grasptransfer.workshop.benchmark.grasp import GraspSettings, Outcome, _row, _summary, run_grasp_benchmark
from grasptransfer.workshop.benchmark.seen_instances import Instance
from grasptransfer.workshop.benchmark.tables import rows_table


def grasp(name, status):
    still = np.eye(4)
    warped = on_canonical([Grasp(name, "", still, 0.02)])[0]
    return TransferredGrasp(warped, GraspCheck(status, "", 0.04), 0.9, still, load_gripper("panda"))


@pytest.fixture(scope="module")
def row():
    """Three views: the best grasp held, the best grasp lost, no grasp usable although one would hold."""
    free, doubted = CheckStatus.FREE, CheckStatus.UNLIKELY_TO_HOLD
    views = [
        Outcome([grasp("a", free), grasp("b", free)], [True, False], ["HELD", "SLIPPED_LIFT"]),
        Outcome([grasp("a", free), grasp("b", doubted)], [False, True], ["SLIPPED_LIFT", "HELD"]),
        Outcome([grasp("a", doubted), grasp("b", doubted)], [True, False], ["HELD", "TOO_WIDE"]),
    ]
    mug = load_category("mug")
    instance = Instance(mug, "mug_0014", mug.instance_scene("mug_0014"), mug.field("mug_0014"))
    return _row(instance, "rgb", views)


def test_a_view_without_a_usable_grasp_is_no_success_and_counted(row):
    assert row["top1"] == pytest.approx(1 / 3)
    assert row["without_usable"] == 1
    assert (row["usable"], row["usable_held"]) == (3, 1)
    assert row["success"] == pytest.approx(0.5)


def test_the_summary_tells_success_where_something_is_usable_apart(row):
    summary = _summary([row], GraspSettings(("mug",), estimators=("rgb",)))
    assert summary["top1_rgb"] == pytest.approx(1 / 3)
    assert summary["without_usable_rgb"] == pytest.approx(1 / 3)
    assert summary["top1_where_usable_rgb"] == pytest.approx(1 / 2)
    assert summary["usable_precision"] == pytest.approx(1 / 3)


def test_the_table_has_a_line_for_each_category_and_estimator(row):
    rows = [row, {**row, "estimator": "gt"}, {**row, "instance": "mug_0020"}]
    buffer = io.StringIO()
    Console(file=buffer, width=200).print(rows_table({"benchmark": "grasp", "rows": rows}))
    lines = [line for line in buffer.getvalue().splitlines() if "mug" in line]
    assert len(lines) == 2
    cells = [cell.strip() for cell in lines[0].split("│")[1:-1]]
    assert cells == ["mug", "rgb", "50", "33", "50", "33", "33"]


def test_a_benchmark_that_is_refused_shows_no_progress(capsys, tmp_path):
    settings = GraspSettings(("mug",), views=75)
    with pytest.raises(SettingsError, match="views"):
        run(partial(run_grasp_benchmark, settings), Results(tmp_path / "results.json"))
    assert "instances" not in capsys.readouterr().out
