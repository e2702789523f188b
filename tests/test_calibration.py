"""The fit of the ranking's weights to executed grasps, and how far scores are from shares."""

import numpy as np
import pytest

from grasptransfer.grasping.success_model import FEATURES, Ranking, expected_success
from grasptransfer.workshop.benchmark.calibration import Executed, calibration_error, fit_weights, reliability

MOMENT = FEATURES.index("moment")


def executed(chance, count=300, seed=0):
    """Grasps alike but for the moment of their weight, held with `chance(moment)`."""
    rng = np.random.default_rng(seed)
    grasps = []
    for moment in rng.uniform(0, 6, count):
        features = np.tile([3.0, 0.9, 1.0, 0.0], (4, 1))
        features[:, MOMENT] = moment
        grasps.append(Executed(features, bool(rng.random() < chance(moment))))
    return grasps


@pytest.mark.parametrize("middle", [2.0, 4.0])
def test_the_fitted_score_is_the_chance_that_what_was_executed_shows(middle):
    grasps = executed(lambda moment: 1 / (1 + np.exp(2 * (moment - middle))))
    weights = fit_weights(grasps)
    features = grasps[0].features.copy()
    for moment, chance in ((middle - 1.5, 0.95), (middle, 0.5), (middle + 1.5, 0.05)):
        features[:, MOMENT] = moment
        assert expected_success(features, weights) == pytest.approx(chance, abs=0.12)


def test_a_draw_without_contact_counts_as_lost():
    features = np.tile([3.0, 1.0, 1.0, 0.0], (4, 1))
    whole = expected_success(features, Ranking.fitted().weights)
    features[0] = np.nan
    assert expected_success(features, Ranking.fitted().weights) == pytest.approx(whole * 3 / 4)


def test_no_grip_makes_up_for_a_gripper_deep_in_the_object():
    firm = np.tile([3.0, 1.0, 1.0, 0.0], (4, 1))
    deep = np.tile([-6.0, 1.0, 1.0, 0.0], (4, 1))
    assert expected_success(firm, Ranking.fitted().weights) > 0.9
    assert expected_success(deep, Ranking.fitted().weights) < 0.02
    half = np.concatenate([firm, deep])
    whole = expected_success(firm, Ranking.fitted().weights)
    assert expected_success(half, Ranking.fitted().weights) == pytest.approx(whole / 2, abs=0.02)


def test_scores_that_are_shares_have_no_calibration_error():
    scores = [(0.75, held) for held in (True, True, True, False)] + [(0.5, True), (0.5, False)]
    rows = reliability(scores, "present")
    assert calibration_error(rows, "present") == pytest.approx(0)
    assert sum(row["grasps"] for row in rows) == len(scores)
    assert calibration_error(reliability([(0.9, False)], "x"), "x") == pytest.approx(0.9)
