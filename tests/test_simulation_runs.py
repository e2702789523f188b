"""Trials by the hundred: the same in every process, resumed after a stop, recorded, counted."""

import dataclasses

import numpy as np
import psutil
import pytest
from simulated_box import BOX, PANDA, Placed, from_above, from_the_side

from grasptransfer.simulation import (
    PROTOCOLS,
    TrialResult,
    TrialStatus,
    robustness,
    simulate,
    wilson_interval,
)


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GRASPTRANSFER_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


GRASPS = [Placed("middle", from_the_side(), width=0.04), Placed("end", from_above(z=0.05), width=0.04)]


@pytest.fixture(scope="module")
def reference():
    return simulate(GRASPS, BOX, trials=3, seed=5)


def test_a_seed_gives_the_same_trials_in_other_processes_and_orders(reference):
    assert simulate(GRASPS, BOX, trials=3, seed=5, workers=2) == reference
    turned = simulate(GRASPS[::-1], BOX, trials=3, seed=5)
    assert turned[3:] + turned[:3] == reference
    assert simulate(GRASPS, BOX, trials=3, seed=6) != reference


def test_a_crashed_worker_loses_only_its_trial(reference):
    disturbed = []

    def disturb(done, of):
        if not disturbed:
            children = psutil.Process().children()
            disturbed.append(next(one for one in children if "jobs.worker" in " ".join(one.cmdline())))
            disturbed[0].kill()

    results = simulate(GRASPS, BOX, trials=3, seed=5, workers=2, on_trial=disturb)
    lost = [i for i, result in enumerate(results) if result.status is TrialStatus.CRASHED]
    assert len(lost) == 1
    kept = [i for i in range(6) if i not in lost]
    assert [results[i] for i in kept] == [reference[i] for i in kept]
    assert sum(entry.trials for entry in robustness(results)) == 5  # the lost trial counts as neither
    assert "exit code -9" in results[lost[0]].detail
    assert not disturbed[0].is_running()


def test_a_trial_that_takes_too_long_is_lost():
    endless = dataclasses.replace(PROTOCOLS["lift-shake-v1"], name="endless", settle_time=100.0)
    first, second = simulate(GRASPS, BOX, protocol=endless, workers=2, trial_limit=0.1)
    assert first.status is second.status is TrialStatus.CRASHED
    assert "did not end within 0.1 s" in first.detail


def test_an_interrupted_run_goes_on_where_it_stopped(reference, tmp_path):
    path = tmp_path / "results.jsonl"

    def interrupt(done, of):
        if done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(GRASPS, BOX, trials=3, seed=5, results_path=path, on_trial=interrupt)
    lines = path.read_text().splitlines()
    assert len(lines) == 4
    path.write_text("\n".join(lines[:3]) + "\n" + lines[3][:40])  # the fourth was cut off in the middle
    seen = []
    resumed = simulate(
        GRASPS, BOX, trials=3, seed=5, results_path=path, on_trial=lambda done, of: seen.append(done)
    )
    assert resumed == reference
    assert seen == [4, 5, 6]
    again = simulate(GRASPS, BOX, trials=3, seed=5, results_path=path, on_trial=lambda *_: seen.append(0))
    assert again == reference
    assert 0 not in seen
    other = simulate(GRASPS[:1], BOX, protocol="table-lift-v1", results_path=path)
    assert other[0].protocol == "table-lift-v1"  # another protocol's trial is another trial


def test_a_dask_cluster_of_separate_processes_gives_the_same_trials(reference):
    from distributed import LocalCluster

    settings = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    cluster = LocalCluster(**settings, silence_logs=40)
    with cluster:
        assert simulate(GRASPS, BOX, trials=3, seed=5, cluster=cluster.scheduler_address) == reference


def test_a_recording_follows_the_object_from_the_approach_to_the_end():
    (result,) = simulate(GRASPS[:1], BOX, protocol="table-lift-v1", frames=20)
    recording = result.recording
    phases = list(dict.fromkeys(recording.phases))
    assert phases == ["settle", "approach", "close", "lift", "rest"] or phases == phases[-4:]
    lifted = recording.world_from_object[-1, 2, 3] - recording.world_from_object[0, 2, 3]
    assert lifted == pytest.approx(PROTOCOLS["table-lift-v1"].lift_height, abs=2e-3)
    assert np.all(np.diff(recording.seconds) > 0)
    assert set(recording.world_from_link) == {link.name for link in PANDA.links}
    assert "recording" not in result.as_data()


def test_no_film_is_written_outside_its_folder(tmp_path):
    from grasptransfer.report.movie import save_movies

    (trial,) = simulate(GRASPS[:1], BOX, frames=2)
    named = dataclasses.replace(trial, grasp="../../rim/30deg")
    (path,) = save_movies([named], BOX, PANDA, tmp_path / "a" / "films")
    assert path.parent == tmp_path / "a" / "films"
    assert path.is_file()


def test_a_film_is_written_for_each_recorded_trial(tmp_path):
    from PIL import Image

    from grasptransfer.report.movie import save_movies

    trials = simulate(GRASPS, BOX, frames=5)
    paths = save_movies(trials, BOX, PANDA, tmp_path / "films")
    assert [path.name for path in paths] == ["middle_0.gif", "end_0.gif"]
    with Image.open(paths[0]) as film:
        assert 5 <= film.n_frames <= len(trials[0].recording.seconds)
    assert save_movies(simulate(GRASPS, BOX), BOX, PANDA, tmp_path / "films") == []  # nothing recorded


def test_the_wilson_interval_is_the_published_one():
    # Newcombe, "Two-sided confidence intervals for the single proportion", 1998: 81 of 263.
    assert wilson_interval(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert wilson_interval(0, 20) == pytest.approx((0, 0.1611), abs=1e-4)
    assert wilson_interval(0, 0) == (0, 1)


def test_every_status_gives_advice():
    for status in TrialStatus:
        assert status.advice.endswith(".")
    assert [status for status in TrialStatus if status.held] == [TrialStatus.HELD]
    assert TrialResult("g", 0, TrialStatus.CRASHED, "").held is False
