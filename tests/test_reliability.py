"""How true stated chances are, on outcomes drawn with known chances."""

import numpy as np
import pytest

from grasptransfer.workshop.benchmark.reliability import (
    Chance,
    brier_score,
    expected_calibration_error,
    reliability_table,
    summarise_chances,
)


def outcomes(stated, true, seed=0):
    rng = np.random.default_rng(seed)
    return [Chance(float(s), bool(rng.random() < t)) for s, t in zip(stated, true, strict=True)]


def test_chances_that_come_true_have_no_calibration_error():
    chances = [Chance(0.75, held) for held in (True, True, True, False)]
    assert expected_calibration_error(chances, bins=1) == pytest.approx(0)
    assert expected_calibration_error([Chance(0.9, False)]) == pytest.approx(0.9)


def test_boasting_by_a_fifth_is_a_calibration_error_of_a_fifth():
    true = np.random.default_rng(1).uniform(0.1, 0.7, 4000)
    assert expected_calibration_error(outcomes(true + 0.2, true)) == pytest.approx(0.2, abs=0.02)


def test_the_brier_score_of_always_one_half_is_a_quarter():
    assert brier_score([Chance(0.5, True), Chance(0.5, False)]) == pytest.approx(0.25)


def test_bins_hold_equal_numbers_and_the_interval_holds_the_share():
    stated = np.random.default_rng(2).uniform(0, 1, 95)
    rows = reliability_table(outcomes(stated, stated))
    assert sum(row["grasps"] for row in rows) == 95
    assert {row["grasps"] for row in rows} == {9, 10}
    for row in rows:
        assert row["low"] <= row["held"] <= row["high"]
        assert row["from"] <= row["stated"] <= row["to"]


def test_a_picture_without_a_usable_grasp_counts_as_lost_and_states_nothing():
    summary = summarise_chances("rgb", [Chance(0.8, True), None], [Chance(0.8, True), Chance(0.1, False)])
    assert summary["best_ranked_held_rgb"] == pytest.approx(0.5)
    assert summary["stated_rgb"] == pytest.approx(0.8)
    assert summary["brier_rgb"] == pytest.approx((0.2**2 + 0.1**2) / 2)


def test_nothing_executed_has_no_figures():
    summary = summarise_chances("rgb", [], [])
    assert summary["best_ranked_held_rgb"] is None
    assert summary["ece_rgb"] is None
    assert reliability_table([]) == []
