"""What `bench engines` makes of the same trials in two physics engines."""

import io

import pytest
from rich.console import Console

from grasptransfer.errors import SettingsError
from grasptransfer.simulation import TrialResult, TrialStatus
from grasptransfer.workshop.benchmark.engines import (
    EngineSettings,
    compared,
    run_engine_benchmark,
    summary_of,
)
from grasptransfer.workshop.benchmark.tables import rows_table

HELD, SHAKE, LIFT = TrialStatus.HELD, TrialStatus.SLIPPED_SHAKE, TrialStatus.SLIPPED_LIFT
SETTINGS = EngineSettings(("mug",), engines=("pybullet", "mujoco"))


def trials(*statuses):
    return [TrialResult("g", i, status, "", seconds=0.5) for i, status in enumerate(statuses)]


@pytest.fixture(scope="module")
def row():
    found = {"pybullet": trials(HELD, HELD, SHAKE, SHAKE), "mujoco": trials(HELD, SHAKE, HELD, LIFT)}
    return {"category": "mug", "instance": "mug_0014", "grasps": 4, **compared(found)}


def test_two_engines_agree_where_both_hold_or_both_lose_for_whatever_reason(row):
    assert (row["trials"], row["agree"]) == (4, 2)
    assert row["held"] == {"pybullet": 2, "mujoco": 2}
    assert row["apart"] == {"HELD / SLIPPED_SHAKE": 1, "SLIPPED_SHAKE / HELD": 1}


def test_the_summary_counts_trials_and_not_instances(row):
    agreeing = {"category": "mug", "instance": "b", "grasps": 12} | compared(
        {"pybullet": trials(*[HELD] * 12), "mujoco": trials(*[HELD] * 12)}
    )
    summary = summary_of([row, agreeing], SETTINGS)
    assert summary["agreement"] == summary["agreement_mug"] == 14 / 16
    assert summary["success_pybullet"] == 14 / 16
    assert summary["success_differs_by"] == 0
    assert summary["seconds_per_trial_mujoco"] == pytest.approx(0.5)
    assert summary["apart"] == {"pybullet / mujoco": {"HELD / SLIPPED_SHAKE": 1, "SLIPPED_SHAKE / HELD": 1}}


def test_the_table_says_where_they_do_not_agree(row):
    buffer = io.StringIO()
    Console(file=buffer, width=200).print(rows_table({"benchmark": "engines", "rows": [row]}))
    (line,) = [line for line in buffer.getvalue().splitlines() if "mug" in line]
    assert "50.0 %" in line
    assert "1 HELD / SLIPPED_SHAKE" in line


def test_one_engine_alone_is_not_compared_and_an_unknown_one_is_named():
    with pytest.raises(SettingsError, match="two engines"):
        run_engine_benchmark(EngineSettings(("mug",), engines=("mujoco",)))
    with pytest.raises(SettingsError, match="ode"):
        run_engine_benchmark(EngineSettings(("mug",), engines=("mujoco", "ode")))
