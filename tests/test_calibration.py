"""The fit of scores to executed grasps, and objects left out of it."""

import dataclasses
from dataclasses import asdict

import numpy as np
import pytest

from grasptransfer.grasping.success_model import FEATURES, Ranking, expected_success
from grasptransfer.workshop.benchmark import calibration
from grasptransfer.workshop.benchmark.chance_fit import (
    best_of_pictures,
    fit_chances,
    fit_weights,
    left_out_scores,
    log_loss,
    weight_of_each,
)
from grasptransfer.workshop.benchmark.executed_grasps import PHOTO, Executed, found_objects

MOMENT = FEATURES.index("moment")
FIRM = np.tile(
    [{"clearance": 3.0, "flatness": 0.9, "coverage": 1.0}.get(name, 0.0) for name in FEATURES], (4, 1)
)


def executed(chance, count=300, *, grasp="drill/top", object=None, seed=0):
    """Grasps alike but for the moment of their weight, held with `chance(moment)`."""
    rng = np.random.default_rng(seed)
    grasps = []
    for number, moment in enumerate(rng.uniform(0, 4, count)):
        features = FIRM.copy()
        features[:, MOMENT] = moment
        held = bool(rng.random() < chance(moment))
        grasps.append(
            Executed(features, held, object=object or f"{number % 20}", picture=str(number), grasp=grasp)
        )
    return grasps


@pytest.mark.parametrize("middle", [1.5, 2.5])
def test_the_fitted_chance_is_that_which_executed_grasps_show(middle):
    weights = fit_weights(executed(lambda moment: 1 / (1 + np.exp(2 * (moment - middle)))))
    for moment, chance in ((middle - 1.5, 0.95), (middle, 0.5), (middle + 1.5, 0.05)):
        features = FIRM.copy()
        features[:, MOMENT] = moment
        assert expected_success(features, weights) == pytest.approx(chance, abs=0.12)


def test_a_grasp_that_holds_less_often_than_its_geometry_says_is_scored_less():
    good = executed(lambda _: 0.9, grasp="drill/top")
    bad = executed(lambda _: 0.3, grasp="drill/handle", seed=1)
    scores = fit_chances([*good, *bad]).scores([*good, *bad])
    assert scores[:300].mean() == pytest.approx(0.9, abs=0.06)
    assert scores[300:].mean() == pytest.approx(0.3, abs=0.06)


def test_an_object_counts_once_however_often_it_was_seen():
    often, once = executed(lambda _: 1.0, 90, object="a"), executed(lambda _: 0.0, 10, object="b")
    weights = weight_of_each([*often, *once])
    assert weights[:90].sum() == pytest.approx(0.5)
    assert weights.sum() == pytest.approx(1)


def test_an_object_does_not_teach_its_own_left_out_score():
    """All of one object's grasps are lost; only a fit that saw it knows."""
    others = executed(lambda _: 0.9, 200)
    strange = executed(lambda _: 0.0, 100, object="strange", seed=1)
    every = [*others, *strange]
    seen, unseen = fit_chances(every).scores(every), left_out_scores(every)
    assert unseen[200:].mean() > 0.8
    assert seen[200:].mean() < unseen[200:].mean()
    assert log_loss(every, seen) < log_loss(every, unseen)


def test_the_best_of_a_picture_is_its_highest_score():
    first, second, other = executed(lambda _: 1.0, 3, object="a")
    first, second = (dataclasses.replace(one, picture="p") for one in (first, second))
    best = best_of_pictures([first, second, other], np.array([0.2, 0.7, 0.5]))
    assert sorted(one.stated for one in best if one is not None) == [0.5, 0.7]


def test_a_draw_without_contact_counts_as_lost():
    features = FIRM.copy()
    whole = expected_success(features, Ranking.fitted().weights)
    features[0] = np.nan
    assert expected_success(features, Ranking.fitted().weights) == pytest.approx(whole * 3 / 4)


def test_no_grip_makes_up_for_a_gripper_deep_in_the_object():
    deep = FIRM.copy()
    deep[:, FEATURES.index("clearance")] = -6.0
    assert expected_success(FIRM, Ranking.fitted().weights) > 0.8
    assert expected_success(deep, Ranking.fitted().weights) < 0.02


def test_every_object_of_every_source_is_found(tmp_path):
    (tmp_path / "mug" / "blue").mkdir(parents=True)
    found = found_objects(("mug",), 2, tmp_path, None)
    assert [name for _, name in found] == ["random/random_78000000", "random/random_78000001", "mesh/blue"]


def test_the_document_holds_present_fitted_and_left_out_figures(monkeypatch):
    grasps = executed(lambda moment: 0.9 if moment < 2 else 0.2, 120, grasp="mug/rim_left")
    rows = [asdict(one) | {"features": one.features.tolist(), "source": PHOTO} for one in grasps]
    monkeypatch.setattr(calibration, "measure_instances", lambda *_, **__: [{"grasps": rows}])
    result = calibration.run_calibration(calibration.CalibrationSettings(("mug",), objects=2))
    summary = result["summary"]
    assert summary["objects"] == 20
    for name in ("rgb", "rgb_fitted", "rgb_left_out"):
        for key in ("best_ranked_held", "stated", "ece", "brier"):
            assert 0 <= summary[f"{key}_{name}"] <= 1
    assert summary["brier_rgb_fitted"] < summary["brier_rgb"] + 0.02
    assert {row["scores"] for row in result["rows"]} == {"present", "fitted", "left_out"}
    assert {"told", "pose_sigma", "views_together"} <= result["settings"].keys()
